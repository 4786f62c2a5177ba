# SPDX-License-Identifier: Apache-2.0
"""Verbs that this distribution adds to `grasptrack`, one file each."""

# SPDX-License-Identifier: Apache-2.0
"""Cameras that are attached: one file for each way to talk to them, and which there are."""

# SPDX-License-Identifier: Apache-2.0
"""Homographies, contours and cameras."""

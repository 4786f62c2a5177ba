# SPDX-License-Identifier: Apache-2.0
"""The active contour of Section IV-A."""

# SPDX-License-Identifier: Apache-2.0
"""From images to outlines: segmentation, the user's masks, and the B-spline snake."""

# SPDX-License-Identifier: Apache-2.0
"""The tracker's core: one pose estimate and one decision for every image (Fig. 3)."""

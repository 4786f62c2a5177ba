# SPDX-License-Identifier: Apache-2.0
"""From images to outlines: the own search, the user's masks, and the segmenters of others.

No object, or none where it is said to be, is an `ObservationError`; regions, masks and images that are none are `InputError`s.
"""

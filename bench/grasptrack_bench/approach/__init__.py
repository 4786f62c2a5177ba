# SPDX-License-Identifier: Apache-2.0
"""From an image to an object in the hand: approaches in the physical world, one to look at or many at random."""

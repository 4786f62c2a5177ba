# SPDX-License-Identifier: Apache-2.0
"""A box of slips that grows from the contacts, side by side."""

from __future__ import annotations

from collections.abc import Callable, Sequence

Ends = Sequence[Sequence[int]]
"""For each contact, how many places back and ahead the box reaches."""


def grow_box(contacts: int, most: int, closes: Callable[[int, int, Ends], bool]) -> list[tuple[int, int]]:
    """The box when no side can grow any farther; it grows evenly, where it can.

    Args:
        contacts: their number, k.
        most: places that a side may lie from the middle.
        closes: whether the box may get a new side: the contact that slips, to which place (negative: back), and the
            present ends, within which the others stay.
    """
    ends = [[0, 0] for _ in range(contacts)]
    growing = {(contact, way) for contact in range(contacts) for way in (0, 1)}
    while growing:
        contact, way = min(growing, key=lambda side: (ends[side[0]][side[1]], side))
        far = ends[contact][way] + 1
        if far <= most and closes(contact, far if way else -far, ends):
            ends[contact][way] = far
        else:
            growing.discard((contact, way))
    return [(back, ahead) for back, ahead in ends]

# SPDX-License-Identifier: Apache-2.0
"""Independent regions of contact of one grasp: how far each contact may slip along the outline, both ways ([13])."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from grasptrack import kernels
from grasptrack.geometry.contours import Outline
from grasptrack.grasp.contact_regions.growth import Ends, grow_box
from grasptrack.grasp.contact_regions.slips import SAMPLES, BoundarySamples
from grasptrack.grasp.contact_regions.triples import of_more
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.force_closure import DEFAULT_FRICTION, FINGER_WIDTH, analyze
from grasptrack.typing import Bools, Floats

REACH = 0.3
"""BoundarySamples are looked at up to this share of sqrt(area), and no farther than half round a contour."""


class Regions(NamedTuple):
    """Independent regions of contact ([13]): each contact may lie anywhere in its own, and the grasp closes.

    Attributes:
        contacts: (k, 2) px, on the outline.
        tangents: (k, 2) unit, along the direction of the contour.
        back: (k,) px of arc length by which each contact may slip against its tangent.
        ahead: (k,) px along it.
    """

    contacts: Floats
    tangents: Floats
    back: Floats
    ahead: Floats


def regions_of(
    grasp: Grasp, outline: Outline, friction: float = DEFAULT_FRICTION, finger_width: float | None = None
) -> Regions:
    """The regions of a grasp's contacts, both ways along the outline; once for a grasp, in the view of its choice.

    Two fingers: a rectangle of slips grows from the contacts, side by side, as long as every pair on its new side closes
    with room for what lies between samples. Three: a box grows in the same way, as long as the hull of the wrenches holds
    a ball about the origin that is larger than what any cone's edge moves by between samples. More: as long as no edge
    moves by epsilon from where it is. All of these are parts of what closes, so that a chance worked out from them is too
    small rather than too large. A contact may not slip to where the image border cuts the object. Regions are empty, of length
    0, where the grasp itself does not close.

    Args:
        grasp: contacts, each within 5 % of sqrt(area) of the outline; they are moved onto it.
        outline: a Contour or View.
        friction: Coulomb coefficient.
        finger_width: px over which normals are averaged; default 10 % of sqrt(area).

    Raises:
        GraspError: a contact is not on the outline.
        InputError: friction or finger_width not positive.
    """
    analysis = analyze(grasp, outline, friction, finger_width)
    size = 2.0 * analysis.rho
    width = finger_width or FINGER_WIDTH * size
    places = grasp.on(outline)
    contacts = kernels.point_at(outline.points, outline.offsets, places)
    slips = [BoundarySamples(outline, int(c), p, REACH * size, width) for c, p, _ in places.tolist()]
    tangents = np.array([[n[1], -n[0]] for n in (s.normals[SAMPLES] for s in slips)])
    empty = Regions(contacts, tangents, np.zeros(len(grasp)), np.zeros(len(grasp)))
    if len(grasp) == 2:
        ends = _of_pair(slips, friction)
    else:
        _, cx, cy, *_ = kernels.polygon_moments(outline.points, outline.offsets)
        edges = [s.edges(np.array([cx, cy]), analysis.rho, friction) for s in slips]
        ends = of_more(edges, [s.usable for s in slips])
    if ends is None:
        return empty
    back = np.array([-s.at[SAMPLES - low] for s, (low, _) in zip(slips, ends, strict=True)])
    ahead = np.array([s.at[SAMPLES + high] for s, (_, high) in zip(slips, ends, strict=True)])
    return Regions(contacts, tangents, back, ahead)


def _of_pair(slips: list[BoundarySamples], friction: float) -> list[tuple[int, int]] | None:
    good = _closing_pairs(slips[0], slips[1], math.atan(friction))
    if not good[SAMPLES, SAMPLES]:
        return None

    def closes(contact: int, at: int, ends: Ends) -> bool:
        back, ahead = ends[1 - contact]
        others = slice(SAMPLES - back, SAMPLES + ahead + 1)
        return bool((good[SAMPLES + at, others] if contact == 0 else good[others, SAMPLES + at]).all())

    return grow_box(2, SAMPLES, closes)


def _closing_pairs(first: BoundarySamples, second: BoundarySamples, angle: float) -> Bools:
    """(m, m) which pairs of places close, with room for what lies between them."""
    d = second.contacts[None] - first.contacts[:, None]
    away = np.hypot(d[..., 0], d[..., 1])
    sense = 1.0 if float(first.normals[SAMPLES] @ d[SAMPLES, SAMPLES]) > 0.0 else -1.0
    lean = (first.gap[:, None] + second.gap[None]) / np.maximum(away, 1e-300)
    good = first.usable[:, None] & second.usable[None] & (away > 0.0)
    for normals, way, turn in (
        (first.normals[:, None], sense, first.turn[:, None]),
        (second.normals[None], -sense, second.turn[None]),
    ):
        across = np.abs(normals[..., 0] * d[..., 1] - normals[..., 1] * d[..., 0])
        along = way * (normals[..., 0] * d[..., 0] + normals[..., 1] * d[..., 1])
        good &= np.arctan2(across, along) + turn + lean < angle
    return np.asarray(good)

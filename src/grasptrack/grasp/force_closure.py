# SPDX-License-Identifier: Apache-2.0
"""Is this grasp stable, by how much, and if not, why (Section II; references [12], [14])."""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple

from grasptrack import arguments, kernels
from grasptrack.equality import compared_by_value
from grasptrack.errors import GraspError, InputError
from grasptrack.geometry.contours import Outline, OutlineLike, as_outline, outline_like
from grasptrack.grasp.contacts import MOST_CONTACTS, Grasp
from grasptrack.presentation import to_dict
from grasptrack.typing import Floats

DEFAULT_FRICTION = 0.5
FINGER_WIDTH = 0.1
"""Width of a finger's pad as a fraction of sqrt(area), when none is given."""
ON_OUTLINE = 0.05
"""A contact further from the outline than this fraction of sqrt(area) is not on the object."""


@compared_by_value
class GraspAnalysis(NamedTuple):
    """The analysis of one grasp on one outline.

    Attributes:
        stable: force closure, strictly.
        margin: rad. How much smaller the friction angle atan(friction) could be before closure is lost; negative by
            what is missing when refused.
        epsilon: Ferrari and Canny's quality: the largest wrench in any direction that unit normal forces in total can
            resist; 0 or less when refused. Forces count 1, torques 1 / rho.
        rho: px, sqrt(area) / 2: the length that torques are divided by, so that epsilon does not change with scale.
        centroid_distance: px from the centroid to the grasp line (two fingers) or to the contacts' mean (more).
        flatness: (k,) rms distance of the outline under each finger from a straight line, in finger widths.
        normals: (k, 2) unit normals at the contacts, into the material, in the view that was judged.
        friction: the coefficient that was judged with.
        judged_in: the view that was judged, "reference", "image" or "plane": the object's own plane.
        reason: empty when stable, else a short sentence.
    """

    stable: bool
    margin: float
    epsilon: float
    rho: float
    centroid_distance: float
    flatness: Floats
    normals: Floats
    friction: float
    judged_in: Literal["reference", "image", "plane"]
    reason: str

    @property
    def margin_deg(self) -> float:
        """The margin in degrees."""
        return math.degrees(self.margin)

    def to_dict(self) -> dict[str, Any]:
        """Its attributes by name as plain values, for JSON and data frames; what is not finite is None."""
        return to_dict(self)

    def __repr__(self) -> str:
        verdict = "stable" if self.stable else f'"{self.reason}"'
        return (
            f"GraspAnalysis({verdict}, margin {self.margin_deg:.1f}°, epsilon {self.epsilon:.3f}, in {self.judged_in})"
        )


class ForceClosure(NamedTuple):
    """Force closure of contacts with given normals: everything that says "it closes" asks here.

    Attributes:
        epsilon: as in GraspAnalysis.
        needed: rad, the least friction angle with which they close; pi / 2 where none does.
        friction: the coefficient.
    """

    epsilon: float
    needed: float
    friction: float

    @property
    def margin(self) -> float:
        """rad by which the friction angle could be smaller."""
        return math.atan(self.friction) - self.needed

    @property
    def closes(self) -> bool:
        """Strictly."""
        return self.margin > 0.0 and self.epsilon > 0.0

    @classmethod
    def of(
        cls, contacts: Floats, normals: Floats, centre: tuple[float, float], rho: float, friction: float
    ) -> ForceClosure:
        """Of contacts (k, 2) px with normals (k, 2) into the material; torques are about `centre`, divided by rho."""
        return cls(*kernels.force_closure(contacts, normals, *centre, rho, friction), friction)


def check_count(fingers: int) -> None:
    """Raise GraspError where that are more fingers than can be judged."""
    if fingers > MOST_CONTACTS:
        raise GraspError(f"a grasp is judged for at most {MOST_CONTACTS} fingers, not {fingers}", fingers=fingers)


def check_friction(friction: float) -> None:
    """Raise InputError unless the coefficient is positive and finite."""
    if not (0.0 < friction < math.inf):
        raise InputError(f"friction must be a positive number, not {friction}", friction=friction)


def check_width(finger_width: float | None) -> None:
    """Raise InputError unless the width is positive and no wider than any image, or None for the default."""
    if finger_width is not None and not 0.0 < finger_width < arguments.LARGEST:
        raise InputError(f"finger_width must be a positive number of px, not {finger_width}", finger_width=finger_width)


@arguments.checked(
    grasp=arguments.instance(Grasp),
    outline=outline_like,
    friction=arguments.number,
    finger_width=arguments.optional(arguments.number),
    judged_in=arguments.text,
)
def analyze(
    grasp: Grasp,
    outline: OutlineLike,
    friction: float = DEFAULT_FRICTION,
    finger_width: float | None = None,
    judged_in: Literal["reference", "image", "plane"] = "image",
) -> GraspAnalysis:
    """Judge a grasp on an outline.

    Two fingers close when both friction cones strictly hold the line between the contacts, both from outside (squeeze)
    or both from within (spread). Any number closes when the origin is strictly inside the convex hull of the contact
    wrenches (fx, fy, torque / rho). For two the conditions are the same.

    Args:
        grasp: contacts, each within 5 % of sqrt(area) of the outline.
        outline: a Contour or View, or points (N, 2) px of a contour.
        friction: Coulomb coefficient; more friction never makes a grasp worse.
        finger_width: px over which the normal is averaged; default 10 % of sqrt(area).
        judged_in: what `outline` is, for the record.

    Raises:
        ContourError: points that are no contour.
        GraspError: a contact is not on the outline, or there are more than 8.
        InputError: friction or finger_width not positive.
    """
    check_count(len(grasp))
    return Analyzer(as_outline(outline), finger_width, judged_in).analyze(grasp.contacts, friction)


class Analyzer:
    """Judges one grasp after another on one outline: what does not depend on the contacts is worked out once.

    Args:
        outline: a Contour or View.
        finger_width: px over which the normal is averaged; default 10 % of sqrt(area).
        judged_in: what `outline` is, for the record.

    Raises:
        InputError: finger_width not positive.
    """

    def __init__(
        self,
        outline: Outline,
        finger_width: float | None = None,
        judged_in: Literal["reference", "image", "plane"] = "image",
    ) -> None:
        check_width(finger_width)
        self._points, self._offsets, self._judged_in = outline.points, outline.offsets, judged_in
        area, cx, cy, *_ = kernels.polygon_moments(self._points, self._offsets)
        self._size, self._centroid = math.sqrt(area), (cx, cy)
        self._width = finger_width or FINGER_WIDTH * self._size

    def analyze(self, contacts: Floats, friction: float) -> GraspAnalysis:
        """See the function `analyze`; contacts (k, 2) px."""
        check_friction(friction)
        (cx, cy), rho, allowed = self._centroid, 0.5 * self._size, ON_OUTLINE * self._size
        normals, flatness, distances, epsilon, needed = kernels.judge_contacts(
            self._points, self._offsets, contacts, self._width, cx, cy, rho, friction
        )
        for i, distance in enumerate(distances):
            if distance > allowed:
                raise GraspError(
                    f"contact {i + 1} is {distance:.1f} px from the outline; it must be within {allowed:.1f} px",
                    contact=i,
                    distance=distance,
                )
        closure = ForceClosure(epsilon, needed, friction)
        closes, off = closure.closes, _centroid_distance(contacts, cx, cy)
        reason = "" if closes else _refusal_reason(len(contacts), closure)
        return GraspAnalysis(
            closes, closure.margin, epsilon, rho, off, flatness, normals, friction, self._judged_in, reason
        )


def _centroid_distance(contacts: Floats, cx: float, cy: float) -> float:
    if len(contacts) != 2:
        mx, my = contacts.mean(axis=0).tolist()
        return math.hypot(mx - cx, my - cy)
    (x1, y1), (x2, y2) = contacts.tolist()
    opening = math.hypot(x2 - x1, y2 - y1)
    if opening == 0.0:
        return math.hypot(cx - x1, cy - y1)
    return float(abs((cx - x1) * (y2 - y1) - (cy - y1) * (x2 - x1)) / opening)


def _refusal_reason(fingers: int, closure: ForceClosure) -> str:
    needed, friction = closure.needed, closure.friction
    if needed > math.radians(89.9):
        return "the fingers do not oppose each other: no friction closes this grasp"
    what = (
        "the grasp line leaves a friction cone" if fingers == 2 else "the contact wrenches do not surround the origin"
    )
    more = (math.floor(1000.0 * math.tan(needed)) + 1) / 1000.0  # rounded it could be what there is
    return f"{what}: closing needs friction {more:.3f}, there is {friction:.3f}"

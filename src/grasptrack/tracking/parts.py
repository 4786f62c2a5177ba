# SPDX-License-Identifier: Apache-2.0
"""A part as one image taught it: what it looks like, its outline, and where to grasp it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack import arguments
from grasptrack.equality import compared_by_value
from grasptrack.errors import InputError
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.contacts import MOST_CONTACTS, Grasp, RankedGrasp
from grasptrack.grasp.force_closure import DEFAULT_FRICTION, ON_OUTLINE
from grasptrack.grasp.hand import Hand
from grasptrack.images import to_bgr
from grasptrack.typing import Floats, Pixels

MARGIN, MARGIN_PX = 0.25, 16
"""Share of sqrt(area), and px, of the first image that are kept round a part."""
LARGEST_IMAGE = 1e6
"""px that the first image is wide, and its middle lies away, at most: numbers beyond would overflow."""
FILLED = 0.15
"""Share of an image's width that a piece fills of which nobody says from where it is."""
LONGEST_NAME = 60
"""Characters of a part's name."""
MOST_GRASPS = 10
"""Grasps that a part has at most."""
Taught = TypeVar("Taught", bound="KnownPart")
Made = TypeVar("Made")
LEAST_REACH = 1e-9
"""px between a contact and the middle of a grasp, from which on that says where a finger comes from."""


@compared_by_value
@dataclass(frozen=True, eq=False)
class KnownPart:
    """A part, in px of the piece of the first image that shows it.

    Attributes:
        name: of the part.
        image: (H, W) or BGR (H, W, 3), 8 bit, the piece with some ground round the part.
        view: its outline, holes included.
        grasps: on it, the one that is to be used first.
        directions: (k, 2) unit vectors for each grasp, in which its fingers move to touch.
        friction: Coulomb coefficient between finger and part.
        finger: px, width of a finger, and how far back it and its way in need room.
        px_per_mm: scale of the first image; NaN where it is not known.
        origin: px of the piece, width and middle (x, y) of the first image: from where it was seen. None: from above.
        face_up: it never lies turned over, so that what is nearly its own mirror image is not refused for that;
            `dataclasses.replace` says so.
        same_tilt: the camera that looks for it leans against its plane as the one did that taught it, within a degree, from
            any height: it is fixed, or a hand holds it alike. Then outlines that slide along themselves, as an ellipse's, are
            known more exactly. `dataclasses.replace` says so; no file keeps it.
    """

    name: str
    image: Pixels
    view: View
    grasps: tuple[Grasp, ...]
    directions: tuple[Floats, ...]
    friction: float
    finger: tuple[float, float]
    px_per_mm: float = math.nan
    face_up: bool = False
    origin: tuple[float, float, float] | None = None
    same_tilt: bool = False

    @classmethod
    @arguments.checked(image=arguments.array(unbounded=True), friction=arguments.number)
    def of(
        cls: type[Taught],
        image: NDArray[Any],
        view: View,
        grasps: Sequence[Grasp],
        *,
        name: str,
        friction: float = DEFAULT_FRICTION,
        hand: Hand | None = None,
    ) -> Taught:
        """The part that an outline in an image shows.

        Args:
            image: 8 or 16 bit, grey, BGR or BGRA.
            view: outline of the part, whole in the image.
            grasps: on it, the one that is to be used first; 1 to 10.
            name: of the part, up to 60 characters that can be seen.
            friction: Coulomb coefficient, above 0: what is told to be stable depends on it.
            hand: the room that its fingers need; None is the usual hand. Without its px per mm no size in mm is told.

        Raises:
            InputError: a name, grasps, friction or scale that are none; an outline that the image's border cuts.
            SourceError: no image.
        """
        colours = to_bgr(image)
        outer = view.outer.points
        margin = max(MARGIN * math.sqrt(view.outer.area), MARGIN_PX)
        low = np.maximum(np.floor(outer.min(axis=0) - margin), 0.0).astype(int)
        high = np.ceil(outer.max(axis=0) + margin).astype(int) + 1
        piece = np.ascontiguousarray(colours[low[1] : high[1], low[0] : high[0]])
        to_piece = np.array([[1.0, 0.0, -low[0]], [0.0, 1.0, -low[1]], [0.0, 0.0, 1.0]])
        size = (hand or Hand()).in_px(math.sqrt(view.outer.area))
        part = cls(
            name,
            piece,
            View([_shifted_contour(c, to_piece) for c in view.contours]),
            tuple(Grasp(g.contacts - low, g.quality) for g in grasps),
            tuple(_closing_directions(g) for g in grasps),
            friction,
            (size.finger_width, size.finger_thickness + size.clearance),
            math.nan if hand is None or hand.px_per_mm is None else hand.px_per_mm,
            origin=(float(colours.shape[1]), colours.shape[1] / 2.0 - low[0], colours.shape[0] / 2.0 - low[1]),
        )
        part.check_values()
        return part

    def check_values(self) -> None:
        """See that it can be looked for.

        Raises:
            InputError: a name, grasps, friction or scale that are none; an outline that is cut, or lies beyond the image.
        """
        name, (height, width) = self.name, self.image.shape[:2]
        if not (isinstance(name, str) and len(name.strip()) > 0 and len(name) <= LONGEST_NAME and name.isprintable()):
            raise InputError(f"a part has a name of 1 to {LONGEST_NAME} characters that can be seen, not {name!r}")
        if not 1 <= len(self.grasps) <= MOST_GRASPS or len(self.grasps) != len(self.directions):
            raise InputError(f"a part has 1 to {MOST_GRASPS} grasps, not {len(self.grasps)}")
        if not 0.0 < self.friction < math.inf:
            raise InputError(f"friction must be a positive number, not {self.friction:g}", friction=self.friction)
        if not (self.px_per_mm > 0.0 or math.isnan(self.px_per_mm)) or math.isinf(self.px_per_mm):
            raise InputError(f"the scale must be a positive number of px per mm, not {self.px_per_mm:g}")
        if self.origin is not None and not (self.origin[0] > 0.0 and (np.abs(self.origin) <= LARGEST_IMAGE).all()):
            raise InputError(f"the first image has a width above 0 px and a middle near it, not {self.origin}")
        if not all(0.0 < length < math.inf for length in self.finger):
            raise InputError(f"a finger has a width and a reach above 0 px, not {self.finger}")
        low, high = self.view.outer.points.min(axis=0), self.view.outer.points.max(axis=0)
        if self.view.is_clipped or min(low) < -0.5 or high[0] > width - 0.5 or high[1] > height - 0.5:
            raise InputError("a part is taught by an image that shows it whole: its border cuts the outline")
        limit = ON_OUTLINE * math.sqrt(self.view.outer.area)
        for grasp, ways in zip(self.grasps, self.directions, strict=True):
            if len(grasp) > MOST_CONTACTS or ways.shape != grasp.contacts.shape or not np.isfinite(ways).all():
                raise InputError("each contact of a grasp has a direction, and a grasp has 2 to 8 of them")
            if float(grasp.on(self.view)[:, 2].max()) > limit:
                raise InputError(f"a contact lies more than {limit:.1f} px from the part's outline")

    @cached_property
    def _prepared(self) -> dict[object, Any]:
        return {}

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in self.__dict__.items() if name != "_prepared"}

    @property
    def seen_from(self) -> tuple[float, float, float]:
        """Its origin, or that of what lay in the middle of an image and filled a usual part of it."""
        height, width = self.image.shape[:2]
        return self.origin or (width / FILLED, width / 2.0, height / 2.0)

    @property
    def size_mm(self) -> tuple[float, float]:
        """Width and height of the outline as it lies in the image, mm; NaN where the scale is not known."""
        width, height = (np.ptp(self.view.outer.points, axis=0) / self.px_per_mm).tolist()
        return width, height

    def turned_over(self) -> KnownPart:
        """The same part turned over, its image and all that lies in it flipped from left to right by `flip`."""
        flip = self.flip
        contours = [
            Contour.trusted(np.ascontiguousarray(apply_homography(flip, c.points)[::-1]), hole=c.hole)
            for c in self.view.contours
        ]
        return KnownPart(
            self.name,
            np.ascontiguousarray(self.image[:, ::-1]),
            View(contours),
            tuple(Grasp(apply_homography(flip, g.contacts), g.quality) for g in self.grasps),
            tuple(ways * np.array([-1.0, 1.0]) for ways in self.directions),
            self.friction,
            self.finger,
            self.px_per_mm,
            origin=self.origin and (self.origin[0], self.image.shape[1] - self.origin[1], self.origin[2]),
        )

    @property
    def flip(self) -> Floats:
        """(3, 3) from the image to the same flipped from left to right."""
        return np.array([[-1.0, 0.0, self.image.shape[1] - 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def prepare_once(part: KnownPart, asked: object, make: Callable[[], Made]) -> Made:
    """What a function makes of a part, as it is asked for: the part keeps it, so that the next image need not pay for it.

    It keeps only what was asked for last, and leaves it out when it is pickled.
    """
    known = part._prepared
    if asked not in known:
        known.clear()
        known[asked] = make()
    made: Made = known[asked]
    return made


def _shifted_contour(contour: Contour, shift: Floats) -> Contour:
    return Contour.trusted(
        contour.points + shift[:2, 2], hole=contour.hole, strength=contour.strength, clipped=contour.clipped
    )


def _closing_directions(grasp: Grasp) -> Floats:
    """(k, 2) unit vectors in which fingers move to touch: as synthesis has them, else toward the middle of the contacts."""
    if isinstance(grasp, RankedGrasp):
        return grasp.directions.copy()
    inward = grasp.contacts.mean(axis=0) - grasp.contacts
    return np.asarray(inward / np.maximum(np.hypot(*inward.T), LEAST_REACH)[:, None], dtype=np.float64)


def as_parts(given: KnownPart | ArrayLike | Sequence[KnownPart]) -> list[KnownPart]:
    """One part, or several of different names, as a list.

    Raises:
        InputError: none, something else, two of one name, or one under the tilt of an image of which too little is known.
    """
    listed = [given] if isinstance(given, KnownPart) else list(given) if isinstance(given, Sequence) else []
    if not listed or not all(isinstance(part, KnownPart) for part in listed):
        raise InputError("parts must be a part, or a sequence of some", name="parts", value=given)
    names = [part.name for part in listed if isinstance(part, KnownPart)]
    again = next((name for i, name in enumerate(names) if name in names[:i]), None)
    if again is not None:
        raise InputError(f'two parts have the name "{again}": give one of them another', name=again)
    parts = [part for part in listed if isinstance(part, KnownPart)]
    from_nowhere = next((part.name for part in parts if part.same_tilt and part.origin is None), None)
    if from_nowhere is not None:
        raise InputError(f'where the part "{from_nowhere}" was seen is not known, nor under which tilt: teach it anew')
    return parts

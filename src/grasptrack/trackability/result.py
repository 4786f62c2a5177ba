# SPDX-License-Identifier: Apache-2.0
"""What an inspection says of an object."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal, NamedTuple

import numpy as np

from grasptrack.equality import compared_by_value
from grasptrack.geometry.contours import View
from grasptrack.presentation import to_dict
from grasptrack.segmentation.candidate import Candidate
from grasptrack.trackability.appearance import Edges
from grasptrack.trackability.evidence import By, Settled, Symmetry, Usable
from grasptrack.trackability.motions import Motions
from grasptrack.trackability.prediction import Prediction
from grasptrack.typing import Floats
from grasptrack.undistortion import Undistortion

Level = Literal["good", "fair", "poor"]


class Reason(NamedTuple):
    """What speaks against an object, and advice what would help; empty where nothing is known to."""

    text: str
    advice: str


class Looks(NamedTuple):
    """The object as the image shows it.

    Attributes:
        size: px, square root of the area.
        width, height: px, of the box round it.
        share: 0 to 1, of the image.
        contrast: grey levels across the outline, median.
        noise: grey levels, standard deviation of a pixel.
        grain: grey levels, spread of the ground beside the outline.
        sharpness: px, width of the edge: contrast over steepest slope.
        strength: grey levels per px, median along the outline.
        clear: 0 to 1, share of the outline in the image with an edge that the tracker can use.
        border: px from the outline to the nearest border of the image.
        holes: number of them.
        clipped: the border cuts the object.
    """

    size: float
    width: float
    height: float
    share: float
    contrast: float
    noise: float
    grain: float
    sharpness: float
    strength: float
    clear: float
    border: float
    holes: int
    clipped: bool


class Texture(NamedTuple):
    """Structure of the surface, or of the ground round it.

    Attributes:
        rms: grey levels per px, rms slope beyond what noise makes.
        least: the same in the direction that shows least.
        settles: px, standard deviation of the worst contact as the tracker tells it with this structure: of the ground, with
            the surface as well. NaN where there is no grasp.
    """

    rms: float
    least: float
    settles: float


class Held(NamedTuple):
    """The grasp.

    Attributes:
        contacts: (k, 2) px.
        opening: px between the first two contacts.
        margin: rad, of the friction angle.
        stable: it closes.
        chance: 0 to 1, that it closes with contacts as uncertain as expected.
        sigma: (k,) px, expected error of each contact, rms of the distance.
        covariance: (k, 2, 2) px^2.
        limit: px; a larger standard deviation of a contact is not believed (`tracking.pose:largest_sigma`).
        tolerance: px by which a contact may be off and count as right.
    """

    contacts: Floats
    opening: float
    margin: float
    stable: bool
    chance: float
    sigma: Floats
    covariance: Floats
    limit: float
    tolerance: float


@compared_by_value
@dataclass(frozen=True, eq=False)
class Suitability:
    """How well an object can be tracked, told from one image.

    Attributes:
        level: "good", "fair" or "poor", by the prediction (`trackability.report:level_of`).
        reasons: what speaks against it.
        strategy: to be recommended; empty where none can carry the grasp.
        looks: the object as the image shows it.
        motions: which motions the outline shows.
        symmetry: turns under which it fits itself.
        equals: outlines of objects in the image that look the same.
        peaks: (n, 2) px, peaks of curvature.
        strategies: `auto` and the paper's three, each usable or not.
        surface, ground: structure within the outline and round it.
        grasp: None where there is none.
        settled: what fixes the contacts; None without a grasp that can be carried.
        prediction: what a run will give; None without a grasp that can be carried.
        view: the outline.
        edges: along it.
        candidates: up to three objects that the image may mean, the likeliest first.
        object_sure, object_probability: of the choice, as in `TrackResult`.
    """

    level: Level
    reasons: tuple[Reason, ...]
    strategy: str
    looks: Looks
    motions: Motions
    symmetry: Symmetry
    equals: tuple[View, ...]
    peaks: Floats
    strategies: tuple[Usable, ...]
    surface: Texture
    ground: Texture
    grasp: Held | None
    settled: Settled | None
    prediction: Prediction | None
    view: View
    edges: Edges
    candidates: tuple[Candidate, ...] = ()
    object_sure: bool = True
    object_probability: float = math.nan

    def to_dict(self) -> dict[str, Any]:
        """Its attributes by name as plain values, for JSON and data frames; what is not finite is None."""
        return to_dict(self)

    def __repr__(self) -> str:
        return f'Suitability("{self.verdict}")'

    @property
    def located(self) -> float:
        """Share of the frames, 0 to 1, that a run is expected to locate; 0 without a grasp that can be carried."""
        return 0.0 if self.prediction is None else self.prediction.located

    @property
    def located_interval(self) -> tuple[float, float]:
        """Least and most of that share in 100 frames, 95 %."""
        return (0.0, 0.0) if self.prediction is None else self.prediction.located_interval

    @property
    def error_px(self) -> float:
        """px, expected error of the worst contact, rms over a run; NaN where none was located, or without a grasp."""
        return math.nan if self.prediction is None else self.prediction.error_px

    @property
    def error_interval(self) -> tuple[float, float]:
        """px, least and most of that, 95 %; NaN where it is."""
        return (math.nan, math.nan) if self.prediction is None else self.prediction.error_interval

    @property
    def by(self) -> By:
        """What fixes the contacts."""
        if self.settled is not None:
            return self.settled.by
        return "outline" if self.motions.models["homography"].observable else "nothing"

    @property
    def verdict(self) -> str:
        """One line: the level, and what speaks against the object."""
        why = "; ".join(r.text for r in self.reasons)
        return f"{self.level}: {why}" if why else self.level


def as_seen(found: Suitability, lens: Undistortion) -> Suitability:
    """Outlines, peaks, contacts and the errors to be expected of contacts as they are seen.

    All else stays that of the straight image: motions, widths, and what is predicted of a run.
    """
    grasp = found.grasp
    if grasp is not None:
        J = lens.point_jacobian(grasp.contacts)
        covariance = np.asarray(J @ grasp.covariance @ np.swapaxes(J, 1, 2))
        sigma = np.sqrt(np.trace(covariance, axis1=1, axis2=2))
        grasp = grasp._replace(contacts=lens.points_seen(grasp.contacts), covariance=covariance, sigma=sigma)
    return replace(
        found,
        grasp=grasp,
        view=lens.view_seen(found.view),
        equals=tuple(lens.view_seen(view) for view in found.equals),
        peaks=lens.points_seen(found.peaks),
        candidates=tuple(c._replace(view=lens.view_seen(c.view)) for c in found.candidates),
    )

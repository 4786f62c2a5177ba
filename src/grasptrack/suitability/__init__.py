# SPDX-License-Identifier: Apache-2.0
"""How well an object can be tracked, told from one image before the run."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack import kernels
from grasptrack.analysis import DEFAULT_FRICTION, FINGER_WIDTH, analyze
from grasptrack.closing import chance_of_closing, regions_of
from grasptrack.contour import View
from grasptrack.grasp import Grasp
from grasptrack.hand import Hand
from grasptrack.suitability.advice import Findings, level_of, reasons_of
from grasptrack.suitability.edges import Edges, edges_of, scatter, sway
from grasptrack.suitability.first import FirstView, first_view
from grasptrack.suitability.motions import TURN, Frame, Motions, motions_of
from grasptrack.suitability.rehearsal import Rehearsal, rehearse
from grasptrack.suitability.relief import Relief, reliefs
from grasptrack.suitability.restaged import Stage
from grasptrack.suitability.result import Held, Looks, Reason, Suitability, Texture
from grasptrack.suitability.settled import Settled, settled
from grasptrack.suitability.strategies import peaks_of, recommended, strategies_of
from grasptrack.suitability.symmetry import Likeness, equals_of, symmetry_of
from grasptrack.tracking.decision import largest_sigma
from grasptrack.tracking.initialization import AUTO
from grasptrack.tracking.messages import Reason as Why
from grasptrack.tracking.numbers import DEFAULT_RISK, NUMBERS
from grasptrack.tracking.selection import make_target
from grasptrack.tracking.target import pyramid
from grasptrack.tracking.tracker import GraspTracker

__all__ = ["Reason", "Suitability", "inspect"]

Floats = NDArray[np.float64]


def inspect(
    image: NDArray[Any],
    *,
    grasp: ArrayLike | None = None,
    fingers: int = 2,
    friction: float = DEFAULT_FRICTION,
    object_at: tuple[float, float] | None = None,
    box: tuple[float, float, float, float] | None = None,
    mask: NDArray[Any] | None = None,
    ignore: NDArray[Any] | None = None,
    hand: Hand | None = None,
    strategy: str = AUTO,
    risk: float = DEFAULT_RISK,
) -> Suitability:
    """Tell how well the object in an image can be tracked, and how exactly its contacts will be known.

    Object and grasp are chosen as `GraspTracker` does in a first image. Errors are expected from the normal equations of
    the outline and the scatter of its edges, and where it leaves motions free from the tracker's own evidence of the surface
    and the ground; the tracker is also tried on the image itself, moved a little.

    Args:
        image: 8 or 16 bit, grey (H, W), BGR (H, W, 3) or BGRA (H, W, 4).
        grasp: (k, 2) px contacts in place of synthesis; they choose the object.
        fingers: number of contacts to synthesise, 2 or 3.
        friction: Coulomb coefficient; more lets more grasps close.
        object_at: (x, y) px of the object.
        box: left, top, width and height of it, px, in the place of a pixel.
        mask: (H, W) your own segmentation, nonzero on objects; it takes the image's place.
        ignore: (H, W) nonzero where nothing belongs to the scene.
        hand: opening and fingers that a synthesised grasp must suit.
        strategy: that is to carry the grasp.
        risk: probability, between 0 and 1, below which an answer of the tracker may be wrong.

    Raises:
        ObservationError: no object.
        SourceError, InputError: an image or mask that cannot be used, friction not positive, a risk not between 0 and 1.
        GraspError: given contacts that are none, or not on an object.
        StrategyError: unknown strategy, or more fingers than it can carry.
    """
    asked = GraspTracker(
        fingers=fingers, strategy=strategy, friction=friction, grasp=grasp, object_at=object_at, box=box, risk=risk
    )
    given = None if grasp is None else Grasp(grasp)
    first = first_view(image, given, asked.fingers, friction, object_at, box, mask, ignore, hand, strategy, risk)
    view, grey = first.candidate.view, first.grey
    edges = edges_of(view, grey, first.candidate.polarity)
    surface, ground = reliefs(grey, view, first.hidden)
    looks = _looks(first, edges, surface)
    noise = math.sqrt(2.0) * looks.scatter  # of both views
    motions = motions_of(*edges.used, first.held.contacts, _frame(view), noise, sway(edges))
    whole = motions.models["homography"]
    limit = largest_sigma(view.outer.area, NUMBERS.with_risk(risk))
    stage = Stage(first.colours, first.candidate.channel, surface.noise)
    rehearsal = None if first.carrier is None else rehearse(first, stage)
    fixed = None
    if first.carrier is not None and strategy == AUTO:  # the others look at the outline alone
        fixed = settled(first, stage, limit, whole.covariance, whole.observable)
    known = whole.covariance if fixed is None else fixed.covariances[0]
    alone = "" if first.carrier is None else _refusal(whole.observable, known, limit)
    refusal = alone if fixed is None else _refusal(fixed.by != "nothing", fixed.covariance, limit)
    grip = None if first.grasp is None else _held(first.grasp, view, friction, limit, motions, fixed, rehearsal)
    usable = strategies_of(first.held, view, grey, alone, refusal)
    likeness = Likeness(first, stage)
    symmetry = symmetry_of(first, likeness, "similarity" in motions.motions[TURN].observed)
    equals = equals_of(first, likeness)
    reasons = reasons_of(
        Findings(looks, motions, symmetry, len(equals), usable, grip, first.reason, refusal, fixed, rehearsal, risk)
    )
    return Suitability(
        level=level_of(reasons),
        reasons=reasons,
        strategy=recommended(usable) if grip is not None and not refusal else "",
        looks=looks,
        motions=motions,
        symmetry=symmetry,
        equals=tuple(equals),
        peaks=peaks_of(view),
        strategies=usable,
        surface=Texture(surface.rms, surface.least, math.nan if fixed is None else fixed.deviations[1]),
        ground=Texture(ground.rms, ground.least, math.nan if fixed is None else fixed.deviations[2]),
        grasp=grip,
        settled=fixed,
        rehearsal=rehearsal,
        view=view,
        edges=edges,
    )


def _refusal(fixed: bool, covariance: Floats, limit: float) -> str:
    """Why contacts will not be believed that may be off by covariances (k, 2, 2) px^2; empty where they will."""
    sigma = math.sqrt(float(np.linalg.eigvalsh(covariance)[:, -1].max()))
    return "" if fixed and sigma <= limit else Why("uncertain", {"sigma": sigma}).sentence


def _frame(view: View) -> Frame:
    area, x, y, theta, *_ = kernels.inertia(view.points, view.offsets)
    c, s = math.cos(theta), math.sin(theta)
    return Frame(np.array([x, y]), np.array([[c, s], [-s, c]]), math.sqrt(area))


def _looks(first: FirstView, edges: Edges, surface: Relief) -> Looks:
    view, grey = first.candidate.view, first.grey
    height, width = grey.shape
    low, high = view.outer.points.min(axis=0), view.outer.points.max(axis=0)
    size = _frame(view).size
    some = edges.strength > 0.0
    inside = ~np.concatenate([np.zeros(len(c), np.bool_) if c.clipped is None else c.clipped for c in view.contours])
    strength = float(np.median(edges.strength[inside])) if inside.any() else 0.0
    beyond = edges.beyond[some]
    ground = float(np.median(beyond)) if len(beyond) else math.nan
    return Looks(
        size=size,
        width=float(high[0] - low[0]),
        height=float(high[1] - low[1]),
        share=size**2 / (width * height),
        contrast=float(np.median(edges.contrast[inside])) if inside.any() else 0.0,
        noise=surface.noise,
        grain=1.4826 * float(np.median(np.abs(beyond - ground))) if len(beyond) else math.nan,
        sharpness=_edge_width(first),
        strength=strength,
        clear=float(edges.clear[inside].mean()) if inside.any() else 0.0,
        scatter=scatter(edges, surface.noise),
        border=max(0.0, float(min(low.min(), width - 1.0 - high[0], height - 1.0 - high[1]))),
        holes=len(view.contours) - 1,
        clipped=view.is_clipped,
    )


def _edge_width(first: FirstView) -> float:
    """px, contrast over steepest slope of the edges, as the tracker measures them; NaN where it sees none."""
    target = make_target(pyramid(first.grey), first.candidate.view, first.held.contacts, NUMBERS, first.hidden)
    return math.sqrt(2.0 * math.pi) * target.edge_width * float(target.A[0, 0])


def _held(
    grasp: Grasp,
    view: View,
    friction: float,
    limit: float,
    motions: Motions,
    fixed: Settled | None,
    rehearsal: Rehearsal | None,
) -> Held:
    """The grasp with the errors to be expected of its contacts, both ways to foretell them taken together."""
    covariance = motions.models["homography"].covariance if fixed is None else fixed.covariance
    sigma = np.sqrt(np.trace(covariance, axis1=1, axis2=2))
    tried = math.nan if rehearsal is None else rehearsal.error
    known = 1.0 if math.isnan(tried) else math.sqrt(0.5 * (1.0 + (tried / float(sigma.max())) ** 2))
    width = FINGER_WIDTH * motions.frame.size
    analysis = analyze(grasp, view, friction, width, "reference")
    return Held(
        contacts=grasp.contacts,
        opening=grasp.opening,
        margin=analysis.margin,
        stable=analysis.stable,
        chance=chance_of_closing(regions_of(grasp, view, friction, width), known**2 * covariance),
        sigma=known * sigma,
        covariance=known**2 * covariance,
        limit=limit,
    )

# SPDX-License-Identifier: Apache-2.0
"""How well an object can be tracked, told from one image before the run."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from grasptrack import arguments, kernels
from grasptrack.errors import InputError
from grasptrack.first_image import FIRST_IMAGE_CHECKS
from grasptrack.geometry.contours import View
from grasptrack.grasp.closure_probability import chance_of_closing
from grasptrack.grasp.contact_regions import regions_of
from grasptrack.grasp.force_closure import DEFAULT_FRICTION, analyze
from grasptrack.grasp.hand import Hand, Length
from grasptrack.images import PLAIN
from grasptrack.statistics import robust_sd
from grasptrack.trackability.appearance import Edges, Relief, edge_direction_noise, edges_of, gradient_statistics
from grasptrack.trackability.evidence import (
    ORDER,
    Likeness,
    Settled,
    contact_evidence,
    equals_of,
    largest_deviation,
    peaks_of,
    recommended_strategy,
    strategies_of,
    symmetry_of,
    unfixed_covariance,
)
from grasptrack.trackability.first import InspectedView, first_view, first_view_of
from grasptrack.trackability.motions import TURN, Basis, motions_of
from grasptrack.trackability.prediction import (
    RUNS,
    Drawn,
    Looked,
    Prediction,
    SimulatedRun,
    drawn_runs,
    predict_run,
    simulate_tracking,
)
from grasptrack.trackability.report import Findings, is_lost, level_of, reasons_of
from grasptrack.trackability.result import Held, Looks, Reason, Suitability, Texture
from grasptrack.trackability.synthetic_view import RunSetting, Stage
from grasptrack.tracking.camera import Beforehand
from grasptrack.tracking.follower import AUTO
from grasptrack.tracking.initialization import FirstScene, Wish
from grasptrack.tracking.messages import StatusReason as Why
from grasptrack.tracking.numbers import DEFAULT_RISK, NUMBERS, Numbers
from grasptrack.tracking.pose import contact_tolerance, largest_sigma
from grasptrack.tracking.selection import make_target
from grasptrack.tracking.strategies import carrier_for
from grasptrack.tracking.target import Target, build_pyramid
from grasptrack.tracking.tracker import GraspTracker
from grasptrack.typing import StrategyName

__all__ = ["Reason", "Suitability", "inspect", "inspect_scene"]


@arguments.checked(
    image=arguments.array(unbounded=True),
    grasp=arguments.optional(arguments.array(unbounded=True)),
    fingers=arguments.whole,
    friction=arguments.number,
    **FIRST_IMAGE_CHECKS,
    mask=arguments.optional(arguments.array(unbounded=True)),
    hand=arguments.optional(arguments.instance(Hand)),
    strategy=arguments.text,
    risk=arguments.number,
    focal=arguments.optional(arguments.instance(Beforehand)),
    runs=arguments.whole,
    number=arguments.optional(arguments.whole),
    first_look_ms=arguments.optional(arguments.number),
)
def inspect(
    image: NDArray[Any],
    *,
    grasp: ArrayLike | None = None,
    fingers: int = 2,
    friction: float = DEFAULT_FRICTION,
    object_at: ArrayLike | None = None,
    box: tuple[float, float, float, float] | None = None,
    mask: NDArray[Any] | None = None,
    ignore: NDArray[Any] | None = None,
    hand: Hand | None = None,
    strategy: StrategyName | str = AUTO,
    risk: float = DEFAULT_RISK,
    focal: Beforehand | None = None,
    runs: int = RUNS,
    not_at: ArrayLike | None = None,
    outline: ArrayLike | None = None,
    segmenter: Any = None,
    background: NDArray[Any] | None = None,
    number: int | None = None,
    first_look_ms: float | None = None,
    tolerance: Length | float | str | None = None,
) -> Suitability:
    """Tell how well the object in an image can be tracked, and how exactly its contacts will be known.

    Object and grasp are chosen as `GraspTracker` does in a first image. What a run will give follows from runs of the tracker
    that are drawn: on the image itself, moved as an approach would move it, where the truth is known.

    Args:
        image: 8 or 16 bit, grey (H, W), BGR (H, W, 3) or BGRA (H, W, 4).
        grasp: (k, 2) px contacts in place of synthesis; they choose the object.
        fingers: number of contacts to synthesise, 2 or 3.
        friction: Coulomb coefficient; more lets more grasps close.
        object_at: (x, y) px of the object, or several.
        box: left, top, width and height of it, px, in the place of a pixel.
        mask: (H, W) your own segmentation, nonzero on objects; it takes the image's place.
        ignore: (H, W) nonzero where nothing belongs to the scene.
        hand: opening and fingers that a synthesised grasp must suit.
        strategy: that is to carry the grasp.
        risk: probability, between 0 and 1, below which an answer of the tracker may be wrong.
        focal: what is known of the camera beforehand, as for `Plane`; the image is then one without distortion.
        runs: that are drawn.
        not_at: (x, y) px, or several, beside the object.
        outline: (n, 2) px of a rough polygon round it.
        segmenter: proposes regions beside the own search, as `segmenter_for` takes it.
        background: an image of the same bench without the object; the light may differ.
        number: of the candidate to take, 1 being the likeliest.
        first_look_ms: work that the search for the object may do, see `first_look`.
        tolerance: by which a contact may be off, as of `GraspTracker`.

    Raises:
        ObservationError: no object.
        SourceError, InputError: an image or mask that cannot be used, friction not positive, no run, a risk not between 0
            and 1.
        GraspError: given contacts that are none, or not on an object.
        StrategyError: unknown strategy, or more fingers than it can carry.
    """
    if runs < 1:
        raise InputError(f"at least 1 run must be drawn, not {runs}", runs=runs)
    asked = GraspTracker(
        fingers=fingers,
        strategy=strategy,
        friction=friction,
        grasp=grasp,
        object_at=object_at,
        box=box,
        ignore=ignore,
        hand=hand,
        segmenter=segmenter,
        risk=risk,
        not_at=not_at,
        outline=outline,
        background=background,
        number=number,
        first_look_ms=first_look_ms,
        tolerance=tolerance,
    )
    return _assess_view(first_view(image, mask, asked.wish, focal), _Inspection(asked.wish, focal, runs))


def inspect_scene(scene: FirstScene, runs: int = RUNS, check: Callable[[], None] = lambda: None) -> Suitability:
    """The same of what a tracker has chosen in its first image (`GraspTracker.first_scene`), without another search.

    Of `strategies` it tells of `auto` alone: the verdict does not rest on the others, and to try them costs as much as all
    else. Lengths are in px of the image without the lens's distortion. `check` is called before each of the runs that are
    drawn; what it raises ends the work.
    """
    return _assess_view(first_view_of(scene), _Inspection(scene.wish, scene.before, runs, (AUTO,), check))


class _Inspection(NamedTuple):
    """What `inspect` was asked, the strategies that are tried, and what is called before each run."""

    wish: Wish
    focal: Beforehand | None
    runs: int
    tried: Sequence[str] = (AUTO, *ORDER)
    check: Callable[[], None] = lambda: None


def _assess_view(first: InspectedView, asked: _Inspection) -> Suitability:
    """What a first view promises."""
    view, grey = first.candidate.view, first.grey
    edges = edges_of(view, grey, first.candidate.polarity)
    surface, ground = gradient_statistics(grey, view, first.ignore_mask)
    numbers = asked.wish.numbers_for(view)
    target = first.carrier.follower.target if first.carrier else _create_target(first, numbers)
    looks = _measure_appearance(first, target, edges, surface)
    motions = motions_of(*edges.spaced_samples, _inertia_frame(view), edge_direction_noise(edges))
    whole = motions.models["homography"]
    limit, allowed = largest_sigma(view.outer.area, numbers), contact_tolerance(view.outer.area, numbers)
    auto = asked.wish.strategy == AUTO  # the others segment, in colour
    stage = Stage(grey if auto else first.colours, PLAIN if auto else first.candidate.channel, surface.noise)
    prediction, fixed = None, None
    if first.carrier is not None:
        runs_drawn, looked = _simulate_runs(first, stage, asked)
        fixed = contact_evidence(first, target, looked, limit, whole.observable)
        # beyond its tolerance the tracker refuses
        adrift = min(fixed.contact_deviations[2], allowed) if fixed.by == "nothing" else 0.0
        prediction = predict_run(Drawn.from_runs(runs_drawn, math.sqrt(view.outer.area), adrift))
    refusal = ""
    if fixed is not None:  # else why they will not be believed
        sigma = largest_deviation(fixed.covariance)
        refusal = "" if fixed.by != "nothing" and sigma <= limit else Why("uncertain", {"sigma": sigma}).sentence
    grip = (
        None if first.grasp is None else _assess_grasp(first, asked.wish.friction, (limit, allowed), fixed, prediction)
    )
    usable = strategies_of(first.held_grasp, view, grey, refusal, asked.tried)
    likeness = Likeness(first, target, stage)
    symmetry = symmetry_of(first, likeness, "similarity" in motions.motions[TURN].observed)
    equals = equals_of(first, likeness)
    reasons = reasons_of(
        Findings(looks, motions, symmetry, len(equals), usable, grip, first.reason, refusal, fixed, prediction)
    )
    return Suitability(
        level=level_of(grip, prediction),
        reasons=reasons,
        strategy="" if grip is None or is_lost(prediction) else recommended_strategy(usable),
        looks=looks,
        motions=motions,
        symmetry=symmetry,
        equals=tuple(equals),
        peaks=peaks_of(view),
        strategies=usable,
        surface=Texture(surface.rms, surface.least, math.nan if fixed is None else fixed.contact_deviations[1]),
        ground=Texture(ground.rms, ground.least, math.nan if fixed is None else fixed.contact_deviations[2]),
        grasp=grip,
        settled=fixed,
        prediction=prediction,
        view=view,
        edges=edges,
        candidates=tuple(first.candidates),
        object_sure=first.is_sure,
        object_probability=first.candidate.probability,
    )


def _create_target(first: InspectedView, numbers: Numbers) -> Target:
    levels, numbers = build_pyramid(first.grey), numbers.for_learning(DEFAULT_RISK)
    return make_target(levels, first.candidate.view, first.held_grasp.contacts, numbers, first.ignore_mask)


def _simulate_runs(first: InspectedView, stage: Stage, asked: _Inspection) -> tuple[list[SimulatedRun], list[Looked]]:
    """Runs that are drawn, and the images of the first of them."""
    view, grasp, grey = first.candidate.view, first.held_grasp, first.grey
    away = view.outer.points - (centre := view.outer.points.mean(axis=0))
    size, reach = math.sqrt(view.outer.area), float(np.hypot(*away.T).max())
    setting = RunSetting(
        centre, size, reach, grey.shape[1], grey.shape[0], asked.focal or Beforehand.of_unknown(NUMBERS)
    )
    carrier, made, seen = first.carrier, [], list[Looked]()
    for steps in drawn_runs(setting, asked.runs):
        asked.check()
        if carrier is None:  # each run begins with one that has learned nothing
            first.observer.set_image(first.colours)
            first.observer.choose_object(first.candidate)
            numbers = asked.wish.numbers_for(view)
            carrier = carrier_for(asked.wish.strategy, grasp, view, grey, None, first.observer, numbers, asked.focal)
        run, looked = simulate_tracking(carrier, first, stage, steps)
        made.append(run)
        seen, carrier = seen or looked, None
    return made, seen


def _inertia_frame(view: View) -> Basis:
    area, x, y, theta, *_ = kernels.polygon_moments(view.points, view.offsets)
    c, s = math.cos(theta), math.sin(theta)
    return Basis(np.array([x, y]), np.array([[c, s], [-s, c]]), math.sqrt(area))


def _measure_appearance(first: InspectedView, target: Target, edges: Edges, surface: Relief) -> Looks:
    view, grey = first.candidate.view, first.grey
    height, width = grey.shape
    low, high = view.outer.points.min(axis=0), view.outer.points.max(axis=0)
    size = _inertia_frame(view).size
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
        grain=robust_sd(beyond - ground) if len(beyond) else math.nan,
        sharpness=math.sqrt(2.0 * math.pi) * target.edge_width * float(target.A[0, 0]),
        strength=strength,
        clear=float(edges.clear[inside].mean()) if inside.any() else 0.0,
        border=max(0.0, float(min(low.min(), width - 1.0 - high[0], height - 1.0 - high[1]))),
        holes=len(view.contours) - 1,
        clipped=view.is_clipped,
    )


def _assess_grasp(
    first: InspectedView,
    friction: float,
    limits: tuple[float, float],
    fixed: Settled | None,
    prediction: Prediction | None,
) -> Held:
    """The grasp with the errors to be expected of its contacts: in the ratios of their covariances, as large as predicted.

    `limits` are px: of a standard deviation, and by how much a contact may be off.
    """
    grasp, view = first.held_grasp, first.candidate.view
    covariance = unfixed_covariance(first) if fixed is None else fixed.covariance
    sigma = np.sqrt(np.trace(covariance, axis1=1, axis2=2))
    expected = math.nan if prediction is None else prediction.error_px
    known = 1.0 if math.isnan(expected) else expected / float(sigma.max())
    analysis = analyze(grasp, view, friction, judged_in="reference")
    return Held(
        contacts=grasp.contacts,
        opening=grasp.opening,
        margin=analysis.margin,
        stable=analysis.stable,
        chance=chance_of_closing(regions_of(grasp, view, friction), known**2 * covariance),
        sigma=known * sigma,
        covariance=known**2 * covariance,
        limit=limits[0],
        tolerance=limits[1],
    )

# SPDX-License-Identifier: Apache-2.0
"""What a run will give: the tracker itself on runs drawn from the first view, where the truth is known."""

from __future__ import annotations

import json
import math
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from grasptrack.geometry.homographies import apply_homography
from grasptrack.images import Grey
from grasptrack.trackability.first import InspectedView
from grasptrack.trackability.synthetic_view import RunImage, RunSetting, Stage, draw_run
from grasptrack.tracking.decision import Decision
from grasptrack.tracking.strategies import Carrier

RUNS, IMAGES = 4, 12
"""Runs that are drawn unless more are asked for, and images of each."""
GIVEN_UP = 4
"""A run is over, and lost for the rest, when the object was not located in so many images in a row."""
FRAMES = 100
"""Of a run, for which the share of located ones is foretold."""
QUANTILES = (0.025, 0.5, 0.975)
"""Of the intervals, and of the middle."""
TWO_SIDED = NormalDist().inv_cdf(QUANTILES[2])
"""Standard deviations to either side that hold as much of a normal distribution."""
NODES = np.array([NormalDist().inv_cdf((i + 0.5) / 32) for i in range(32)])
"""Of a normal distribution, all alike probable."""


class Unforeseen(NamedTuple):
    """By how much runs differ from those that are drawn, as `research.studies.trackability --fit` finds it.

    Attributes:
        located, lost: the shares of runs in which all that is drawn is located, or lost, as a Beta distribution has them
            beforehand, ...
        weight: ... and how much the share that was drawn counts against that.
        factor, factor_spread: of the error that was drawn: median, and standard deviation of its log.
        beyond, beyond_spread: the same of what no drawn run shows (lens, body, shutter, the truth's own error), as a share of
            sqrt(area).
    """

    located: float
    lost: float
    weight: float
    factor: float
    factor_spread: float
    beyond: float
    beyond_spread: float


FILE = Path(__file__).with_name("unforeseen.json")
"""Its values, each with the interval that data left it and the script that fitted it."""
UNFORESEEN = Unforeseen(
    **{name: float(entry["value"]) for name, entry in json.loads(FILE.read_text(encoding="utf-8")).items()}
)


class SimulatedRun(NamedTuple):
    """A run that was drawn.

    Attributes:
        images: of it after the first.
        errors: px of the worst contact in each of them that was located.
        reason: of the first image that was not; else empty.
    """

    images: int
    errors: tuple[float, ...]
    reason: str


class Drawn(NamedTuple):
    """What came of the runs that were drawn.

    Attributes:
        images, located: of all runs, and how many of them were located.
        error: px of the worst contact, rms where it was located; NaN where it never was.
        reason: why most of the others were not; empty where all were.
        size: px, square root of the object's area in the first view.
        adrift: px, standard deviation of the worst contact by what one image shows, where that is not enough: even motion
            alone carries it on, and a long run may drift as far; else 0.
    """

    images: int
    located: int
    error: float
    reason: str
    size: float
    adrift: float = 0.0

    @staticmethod
    def from_runs(runs: Sequence[SimulatedRun], size: float, adrift: float = 0.0) -> Drawn:
        """At least one run."""
        errors = np.concatenate([r.errors for r in runs])
        rms = float(np.sqrt(np.mean(np.square(errors)))) if len(errors) else math.nan
        reasons = Counter(r.reason for r in runs if r.reason)
        why = reasons.most_common(1)[0][0] if reasons else ""
        return Drawn(sum(r.images for r in runs), sum(len(r.errors) for r in runs), rms, why, size, adrift)


class Prediction(NamedTuple):
    """What a run will give that shows the object as a whole.

    Attributes:
        drawn: what it rests on.
        located: expected share of the frames with contacts, 0 to 1.
        located_interval: least and most of that share in one run, 95 %.
        error_px: median of the error of the worst contact, rms over a run; NaN where none was located.
        error_interval: px, least and most of that, 95 %.
    """

    drawn: Drawn
    located: float
    located_interval: tuple[float, float]
    error_px: float
    error_interval: tuple[float, float]


class Looked(NamedTuple):
    """An image that was drawn: (H, W) itself, how it came about, and what the tracker decided."""

    grey: Grey
    step: RunImage
    decision: Decision


def simulate_tracking(
    carrier: Carrier, first: InspectedView, stage: Stage, steps: Sequence[RunImage]
) -> tuple[SimulatedRun, list[Looked]]:
    """Follow the grasp through a run, and what was looked at in it."""
    contacts, errors, reason = first.held_grasp.contacts, list[float](), ""
    looked, missed = list[Looked](), 0
    for step in steps:
        grey = first.observer.set_image(stage.render_step(step))
        moved = carrier.move(grey, None)
        looked.append(Looked(grey, step, moved.decision))
        if moved.contacts is None:
            reason, missed = reason or moved.reason.sentence, missed + 1
            if missed == GIVEN_UP:
                break
            continue
        missed = 0
        errors.append(float(np.hypot(*(moved.contacts - apply_homography(step.H, contacts)).T).max()))
    return SimulatedRun(len(steps), tuple(errors), reason), looked


def predict_run(drawn: Drawn, frames: int = FRAMES, unforeseen: Unforeseen = UNFORESEEN) -> Prediction:
    """What runs that were drawn let expect of one that was not."""
    a, b = beta_of(drawn, unforeseen)
    least, middle, most = errors_of(drawn, unforeseen)
    return Prediction(drawn, a / (a + b), shares_of(a, b, frames), middle, (least, most))


def beta_of(drawn: Drawn, unforeseen: Unforeseen) -> tuple[float, float]:
    """The Beta distribution of the share of frames that a run locates: what drifts is no evidence that it goes on."""
    share = drawn.located / drawn.images
    shown = 0.0 if drawn.adrift else share
    return unforeseen.located + unforeseen.weight * shown, unforeseen.lost + unforeseen.weight * (1.0 - share)


def errors_of(drawn: Drawn, unforeseen: Unforeseen) -> tuple[float, float, float]:
    """px, least, median and most of the rms error of a run, 95 %; NaN where none was drawn."""
    if math.isnan(drawn.error):
        return math.nan, math.nan, math.nan
    u = unforeseen
    shown = drawn.error * u.factor * np.exp(u.factor_spread * NODES)
    beyond = drawn.size * u.beyond * np.exp(u.beyond_spread * NODES)
    least, middle, most = np.quantile(np.hypot(shown[:, None], beyond), QUANTILES).tolist()
    return least, middle, math.hypot(most, TWO_SIDED * drawn.adrift)


def shares_of(a: float, b: float, frames: int) -> tuple[float, float]:
    """95 % interval of the share of so many frames that a run has located, when runs' shares are Beta(a, b)."""
    made = np.cumsum([math.exp(log_chance(a, b, frames, k)) for k in range(frames + 1)])
    least, most = (min(int(np.searchsorted(made, p)), frames) for p in (QUANTILES[0], QUANTILES[2]))
    return least / frames, most / frames


def log_chance(a: float, b: float, frames: int, located: int) -> float:
    """Log of the probability that so many of a run's frames are located, when shares are Beta(a, b)."""

    def log_beta(x: float, y: float) -> float:
        return math.lgamma(x) + math.lgamma(y) - math.lgamma(x + y)

    ways = -math.log(frames + 1.0) - log_beta(located + 1.0, frames - located + 1.0)
    return ways + log_beta(located + a, frames - located + b) - log_beta(a, b)


def drawn_runs(setting: RunSetting, runs: int) -> list[list[RunImage]]:
    """So many runs for a first view, always the same."""
    rng = np.random.default_rng(0)
    return [draw_run(setting, IMAGES, rng) for _ in range(runs)]

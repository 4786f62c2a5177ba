# SPDX-License-Identifier: Apache-2.0
"""Every number that the core needs and that is neither physics nor numerical tolerance, in one table, to be fitted to data.

Their values stand in `numbers.json` beside this file, each with the interval that a fit left it and the script that made it.
"""

from __future__ import annotations

import json
import math
import os
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path

from grasptrack.errors import InputError


@dataclass(frozen=True)
class Numbers:
    """The core's free numbers.

    Lengths in work px: px of the reference view, reduced so that the object's sqrt(area) is at most `work_size`.

    Attributes:
        work_size: px, see above.
        edge_missed: probability that an edge that is there is not found.
        same_sign: probability that an edge's contrast keeps its sign.
        edge_floor: work px, within which an edge counts as the expected one.
        edge_noise: work px, least noise of an edge; more is measured.
        other_spread: grey levels, by which what lies inside somebody else's edge differs from what lies inside the object's.
        share_object, share_occluded, share_other: prior shares of the outline.
        cover_power: the more of the outline is covered the less probable: power of the share that is not.
        elsewhere_power: the same of edges that lie elsewhere.
        stretch: mean length of an occluded stretch, as a share of the outline.
        sample_distance: work px of the outline that carry one independent measurement.
        blur_share: half of an edge's blur, as a share of what moved across it since the last image.
        wide: how far round the answer edges are looked for, as a share of sqrt(area).
        elsewhere: share of the outline found elsewhere that asks for a second solution.
        cell_unlikely: share of the cells beside the outline whose grey level nothing explains.
        cell_far: share of sqrt(area) along the outline within which its edge must be seen on both sides, to tell.
        cell_power: how much the agreement of a sample's cells counts: that of the least sure of what a shape asks for.
        cell_cover: grey levels, by which what covers a side of the outline differs from it.
        texture_floor: pixels of a patch's own level, error that the model does not explain.
        texture_independent: patches that carry one independent measurement.
        texture_freedom: degrees of freedom of the t distribution of a patch's error.
        texture_contrast: gradients of a patch over those of noise alone, for it to be texture.
        texture_occluded: probability that a patch is covered, changed or glaring.
        match_spread, chance_spread: of a patch's correlation, from 1 where it is the same, from 0 where it is not.
        patch_share: patches that count as one in the odds.
        prior_freedom: degrees of freedom of the prior of the pose: predictions can be plainly wrong.
        drift, stretch_rate, tilt_rate: process noise a frame of position, shape and perspective, as shares of sqrt(area).
        predicted: share of that noise that remains when texture predicts the motion.
        perspective: perspective terms stay below about this share of the half size.
        focal_sd: of the log of the focal length about one image width.
        calibrated_sd: of the same about that of a calibration.
        normal_sd: scale of the slopes of the first view's normal about frontal, of a t distribution of as many degrees of
            freedom as the prior of the pose.
        pinhole_sd: how far real cameras are from a pinhole, of the pose's two invariants.
        pinhole_freedom: degrees of freedom of the t distribution of that.
        new_view: way, as a share of sqrt(area), after which a view tells anew of camera and thickness: near views err alike.
        rolling: probability that rows are exposed one after another.
        readout_sd: of the share of the time between two images in which they are then read out; below 0 from the last row on.
        sides: prior probability that a thick part's sides are seen as the object.
        thickness_sd: prior, as a share of sqrt(area).
        hazard: probability a frame that what was the object is it no longer.
        redetected: least prior that it is in view.
        exchanged: probability that something else with nearly its outline, or nearly its surface, lies in its place.
        same_surface: probability that something of another outline shows the object's own surface.
        same_shape: probability that another outline does not show beside what is seen of the object's own.
        lookalike: probability that something just like it is at a given other place, as long as none was seen.
        deceived: probability that the outline shows an object a little beside where it is, as in blur or along other edges.
        misled: probability that the first outline is wrong somewhere, as by a shadow, though its image does not say so.
        taken: probability that what rested was taken along by what hid it.
        travel: px a frame that an unseen object may have gone, as a share of sqrt(area).
        turn: rad a frame that it may have turned unseen.
        swell: share a frame by which its size may have changed unseen where the ground does not tell the camera's distance.
        temper: of log-likelihoods: samples and patches are less independent than counted.
        inflate: of the standard deviations: what the model still does not know.
        exposed: standard deviation of when a contact was exposed, as a share of the time between two images: what moves is
            known no better, as rows are read out one after another and hands turn back while the shutter is open.
        risk: probability of being wrong below which an answer is believed: the user's, see `with_risk` and `learning`.
        tolerance, tolerance_px: an answer is wrong if a contact is off by more than this share of sqrt(area) and so many px.
    """

    work_size: float
    edge_missed: float
    same_sign: float
    edge_floor: float
    edge_noise: float
    other_spread: float
    share_object: float
    share_occluded: float
    share_other: float
    cover_power: float
    elsewhere_power: float
    stretch: float
    sample_distance: float
    blur_share: float
    wide: float
    elsewhere: float
    cell_unlikely: float
    cell_far: float
    cell_power: float
    cell_cover: float
    texture_floor: float
    texture_independent: float
    texture_freedom: float
    texture_contrast: float
    texture_occluded: float
    match_spread: float
    chance_spread: float
    patch_share: float
    prior_freedom: float
    drift: float
    stretch_rate: float
    tilt_rate: float
    predicted: float
    perspective: float
    focal_sd: float
    calibrated_sd: float
    normal_sd: float
    pinhole_sd: float
    pinhole_freedom: float
    new_view: float
    rolling: float
    readout_sd: float
    sides: float
    thickness_sd: float
    hazard: float
    redetected: float
    exchanged: float
    same_surface: float
    same_shape: float
    lookalike: float
    deceived: float
    misled: float
    taken: float
    travel: float
    turn: float
    swell: float
    temper: float
    inflate: float
    exposed: float
    risk: float
    tolerance: float
    tolerance_px: float

    def table(self) -> dict[str, float]:
        """By name, as the kernel takes them."""
        return asdict(self)

    def with_risk(self, risk: float) -> Numbers:
        """The same for answers that may be wrong with a probability below `risk`.

        Raises:
            InputError: not between 0 and 1.
        """
        return replace(self, risk=check_risk(risk))

    def learning(self, risk: float) -> Numbers:
        """The same for learning from images whose answers may be wrong with a probability below `risk`.

        What the user takes at a higher risk is given out, but teaches nothing: doubt must not become habit.

        Raises:
            InputError: not between 0 and 1.
        """
        return self.with_risk(min(self.risk, check_risk(risk)))


OWN = Path(__file__).with_name("numbers.json")
"""The values that the package comes with."""
VARIABLE = "GRASPTRACK_NUMBERS"
"""Environment variable that names another file of values, as `research.studies.calibration` writes them."""


def read_numbers(path: Path = OWN) -> Numbers:
    """The numbers of a file: JSON, {name: {"value": number, ...}, ...}, with every name and no other.

    Raises:
        InputError: no such file, no JSON, a name that is missing or unknown, or a value that is no finite number.
    """
    try:
        told = json.loads(path.read_text(encoding="utf-8"))
        values = {str(name): float(entry["value"]) for name, entry in told.items()}
    except (OSError, ValueError, AttributeError, KeyError, TypeError) as error:
        raise InputError(f'cannot read the numbers in "{path}": {error!r}', path=str(path)) from error
    names = [field.name for field in fields(Numbers)]
    for name in [*(n for n in names if n not in values), *(v for v in values if v not in names)]:
        what = "is missing" if name in names else "is no number of the core"
        raise InputError(f'"{path}": {name} {what}', path=str(path), name=name)
    for name, value in values.items():
        if not math.isfinite(value):
            raise InputError(f'"{path}": {name} must be a finite number, not {value}', path=str(path), name=name)
    return Numbers(**values)


NUMBERS = read_numbers(Path(os.environ.get(VARIABLE) or OWN))

DEFAULT_RISK = NUMBERS.risk
"""Probability below which an answer may be wrong, where nobody says."""


def check_risk(risk: float, name: str = "risk") -> float:
    """The probability below which an answer may be wrong.

    Args:
        risk: the probability.
        name: as the message names it.

    Raises:
        InputError: not between 0 and 1.
    """
    if not 0.0 < risk < 1.0:
        raise InputError(f"{name} must be a probability between 0 and 1, not {risk:g}", risk=risk)
    return risk

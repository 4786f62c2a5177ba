# SPDX-License-Identifier: Apache-2.0
"""Every number that the core needs and that is neither physics nor numerical tolerance, in one table, to be fitted to data.

Their values stand in `numbers.json` beside this file, each with its unit and meaning, and, where a script fitted it, that
script and the interval that the data left.
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
    """The core's free numbers: `numbers.json` and docs/numbers.md tell the unit and the meaning of each.

    Lengths in work px: px of the reference view, reduced so that the object's sqrt(area) is at most `work_size`.
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
    fixed: float
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
    untested: float
    apart: float
    apart_power: float
    contradicted: float
    witness_fails: float
    unseen_s: float
    unseen_px: float

    def kernel_table(self) -> dict[str, float]:
        """By name, as the kernel takes them."""
        return asdict(self)

    def with_risk(self, risk: float) -> Numbers:
        """The same for answers that may be wrong with a probability below `risk`.

        Raises:
            InputError: not between 0 and 1.
        """
        return replace(self, risk=check_risk(risk))

    def for_learning(self, risk: float) -> Numbers:
        """The same for learning from images whose answers may be wrong with a probability below `risk`.

        What the user takes at a higher risk is given out, but teaches nothing: doubt must not become habit.

        Raises:
            InputError: not between 0 and 1.
        """
        return self.with_risk(min(self.risk, check_risk(risk)))

    def with_tolerance(self, share: float) -> Numbers:
        """The same where a contact may be off by this share of sqrt(area), in whatever size it is seen."""
        return replace(self, tolerance=share, tolerance_px=0.0)


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

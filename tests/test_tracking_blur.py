# SPDX-License-Identifier: Apache-2.0
"""What the core measures of the first view."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from grasptrack.contour import Contour, View
from grasptrack.tracking.numbers import NUMBERS
from grasptrack.tracking.target import Target, make_target, pyramid
from scenery import L_PLATE, drawn

CONTACTS = np.array([[-20.0, 25.0], [-70.0, 25.0]])
TURN = 0.3


def placed(points: np.ndarray, centre: tuple[float, float] = (160.0, 120.0), angle: float = TURN) -> np.ndarray:
    """(n, 2) px of points of the plate, as `drawn` places them."""
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points @ np.array([[c, s], [-s, c]]) + centre)


def outline(centre: tuple[float, float] = (160.0, 120.0)) -> View:
    corners = np.vstack([placed(L_PLATE, centre), placed(L_PLATE, centre)[:1]])
    sides = [np.linspace(a, b, math.ceil(math.dist(a, b)), endpoint=False) for a, b in itertools.pairwise(corners)]
    return View(Contour(np.vstack(sides)))


def target(centre: tuple[float, float] = (160.0, 120.0), **look: float) -> Target:
    image = drawn(L_PLATE, centres=(centre,), angle=TURN, **look)  # type: ignore[arg-type]
    return make_target(pyramid(image), outline(centre), placed(CONTACTS, centre), NUMBERS)


@pytest.mark.parametrize("shift", [0.0, 0.25, 0.5, 0.75])
def test_noise_is_that_of_the_pixels_wherever_the_object_lies(shift: float) -> None:
    """It was measured between them, where interpolation takes most of it: noise passed for a surface."""
    made = target((160.0 + shift, 120.0 + shift), noise=8.0)
    assert made.noise == pytest.approx(8.0, rel=0.15) and made.counts == (0, 0, 0)

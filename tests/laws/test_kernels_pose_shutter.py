# SPDX-License-Identifier: Apache-2.0
"""What a rolling shutter bends, as the kernel that fits poses allows for it and tells of it."""

import math

import numpy as np
import pytest
from hypothesis import given

from posed import (
    CONTACTS,
    FREE,
    NOISY,
    SEEDS,
    A,
    Floats,
    bent,
    carried,
    draw,
    known,
    native,
    pyramid,
    question,
    target,
    view,
)

SHARE = 0.6
"""Readout of the images here."""


def bend_of(rng: np.random.Generator) -> Floats:
    """(3, 8) of an object that turns and swells while its rows are read; none of it at the contacts' middle."""
    bend = np.zeros((3, 8))
    bend[1:, 2:6] = rng.uniform(0.5, 1.0, (2, 4)) * rng.choice([-1.0, 1.0], (2, 4))
    return bend


def free(bend: Floats, share: float) -> dict[str, object]:
    """Of a question: nothing is known of the pose's shape nor of the camera."""
    return {"P": known(3.0, 2.0), "bend": bend, "readout": share}


@NOISY
@pytest.mark.parametrize("textured", [True, False])
def test_a_bend_that_is_known_moves_no_pose(seed: int, textured: bool) -> None:
    rng = np.random.default_rng(seed)
    G, bend = view(rng, 0.4), bend_of(rng)
    made = target(native, seed, textured=textured)
    levels = pyramid(draw(G, seed, textured=textured, bend=SHARE * bend))
    known_, unknown = (made.solve(**question(levels, **free(bend, share))) for share in (SHARE, 0.0))
    assert known_.valid and np.abs(carried(known_.G, CONTACTS) - carried(G, CONTACTS)).max() < 0.25
    assert known_.edge_sigma < unknown.edge_sigma


@pytest.mark.sampled(12)
@NOISY
@pytest.mark.parametrize("textured", [True, False])
@pytest.mark.parametrize("share", [-SHARE, 0.0, SHARE])
def test_an_image_tells_the_readout(seed: int, textured: bool, share: float) -> None:
    rng = np.random.default_rng(seed)
    G, bend = view(rng, 0.4), bend_of(rng)
    levels = pyramid(draw(G, seed, textured=textured, bend=share * bend))
    found = target(native, seed, textured=textured).solve(**question(levels, **free(bend, share)))
    assert 0.0 < found.readout_variance < 0.15**2
    assert abs(found.readout - share) < max(0.08, 4.0 * math.sqrt(found.readout_variance))


@NOISY
def test_a_readout_that_is_not_known_yet_is_told_from_none(seed: int) -> None:
    rng = np.random.default_rng(seed)
    G, bend = view(rng, 0.4), bend_of(rng)
    levels = pyramid(draw(G, seed, textured=False, bend=SHARE * bend))
    made, told = target(native, seed, textured=False), 0.0
    for _ in range(5):  # as image after image
        told = made.solve(**question(levels, **free(bend, told))).readout
    assert told == pytest.approx(SHARE, abs=0.15)


def test_how_the_pose_depends_on_the_readout() -> None:
    """Of many images together: samples that contradict the others count less, which makes it less."""
    told, moved = [], []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        G, bend, step = view(rng, 0.4), bend_of(rng), 0.2
        made = target(native, seed, textured=False)
        levels = pyramid(draw(G, seed, noise=0.5, textured=False, bend=SHARE * bend))
        low, here, high = (made.solve(**question(levels, G, **free(bend, SHARE + way))) for way in (-step, 0.0, step))
        J = np.array([[bent_by(k, place) for k in range(8)] for place in CONTACTS]).transpose(0, 2, 1)
        told.append(J @ here.by_readout)
        moved.append(J @ made.difference(low.G, high.G) / (2.0 * step))
    each, found = np.ravel(told), np.ravel(moved)
    assert 0.85 < each @ found / (each @ each) < 1.15
    assert np.corrcoef(each, found)[0, 1] > 0.9


def bent_by(k: int, place: Floats) -> Floats:
    """(2,) derivatives of a place by the pose's error's number k."""
    bend = np.zeros((3, 8))
    bend[0, k] = 1.0
    return bent(bend, place[None])[0]


@given(SEEDS)
def test_what_does_not_bend_tells_nothing(seed: int) -> None:
    """Nor does a bend that a pose's error makes as well."""
    rng = np.random.default_rng(seed)
    made, levels = target(native, seed, **FREE), pyramid(draw(view(rng, 0.4), seed))
    still = made.solve(**question(levels, readout=0.3))
    assert still.readout_variance == math.inf and still.readout == 0.3
    assert not still.by_readout.any()
    bend = np.zeros((3, 8))
    bend[1:, :2] = rng.uniform(-3.0, 3.0, (2, 2))  # a shear
    sheared = made.solve(**question(levels, **free(bend, 0.0)))
    assert sheared.readout_variance > 0.05


def test_a_bend_has_three_times_eight_numbers() -> None:
    made, levels = target(native, 0), pyramid(draw(A, 0))
    with pytest.raises(ValueError, match="bend"):
        made.solve(**question(levels, bend=np.zeros(8)))

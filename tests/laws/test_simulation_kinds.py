# SPDX-License-Identifier: Apache-2.0
"""Scenes of a bench: their edges lie on the truth, a codec gives back what it got, pixels need not be square."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from edges import flat, offsets
from grasptrack_bench.simulation import SHAPES, Pinhole, Scene, tilting_path
from grasptrack_bench.simulation.codec import Codec, through_codec
from test_simulation_disturbances import SMALL, scene

EVEN = {"noise": 0.0, "vignette": 0.0, "drift": 0.0, "exposure": 0.0}
EDGED = ["h264", "h265", "cheap-camera", "focus", "aspect", "hand-camera", "pushed", "touching"]


@pytest.mark.parametrize("name", EDGED)
def test_edges_lie_on_the_truth(name: str) -> None:
    made = scene(name, "notched-plate", 12, 2, surface=flat(60), table=flat(180)).with_conditions(**EVEN)
    off = np.concatenate([offsets(made[i].image, made[i].outline, 60, 180, reach=14.0) for i in (0, 5, 11)])
    assert len(off) > 150 and abs(off.mean()) < 0.25 and np.abs(off).max() < 1.0


@given(st.floats(0.8, 1.25), st.floats(-0.2, 0.1), st.integers(0, 9))
def test_pixels_that_are_not_square_keep_the_way_back(aspect: float, k1: float, seed: int) -> None:
    camera, square, wide = Pinhole(k1=k1, aspect=aspect), Pinhole(k1=k1), np.array([aspect, 1.0])
    points, middle = np.random.default_rng(seed).uniform(20.0, 460.0, (40, 2)), square.matrix[:2, 2]
    assert np.abs(camera.undistort(camera.distort(points)) - points).max() < 1e-6
    seen = (camera.distort(points) - middle) * wide
    assert np.abs(square.distort(middle + (points - middle) * wide) - middle - seen).max() < 1e-6


@pytest.mark.parametrize("name", ["libx264", "libx265"])
def test_a_codec_gives_back_as_many_images_somewhat_worse(name: str) -> None:
    images = [frame.image for frame in scene("clean-6dof", frames=5, size=(321, 239), colour=True)]
    square = [
        np.mean((a - b.astype(float)) ** 2)
        for a, b in zip(images, through_codec(images, Codec(name, 30.0)), strict=True)
    ]
    assert all(26.0 < 10.0 * np.log10(255.0**2 / s) < 45.0 for s in square)


def test_an_opaque_part_at_rest_is_as_before_and_pieces_part() -> None:
    plain = [Scene(SHAPES["gear"](), tilting_path(3), moves=m)[2].image for m in (None, np.zeros((3, 3)))]
    assert (plain[0] == plain[1]).all()
    first, frame = (scene("two-bodies", frames=20, size=SMALL)[i] for i in (0, 10))
    ring = first.outline[0]
    apart = np.hypot(*(frame.carry(ring) - frame._map_points(frame.H_current_reference, ring)).T)
    assert 0.1 < (apart == 0.0).mean() < 0.9 and apart.max() > 2.0

# SPDX-License-Identifier: Apache-2.0
"""A grasp in two rendered images without a prior: any turn, strong tilt, other scale."""

import math

import numpy as np
import pytest

from grasptrack.errors import AmbiguousError, TransferError
from grasptrack.pair import REGISTRATION, carry_to
from grasptrack.projective import apply_homography
from grasptrack.simulation import SHAPES, Camera, Conditions, Path, Scene
from grasptrack.synthesis import synthesize
from grasptrack.transfer import STRATEGIES
from test_matching import seen

CAMERA = Camera(480, 360, focal=416.0)
NEAR, FAR = 0.5, 0.25
"""Shares of the view that the part fills."""


def scene(shape, turn, tilt, share, azimuth=1.0):
    """Two images: from the front, and turned, tilted, from another distance."""
    distance = [2.0 * shape.radius() * CAMERA.matrix[0, 0] / (s * CAMERA.width) for s in (0.4, share)]
    path = Path(np.zeros((2, 2)), *(np.array(v) for v in (distance, [0.0, turn], [0.0, tilt], [0.0, azimuth])))
    return Scene(shape, path, camera=CAMERA, conditions=Conditions(), seed=3), path.table_to_image(CAMERA)


def reference(shape, H, friction=0.5):
    view = seen(shape, H, noise=0.0)
    return view, synthesize(view, 2, friction, top=1)[0]


@pytest.mark.parametrize(
    ("name", "turn", "tilt", "share"),
    [("bracket", 2.6, 0.0, NEAR), ("key", 4.0, 55.0, NEAR), ("gasket", 1.0, 40.0, FAR), ("hook", 3.1, 50.0, 0.4)],
)
def test_any_turn_tilt_and_scale(name, turn, tilt, share):
    shape = SHAPES[name]()
    both, H = scene(shape, turn, math.radians(tilt), share)
    view, grasp = reference(shape, H[0])
    pair = carry_to(grasp, view, both[0].image, both[1].image, 0.5)
    first = pair.outcomes[0]
    assert [o.strategy for o in pair.outcomes] == [REGISTRATION, *STRATEGIES]
    assert first.reason == "" and not pair.turns and pair.found.status == "matched"
    truth = apply_homography(H[1] @ np.linalg.inv(H[0]), grasp.contacts)
    assert np.hypot(*(first.contacts - truth).T).max() < 1.0
    np.testing.assert_allclose(apply_homography(first.homography, grasp.contacts), first.contacts, atol=1e-6)
    assert first.analysis.stable


def test_the_other_turns_of_a_symmetric_part_are_told():
    shape = SHAPES["square"]()
    both, H = scene(shape, 0.2, 0.1, 0.4)
    view, grasp = reference(shape, H[0])
    pair = carry_to(grasp, view, both[0].image, both[1].image, 0.5)
    assert pair.found.status == "ambiguous"
    np.testing.assert_allclose(np.sort(np.abs(pair.turns)), [90, 90, 180], atol=3)
    truth = apply_homography(H[1] @ np.linalg.inv(H[0]), grasp.contacts)
    assert np.hypot(*(pair.outcomes[0].contacts - truth).T).max() < 1.0  # the smallest turn


def test_a_disc_is_refused_and_so_is_another_object():
    disc, key = SHAPES["disc"](), SHAPES["key"]()
    both, H = scene(disc, 0.2, 0.3, 0.4)
    view, grasp = reference(disc, H[0])
    with pytest.raises(AmbiguousError, match="every turn"):
        carry_to(grasp, view, both[0].image, both[1].image, 0.5)
    other, K = scene(key, 0.0, 0.0, 0.4)
    view, grasp = reference(key, K[0])
    with pytest.raises(TransferError, match="no object with this outline"):
        carry_to(grasp, view, other[0].image, both[1].image, 0.5)

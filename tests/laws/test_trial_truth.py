# SPDX-License-Identifier: Apache-2.0
"""What is said of a closing is the truth's word, not the tracker's."""

from importlib.util import find_spec

import numpy as np
import pytest

from grasptrack.geometry.homographies import apply_homography
from grasptrack.tracking.numbers import NUMBERS
from grasptrack_bench.approach.case import Row
from grasptrack_bench.approach.truth import on_part, record_closing_errors
from grasptrack_bench.simulation import SHAPES

if find_spec("mujoco") is None:
    pytest.skip("the physical world needs MuJoCo", allow_module_level=True)


def told(shift: tuple[float, float], chosen_off: float = 0.0) -> Row:
    """A row of a closing whose contacts lie `shift` px from the chosen ones, which lie so many sqrt(area) off the outline."""
    from grasptrack_bench.physics import World

    world, row = World(SHAPES["bracket"](), seed=3, images="planar"), Row(3, "bracket", "static", "gantry", "online")
    ring = world.shape.polygons[0] * world.setting.part.size
    contacts = apply_homography(world.outline_to_image(), ring[[0, len(ring) // 2]])
    chosen = on_part(world, contacts)
    np.testing.assert_allclose(chosen, ring[[0, len(ring) // 2]], atol=1e-9)
    away = chosen - ring.mean(axis=0)
    chosen = chosen + chosen_off * world.setting.part.size * away / np.hypot(*away.T)[:, None]
    record_closing_errors(row, world, chosen, apply_homography(world.outline_to_image(), chosen) + np.array(shift))
    return row


def test_right_is_what_lies_where_it_was_chosen() -> None:
    assert told((0.0, 0.0)).right and told((1.5, -2.0)).right
    assert told((1.5, -2.0)).contact_error_px == pytest.approx(2.5, abs=1e-6)


def test_wrong_is_what_has_slipped_or_was_never_on_the_part() -> None:
    assert told((20.0, 0.0)).right is False
    assert told((0.0, 0.0), chosen_off=3.0 * NUMBERS.tolerance + 0.1).right is False

# SPDX-License-Identifier: Apache-2.0
"""Force closure against a linear programme, and the laws of friction."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from closure import programme
from grasptrack import kernels


@st.composite
def grasps(draw, fingers=(2, 5)):
    """Contacts around an object, their normals inward within some 40 degrees, and a friction."""
    k = draw(st.integers(*fingers))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    around = 2 * np.pi * (np.arange(k) + rng.uniform(-0.3, 0.3, k)) / k
    contacts = np.column_stack([np.cos(around), np.sin(around)]) * rng.uniform(0.5, 1.5, (k, 1))
    lean = around + math.pi + rng.uniform(-0.7, 0.7, k)
    return contacts, np.column_stack([np.cos(lean), np.sin(lean)]), float(rng.uniform(0.0, 1.2))


@given(grasps())
def test_closure_agrees_with_a_linear_programme(grasp):
    contacts, normals, friction = grasp
    epsilon, angle = kernels.force_closure(contacts, normals, 0.05, -0.1, 0.8, friction)
    weight = programme(contacts, normals, np.array([0.05, -0.1]), 0.8, friction)
    assume(abs(weight) > 1e-7)
    assert (epsilon > 1e-9) == (weight > 0)
    assert (epsilon > 1e-9) == (math.atan(friction) > angle + 1e-8)


@given(grasps(), st.floats(0.0, 1.0))
def test_more_friction_never_hurts(grasp, more):
    contacts, normals, friction = grasp
    low, angle = kernels.force_closure(contacts, normals, 0.0, 0.0, 1.0, friction)
    high, same = kernels.force_closure(contacts, normals, 0.0, 0.0, 1.0, friction + more)
    assert angle == same
    if low > 0:
        assert high >= low - 1e-9


@given(grasps(), st.floats(-3, 3), st.floats(0.1, 10))
def test_unchanged_by_similarities(grasp, turn, scale):
    contacts, normals, friction = grasp
    c, s = math.cos(turn), math.sin(turn)
    R = np.array([[c, s], [-s, c]])
    a = kernels.force_closure(contacts, normals, 0.0, 0.0, 1.0, friction)
    b = kernels.force_closure(scale * contacts @ R, normals @ R, 0.0, 0.0, scale, friction)
    assert b[1] == pytest.approx(a[1], abs=1e-8)
    # Forces are measured with a round ball: turning the axes does not change it.
    assert b[0] == pytest.approx(a[0], abs=1e-9)


def test_two_fingers_exactly():
    contacts = np.array([[-1.0, 0.0], [1.0, 0.3]])
    squeeze, spread = np.array([[1.0, 0], [-1, 0]]), np.array([[-1.0, 0], [1, 0]])
    for normals in (squeeze, spread):
        assert kernels.force_closure(contacts, normals, 0, 0, 1, 0.5).friction_angle == pytest.approx(
            math.atan2(0.3, 2.0)
        )
    same_way = np.array([[1.0, 0], [1.0, 0]])
    epsilon, angle = kernels.force_closure(contacts, same_way, 0, 0, 1, 0.5)
    assert angle == math.pi / 2 and epsilon <= 0
    assert kernels.force_closure(contacts, squeeze, 0, 0, 1, 0.0).epsilon == 0.0

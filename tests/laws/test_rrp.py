# SPDX-License-Identifier: Apache-2.0
"""RRP coordinates: printed as the paper prints them, reversible with error 0, exact under similarities."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.errors import StrategyError
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography, similarity_transform
from grasptrack.grasp.contacts import Grasp
from grasptrack.transfer import rrp


def blob(seed: int, n: int = 120) -> Contour:
    rng = np.random.default_rng(seed)
    t = np.arange(n) * (2 * math.pi / n)
    r = 100 + sum(rng.uniform(-8, 8) * np.cos(k * t + rng.uniform(0, 6)) for k in range(1, 6))
    return Contour(np.column_stack([320 + r * np.cos(t), 240 + 0.7 * r * np.sin(t)]))


def similar(contour: Contour, scale: float, angle: float, x: float, y: float) -> Contour:
    H = similarity_transform(scale, angle, (0.0, 0.0), (x, y))
    return Contour(apply_homography(H, contour.points), hole=contour.hole)


poses = st.tuples(st.floats(0.2, 5.0), st.floats(-math.pi, math.pi), st.floats(-400, 400), st.floats(-400, 400))
places = st.lists(st.floats(0, 119.999), min_size=2, max_size=5)


def grasp_at(contour: Contour, positions: list[float]) -> Grasp:
    points = contour.points
    i = np.array(positions).astype(int)
    f = (np.array(positions) - i)[:, None]
    return Grasp(points[i] + f * (points[(i + 1) % len(points)] - points[i]))


@given(st.integers(0, 10_000), poses, places)
def test_exact_under_similarities(seed: int, pose: tuple[float, float, float, float], positions: list[float]) -> None:
    reference = blob(seed)
    grasp = grasp_at(reference, positions)
    current = similar(reference, *pose)
    carried = rrp.apply(rrp.describe(grasp, reference), current).grasp
    truth = apply_homography(similarity_transform(*pose[:2], (0.0, 0.0), pose[2:]), grasp.contacts)
    assert np.abs(carried.contacts - truth).max() <= 1e-6 * math.sqrt(current.area)


@given(st.integers(0, 10_000), poses, places)
def test_reversible_with_error_zero(seed: int, pose: tuple[float, float, float, float], positions: list[float]) -> None:
    reference = blob(seed)
    current = similar(reference, *pose)
    grasp = rrp.apply(rrp.describe(grasp_at(reference, positions), reference), reference).grasp
    there = rrp.apply(rrp.describe(grasp, reference), current).grasp
    back = rrp.apply(rrp.describe(there, current), reference).grasp
    assert np.array_equal(back.contacts, grasp.contacts)


def test_description_unchanged_by_a_transfer() -> None:
    """Table III: the coordinates stay the same while the contacts move."""
    reference = blob(3)
    current = similar(reference, 1.3, 0.7, 20.0, -50.0)
    before = rrp.describe(grasp_at(reference, [14.5, 77.25, 119.5]), reference)
    after = rrp.describe(rrp.apply(before, current).grasp, current)
    assert np.array_equal(before.places[:, :2], after.places[:, :2])
    assert before.paper() == after.paper()


def test_coordinates_are_the_papers() -> None:
    """Table IV: p = 6 ref + interp."""
    contour = blob(0, 300)
    description = rrp.describe(Grasp(contour.points[[152, 37]]), contour)
    assert description.paper() == [(0, 25, 2), (0, 6, 1)]
    assert description.places[:, :2] == pytest.approx(np.array([[0.0, 152.0], [0.0, 37.0]]))
    assert repr(description) == "RRP((0, 25, 2) (0, 6, 1))"


def test_interp_is_real_inside_and_printed_as_an_integer() -> None:
    contour = blob(0)
    description = rrp.describe(grasp_at(contour, [13.75, 119.75]), contour)
    assert description.places[:, 1] % 6 == pytest.approx([1.75, 5.75])
    assert description.paper() == [(0, 2, 2), (0, 0, 0)]


def test_contacts_on_holes() -> None:
    outer = blob(1)
    t = np.arange(24) / 4
    hole = Contour(np.column_stack([320 + 20 * np.cos(t), 240 + 20 * np.sin(t)]), hole=True)
    view = View([outer, hole])
    description = rrp.describe(Grasp([outer.points[30], hole.points[7]]), view)
    assert description.places[:, 0].tolist() == [0, 1]
    moved = View([similar(c, 0.8, -1.0, 5.0, 6.0) for c in view.contours])
    contacts = rrp.apply(description, moved).grasp.contacts
    assert np.allclose(contacts, [moved.contours[0].points[30], moved.contours[1].points[7]], atol=1e-6)


def test_quality_is_kept_and_nothing_is_claimed_besides() -> None:
    contour = blob(2)
    result = rrp.apply(rrp.describe(Grasp(contour.points[:2], 0.5), contour), contour)
    assert result.grasp.quality == 0.5
    assert result.homography is None and result.covariance is None and math.isnan(result.residual)


def test_unequal_counts_are_refused() -> None:
    reference = blob(2)
    description = rrp.describe(Grasp(reference.points[[0, 60]]), reference)
    with pytest.raises(StrategyError, match="correspond one to one, not contours of 120 and 119 points") as error:
        rrp.apply(description, blob(2, 119))
    assert error.value.values["current"] == [0, 119]

# SPDX-License-Identifier: Apache-2.0
"""The chance that a grasp closes: against its plain definition, contacts drawn and slid along the outline."""

import itertools
import math
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack import kernels
from grasptrack.errors import ConditioningError, GraspError, InputError
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography, homography_jacobian, similarity_transform
from grasptrack.grasp.closure_probability import ClosureCheck, chance_of_closing
from grasptrack.grasp.contact_regions import Regions, epsilon_quality, regions_of
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.force_closure import analyze
from grasptrack.grasp.synthesis import synthesize
from grasptrack_bench.method import outline_of
from grasptrack_bench.simulation import SHAPES
from research.studies.closure_probability import closes_after, closes_at, sample_covariances

SIZE, FRICTION = 175.0, 0.5
TILTED = np.array([[0.9, 0.2, 10.0], [-0.15, 1.1, 5.0], [3e-4, -2e-4, 1.0]])
NAMES = ("bracket", "hook", "gear", "gasket", "blob")


@lru_cache
def part(name: str) -> View:
    return outline_of(polygon * SIZE + (320.0, 240.0) for polygon in SHAPES[name]().polygons)


@lru_cache
def chosen(name: str, fingers: int) -> tuple[View, Grasp, Regions]:
    """The tenth of the grasps, which has less to spare than the first."""
    view = part(name)
    grasp = synthesize(view, fingers, FRICTION, None, 10)[-1]
    return view, grasp, regions_of(grasp, view, FRICTION)


def closes(view: View, regions: Regions, slips: np.ndarray) -> np.ndarray:
    return closes_after(view, regions.contacts, slips, FRICTION)


@pytest.mark.parametrize("fingers", [2, 3])
@pytest.mark.parametrize("name", NAMES)
def test_everything_within_the_regions_closes(name: str, fingers: int) -> None:
    view, _, regions = chosen(name, fingers)
    rng = np.random.default_rng(1)
    inner = rng.uniform(-regions.back, regions.ahead, (250, fingers))
    corners = np.array(list(itertools.product(*zip(-regions.back, regions.ahead, strict=True))))
    assert closes(view, regions, np.concatenate([inner, 0.999 * corners])).all()
    assert (regions.back + regions.ahead > 0.0).all()


@pytest.mark.parametrize("friction", [0.2, 0.5, 0.8])
def test_across_a_bar_and_a_disc_the_regions_are_those_of_geometry(friction: float) -> None:
    across = 60.0  # contacts on parallel sides close while they are less than friction times the distance apart
    bar = np.array([[0.0, 0.0], [400.0, 0.0], [400.0, across], [0.0, across]])
    sides = [np.linspace(p, q, 200, endpoint=False) for p, q in zip(bar, np.roll(bar, -1, axis=0), strict=True)]
    found = regions_of(Grasp([[200.0, 0.0], [200.0, across]]), Contour(np.concatenate(sides)), friction)
    assert np.allclose([found.back, found.ahead], 0.5 * friction * across, atol=2.0)
    angles = np.arange(720) * math.pi / 360.0
    disc = Contour(200.0 + 100.0 * np.column_stack([np.cos(angles), np.sin(angles)]))
    found = regions_of(Grasp([[100.0, 200.0], [300.0, 200.0]]), disc, friction)
    assert np.allclose(
        [found.back, found.ahead], min(100.0 * math.atan(friction), 0.3 * math.sqrt(math.pi) * 100.0), atol=3.5
    )


def test_a_grasp_that_does_not_close_has_no_regions() -> None:
    view = part("bracket")
    grasp = Grasp([view.outer.points[0], view.outer.points[5]])
    regions = regions_of(grasp, view)
    assert not regions.back.any() and not regions.ahead.any()
    assert chance_of_closing(regions, np.array([np.eye(2)] * 2)) == 0.0


def test_no_contact_may_slip_to_where_the_object_is_cut() -> None:
    points = part("bracket").outer.points
    free = View(Contour(points))
    grasp = synthesize(free, 2)[0]
    wide = regions_of(grasp, free)
    cut = np.hypot(*(points - grasp.contacts[0]).T) > 6.0
    narrow = regions_of(grasp, View(Contour(points, clipped=cut)))
    assert max(narrow.back[0], narrow.ahead[0]) < 7.0 < max(wide.back[0], wide.ahead[0])


@given(st.floats(-3.0, 3.0), st.floats(0.3, 3.0), st.floats(-100.0, 100.0))
def test_regions_turn_and_grow_with_the_part(angle: float, scale: float, shift: float) -> None:
    view, grasp, regions = chosen("bracket", 2)
    H = similarity_transform(scale, angle, (0.0, 0.0), (shift, -shift))
    moved = View([contour.transformed(H) for contour in view.contours])
    there = regions_of(Grasp(apply_homography(H, grasp.contacts)), moved, FRICTION)
    assert np.allclose(there.back, scale * regions.back, rtol=0.08, atol=0.01 * scale * SIZE)
    assert np.allclose(there.ahead, scale * regions.ahead, rtol=0.08, atol=0.01 * scale * SIZE)


def test_the_depth_of_a_hull_is_the_kernels_epsilon() -> None:
    rng = np.random.default_rng(0)
    for _ in range(60):
        arms, angles = rng.normal(size=(3, 2)), rng.uniform(0.0, 2.0 * math.pi, 3)
        normals = np.column_stack([np.cos(angles), np.sin(angles)])
        tangents = np.column_stack([-normals[:, 1], normals[:, 0]])
        forces = np.concatenate([normals + FRICTION * tangents, normals - FRICTION * tangents])
        both = np.concatenate([arms, arms])
        w = np.column_stack([forces, both[:, 0] * forces[:, 1] - both[:, 1] * forces[:, 0]])
        epsilon, _ = kernels.force_closure(arms, normals, 0.0, 0.0, 1.0, FRICTION)
        assert epsilon_quality(w[None])[0] == pytest.approx(epsilon, abs=1e-9)


@pytest.mark.parametrize("fingers", [2, 3])
@pytest.mark.parametrize("name", NAMES)
def test_the_chance_is_at_most_that_of_the_definition(name: str, fingers: int) -> None:
    view, _, regions = chosen(name, fingers)
    rng, n = np.random.default_rng(2), 600
    current = apply_homography(TILTED, regions.contacts)
    for sigma in (1.0, 6.0):
        C = sample_covariances(rng, fingers, sigma)
        chance = chance_of_closing(regions, C, TILTED)
        drawn = np.stack([rng.multivariate_normal(c, v, n) for c, v in zip(current, C, strict=True)], axis=1)
        back = apply_homography(np.linalg.inv(TILTED), drawn.reshape(-1, 2)).reshape(n, fingers, 2)
        slips = ((back - regions.contacts) * regions.tangents).sum(axis=2)
        share = float(closes(view, regions, slips).mean())
        noise = 4.0 * math.sqrt(max(share * (1.0 - share), 1.0 / n) / n)
        assert chance <= share + noise
        inside = np.all((slips > -regions.back) & (slips < regions.ahead), axis=1).mean()
        assert chance == pytest.approx(inside, abs=4.0 * math.sqrt(0.25 / n))
        if sigma == 1.0:  # small errors: sliding along the tangent and the outline's nearest point are one
            assert chance <= float(closes_at(view, back, FRICTION).mean()) + noise


def test_of_good_grasps_and_small_errors_little_is_given_away() -> None:
    for name in NAMES:
        _, _, regions = chosen(name, 2)
        assert chance_of_closing(regions, np.array([np.eye(2) * 0.3**2] * 2), TILTED) > 0.99


@given(st.floats(0.05, 20.0), st.floats(1.05, 3.0))
def test_more_error_means_less_chance(sigma: float, more: float) -> None:
    regions = chosen("bracket", 2)[2]
    C = np.array([np.eye(2)] * 2)
    assert chance_of_closing(regions, C * (sigma * more) ** 2) <= chance_of_closing(regions, C * sigma**2) + 1e-12


@given(st.integers(0, 99), st.floats(0.2, 8.0))
def test_it_does_not_matter_in_which_view_it_is_told(seed: int, sigma: float) -> None:
    regions = chosen("hook", 2)[2]
    C = sample_covariances(np.random.default_rng(seed), 2, sigma)
    J = np.array([np.array(homography_jacobian(TILTED, x, y)).reshape(2, 2) for x, y in regions.contacts.tolist()])
    assert chance_of_closing(regions, J @ C @ np.swapaxes(J, 1, 2), TILTED) == pytest.approx(
        chance_of_closing(regions, C), abs=1e-9
    )


def test_contacts_off_their_place_have_less_room_on_one_side() -> None:
    regions = Regions(
        np.array([[0.0, 0], [0, 50]]), np.array([[1.0, 0], [-1, 0]]), np.array([2.0, 9]), np.array([2.0, 9])
    )
    C, H = np.array([np.eye(2)] * 2), np.diag([2.0, 2.0, 1.0])
    assert chance_of_closing(regions, C, H, apply_homography(H, regions.contacts)) == chance_of_closing(regions, C, H)
    moved = apply_homography(H, np.add(regions.contacts, [[2.0, 0.0], [0.0, 0.0]]))
    assert chance_of_closing(regions, C, H, moved) == pytest.approx(0.5, abs=1e-9)
    assert chance_of_closing(regions, C, H, apply_homography(H, np.add(regions.contacts, [[0, 9.0], [0, -3]]))) > 0.99


def test_what_cannot_be_told() -> None:
    regions = chosen("bracket", 2)[2]
    C = np.array([np.eye(2)] * 2)
    assert math.isnan(chance_of_closing(regions, C * math.nan)) and math.isnan(chance_of_closing(regions, C + math.inf))
    assert math.isnan(chance_of_closing(regions, C, np.diag([0.0, 1.0, 1.0])))
    assert chance_of_closing(regions, 0.0 * C) == 1.0
    with pytest.raises(InputError, match=r"a covariance of 2 contacts is \(2, 2, 2\), not \(3, 2, 2\)"):
        chance_of_closing(regions, np.zeros((3, 2, 2)))


def test_contacts_are_judged_where_they_lay_in_the_first_view() -> None:
    view, grasp, regions = chosen("gasket", 2)
    width, C = 0.1 * math.sqrt(kernels.polygon_moments(view.points, view.offsets).area), np.array([np.eye(2)] * 2)
    check = ClosureCheck(grasp, view, FRICTION, width)
    there = apply_homography(TILTED, grasp.contacts)
    judged = check.judge(there, FRICTION, TILTED, TILTED, C)
    analysis, chance = judged.analysis, judged.closure_probability
    own = analyze(grasp, view, FRICTION, width, "reference")
    assert analysis.margin == pytest.approx(own.margin) and analysis.epsilon == pytest.approx(own.epsilon)
    assert analysis.judged_in == "plane" and analysis.stable
    in_image = analyze(Grasp(there), view.transformed(TILTED), FRICTION)
    assert judged.margin_image == pytest.approx(in_image.margin, abs=1e-6)
    assert chance == chance_of_closing(regions, C, TILTED, there)
    with pytest.raises(GraspError, match="contact 1 is"):
        check.judge(there + 50.0, FRICTION, TILTED, TILTED, C)
    across = there[1] - there[0]
    between = np.array([[1.0, 0, 0], [0, 1, 0], [*across, -there.mean(axis=0) @ across]])  # its horizon
    with pytest.raises(ConditioningError, match="to infinity"):
        check.judge(there, FRICTION, np.linalg.inv(between), TILTED, C)

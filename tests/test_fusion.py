# SPDX-License-Identifier: Apache-2.0
"""All the evidence at once: what each piece shows, what a surface settles, and what does not move along."""

from __future__ import annotations

import functools
import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasptrack import kernels
from grasptrack.evaluation.parts import built_in
from grasptrack.evaluation.scenes import run_case, suite
from grasptrack.evaluation.sequence import chosen_grasp
from grasptrack.kernels import reference
from grasptrack.observation.fusion import Fusion
from grasptrack.observation.posed import Fused
from grasptrack.observation.registration import OutlineRegistration
from grasptrack.observation.segmentation import segment
from grasptrack.observation.surface import shrunk, surfaces
from grasptrack.projective import apply_homography, similarity
from grasptrack.simulation import SHAPES, Conditions, Scene, similarity_path, tilting_path
from grasptrack.simulation.surfaces import blank, brushed, printed
from grasptrack.simulation.tables import gravel, plain

STILL = {"conditions": Conditions(noise=1.5)}


def a_scene(shape: str, seed: int, **options: object) -> Scene:
    return Scene(SHAPES[shape](), tilting_path(30, seed=seed), seed=seed, **{**STILL, **options})  # type: ignore[arg-type]


def begun(scene: Scene) -> tuple[Fusion, np.ndarray]:
    grey = scene[0].image
    view, contacts = segment(grey), chosen_grasp(scene[0].outline)
    dark = grey[view.outer.points[:, 1].astype(int), view.outer.points[:, 0].astype(int)].mean() > 0
    assert dark
    return Fusion(OutlineRegistration(view, grey, 1), view, grey, contacts), contacts


def off(fused: Fused, scene: Scene, index: int, contacts: np.ndarray) -> float:
    true = apply_homography(scene.homography(index), contacts)
    return float(np.hypot(*(apply_homography(fused.homography, contacts) - true).T).max())


def turned(scene: Scene, index: int, degrees: float) -> np.ndarray:
    """The true pose, turned about the part's centre."""
    x, y = np.concatenate(scene[0].outline).mean(axis=0).tolist()
    return np.asarray(scene.homography(index) @ similarity(1.0, math.radians(degrees), (x, y), (x, y)))


def in_parameters(found: tuple[np.ndarray, ...], row: int) -> tuple[np.ndarray, ...]:
    """N, sure and b of one piece of evidence in parameters that no choice of eigenvectors changes."""
    back = np.linalg.inv(found[2])
    return back.T @ found[4][row] @ back, back.T @ found[4][row] @ back, back.T @ found[5][row]


@functools.cache
def seen(shape: str, seed: int, index: int, by: int) -> tuple[object, ...]:
    """What the kernels are given to lay the first image of a scene on another, and the true pose there."""
    scene = a_scene(shape, seed)
    grey, image = scene[0].image, scene[index].image
    view = segment(grey)
    samples, places = OutlineRegistration(view, grey, 1).samples, surfaces(view, grey, by, 450)
    return (image, shrunk(image, by), float(by)), samples, places[1:], scene.homography(index), scene[0].outline


def looked_at(shape: str, seed: int, index: int, shift: tuple[float, float], by: int) -> tuple[object, ...]:
    """The same from the true pose shifted."""
    images, samples, places, true, _ = seen(shape, seed, index, by)
    return (*images, similarity(1.0, 0.0, (0.0, 0.0), shift) @ true, *samples, 3.0, 2.0, 0.3, *places)


# --- kernels -------------------------------------------------------------------------------------


@settings(max_examples=8, deadline=None)
@given(
    st.integers(0, 1),
    st.sampled_from(["bracket", "disc"]),
    st.sampled_from([2, 4]),
    st.sampled_from([3, 17]),
    st.tuples(st.floats(-2, 2), st.floats(-2, 2)),
    st.integers(0, 3),
    st.tuples(st.booleans(), st.booleans(), st.booleans()),
)
def test_native_equals_reference(
    seed: int, shape: str, by: int, index: int, shift: tuple[float, float], most: int, use: tuple[bool, bool, bool]
) -> None:
    arguments = (*looked_at(shape, seed, index, shift, by), np.array(use), 2.0, 50.0, 0.02, 0, most)
    found, wanted = kernels.converge(*arguments), reference.converge(*arguments)
    np.testing.assert_allclose(found[0], wanted[0], rtol=1e-7, atol=1e-9)
    assert found[1] == wanted[1] and found[3] == pytest.approx(wanted[3], abs=1e-6)
    assert found[4][1] == pytest.approx(wanted[4][1], rel=1e-9)
    for place in (6, 7, 8):
        np.testing.assert_allclose(found[4][place], wanted[4][place], atol=1e-6)
    for row in range(3):
        for a, b in zip(in_parameters(found[4], row), in_parameters(wanted[4], row), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-6 * max(float(np.abs(b).max()), 1e-9))
    if any(used and stats[2] > 0.0 for used, stats in zip(use, wanted[4].stats, strict=True)):
        contacts = np.concatenate(seen(shape, seed, index, by)[4])[::50]
        spread = [
            module.contact_covariance(
                made[0],
                contacts,
                *made[4][:3],
                made[4][4],
                np.array(use) / np.maximum(wanted[4].stats[:, 2], 0.1),
                50.0,
            )
            for module, made in ((kernels, found), (reference, wanted))
        ]
        np.testing.assert_allclose(spread[0], spread[1], atol=1e-6 * float(np.abs(spread[1]).max()))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, 8), st.floats(0.01, 0.3))
def test_native_sees_the_same_motion(seed: int, rank: int, least: float) -> None:
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(rank, 8)) * 10.0 ** rng.uniform(-1, 1, 8)
    N, b = A.T @ A, rng.normal(size=8)
    told = np.linalg.eigvalsh(N) / np.linalg.eigvalsh(N)[-1]
    if np.abs(told - least).min() > 1e-6:
        np.testing.assert_allclose(kernels.seen_motion(N, b, least), reference.seen_motion(N, b, least), rtol=1e-6)


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 1), st.sampled_from([3, 17]), st.tuples(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5)))
def test_steps_lead_to_one_pose(seed: int, index: int, shift: tuple[float, float]) -> None:
    use = np.ones(3, np.bool_)
    poses = []
    for begin in ((0.0, 0.0), shift):
        found = kernels.converge(*looked_at("bracket", seed, index, begin, 2), use, 2.0, 50.0, 0.001, 0, 20)
        assert found[1] < 20 and float(np.linalg.norm(found[2])) < 0.001
        again = kernels.converge(*looked_at("bracket", seed, index, begin, 2), use, 2.0, 50.0, 0.001, found[1] + 1, 20)
        assert again[1] > found[1]
        poses.append(found[0])
    contacts = np.concatenate(seen("bracket", seed, index, 2)[4])[::20]
    np.testing.assert_allclose(*(apply_homography(H, contacts) for H in poses), atol=0.02)


@pytest.mark.parametrize("module", [kernels, reference])
def test_what_would_lie_behind_the_camera_is_said(module: object) -> None:
    arguments = list(looked_at("bracket", 1, 3, (0.0, 0.0), 2))
    arguments[3] = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0 / 320.0, 0.0, 1.0]])
    found = module.converge(*arguments, np.ones(3, np.bool_), 2.0, 50.0, 0.02, 0, 3)  # type: ignore[attr-defined]
    assert found[1] == 0 and math.isnan(found[4][1])
    assert not np.any(found[4][3]) and np.isnan(found[2]).all() and np.isnan(found[4][2]).all()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.booleans())
def test_native_differences_equal_reference(seed: int, smooth: bool) -> None:
    rng = np.random.default_rng(seed)
    ramp = 0.5 * np.add.outer(np.arange(120), np.arange(160)) + rng.normal(0, 2, (120, 160))
    image = (np.clip(ramp, 0, 255) if smooth else rng.integers(0, 255, (120, 160))).astype(np.uint8)
    places = rng.uniform(-10, 330, (120, 2)) * (1.0, 0.75)
    values = rng.uniform(0, 255, 120)
    values[rng.random(120) < 0.1] = np.nan
    H = np.eye(3) + rng.normal(0, 1, (3, 3)) * [[0.02, 0.02, 3], [0.02, 0.02, 3], [1e-4, 1e-4, 0]]
    found = kernels.grey_differences(image, 2.0, H, places, values, 1.0)
    wanted = reference.grey_differences(image, 2.0, H, places, values, 1.0)
    np.testing.assert_allclose(found[0], wanted[0], atol=1e-8)
    assert found[1] == pytest.approx(wanted[1], abs=1e-9, nan_ok=True)


def test_both_refuse_the_same() -> None:
    image, H = np.zeros((50, 50), np.uint8), np.eye(3)
    at, one = np.array([[10.0, 10], [40, 10], [40, 40], [10, 40]]), np.ones(4)
    none, start = np.zeros((0, 2)), np.zeros(1, np.int64)
    good = (image, image, 1.0, H, at, at / 50, one, 1, 3.0, 2.0, 0.3, none, none[:, 0], none, start, np.array([True]))
    good = (*good, 2.0, 9.0, 0.1, 0, 4)
    bad = {4: at[:0], 5: at[:2], 6: one[:1], 8: 0.0, 11: at, 12: one, 13: at, 14: np.array([1], np.int64)}
    bad |= {15: np.zeros(2, np.bool_), 17: 0.0}
    for module in (kernels, reference):
        assert not np.any(module.converge(*good)[4][3])  # nothing is to be seen, which is no error
        for place, value in bad.items():
            with pytest.raises(ValueError):
                module.converge(*(value if i == place else given for i, given in enumerate(good)))
        with pytest.raises(ValueError, match="each place needs its value"):
            module.grey_differences(image, 1.0, H, at, one[:2], 1.0)
        assert math.isnan(module.grey_differences(image, 1.0, H, at, one, 1.0)[1])
        with pytest.raises(ValueError, match="eight motions"):
            module.contact_covariance(H, at, H[0, :2], 1.0, H, np.zeros((1, 8, 8)), one[:1], 1.0)


def test_grey_differences_do_not_depend_on_light() -> None:
    scene = a_scene("bracket", 3, conditions=Conditions(noise=0.0))
    grey = scene[0].image
    places = surfaces(segment(grey), grey, 2, 300)
    lit = np.clip(0.7 * grey.astype(float) + np.linspace(0, 30, grey.shape[1]), 0, 255).astype(np.uint8)
    rest, noise = kernels.grey_differences(shrunk(lit, 2), 2.0, np.eye(3), places.places, places.values, 0.5)
    assert noise < 1.0 and np.abs(rest).max() < 2.0


# --- fusion --------------------------------------------------------------------------------------


@settings(max_examples=6, deadline=None)
@given(st.integers(0, 200), st.floats(-4, 4), st.integers(1, 29))
def test_the_ground_settles_the_turn_of_a_disc(seed: int, degrees: float, index: int) -> None:
    """Gravel shows every motion; wood shows too little along its grain to be believed alone."""
    scene = a_scene("disc", seed, surface=blank(seed), table=gravel(seed))
    fusion, contacts = begun(scene)
    fused = fusion.refine(scene[index].image, turned(scene, index, degrees))
    assert off(fused, scene, index, contacts) < 0.6
    assert fused.used[2] and math.sqrt(np.diag(fused.covariance).max()) < 0.6


@settings(max_examples=4, deadline=None)
@given(st.integers(0, 200), st.floats(-2, 2))
def test_print_settles_it_where_the_table_slides_away(seed: int, degrees: float) -> None:
    """Image after image: a table that has slid before it was ever believed may lie on itself again. Where it hardly shows,
    it may stay in use; it must not bend the pose."""
    scene = a_scene("disc", seed, surface=printed(seed), slide=(0.02, 0.013))
    fusion, contacts = begun(scene)
    for index in range(1, 8):
        fused = fusion.refine(scene[index].image, turned(scene, index, degrees))
        assert off(fused, scene, index, contacts) < 0.5
        fusion.trust.believe(fused)
    assert fused.used[1]


def test_what_nothing_settles_is_not_claimed() -> None:
    scene = a_scene("disc", 5, surface=blank(5, contrast=0.0), table=plain(5, contrast=0.0))
    fusion, _ = begun(scene)
    fused = fusion.refine(scene[8].image, scene.homography(8))
    assert math.sqrt(np.diag(fused.covariance).max()) > 10.0 and not fused.held


def test_a_table_that_slides_does_not_bend_the_pose() -> None:
    scene = a_scene("bracket", 7, surface=blank(7), slide=(0.004, 0.003))
    fusion, contacts = begun(scene)
    for index in range(1, 30):
        fused = fusion.refine(scene[index].image, scene.homography(index))
        assert off(fused, scene, index, contacts) < 0.25
        fusion.trust.believe(fused)
    assert not fused.used[2] and not fusion.trust.on_ground


def test_a_cover_does_not_bend_what_surfaces_hold() -> None:
    scene = a_scene("spanner", 9, surface=printed(9), table=gravel(9))
    fusion, contacts = begun(scene)
    fusion.trust.believe(fusion.refine(scene[1].image, scene.homography(1)))
    for index in (5, 15, 25):
        image = scene[index].image.copy()
        x, _ = np.rint(np.concatenate(scene[index].outline).mean(axis=0)).astype(int)
        cv2.rectangle(image, (int(x), 0), (int(x) + 60, 479), 150, -1)
        fused = fusion.refine(image, scene.homography(index), far=True)
        assert off(fused, scene, index, contacts) < 0.3 and fused.held


def test_where_the_object_went_with_the_ground_while_it_was_hidden() -> None:
    scene = a_scene("gear", 11, table=gravel(11))
    fusion, contacts = begun(scene)
    fusion.trust.believe(fusion.refine(scene[1].image, scene.homography(1)))
    image = scene[2].image.copy()
    cv2.fillPoly(image, [np.rint(p).astype(np.int32) for p in scene[2].outline[:1]], 128)
    H = fusion.on_ground(image, scene.homography(1))
    assert H is not None
    assert np.hypot(*(apply_homography(H, contacts) - scene[2].carry(contacts)).T).max() < 1.0
    assert fusion.on_ground(np.full_like(image, 128), scene.homography(1)) is None


def test_a_surface_tells_a_half_turn_from_none() -> None:
    scene = Scene(SHAPES["rectangle"](), similarity_path(10, seed=2), surface=printed(2), seed=2, **STILL)  # type: ignore[arg-type]
    fusion, contacts = begun(scene)
    for index in (1, 2):
        fusion.trust.believe(fusion.refine(scene[index].image, scene.homography(index)))
    assert fusion.trust.telling
    x, y = np.concatenate(scene[0].outline).mean(axis=0).tolist()
    half = similarity(1.0, math.pi, (x, y), (x, y))
    right = fusion.refine(scene[3].image, scene.homography(3))
    wrong = fusion.refine(scene[3].image, scene.homography(3) @ half)
    assert not fusion.differs(right) and wrong.surface < right.surface - 0.2
    assert fusion.settles(scene[3].image, right, [half])
    found = fusion.best(scene[3].image, [wrong.homography @ half])
    assert found is not None and off(found, scene, 3, contacts) < 0.5
    bare = Scene(SHAPES["rectangle"](), similarity_path(10, seed=2), surface=brushed(2, contrast=0.0), seed=2, **STILL)  # type: ignore[arg-type]
    fusion, _ = begun(bare)
    fused = fusion.refine(bare[1].image, bare.homography(1))
    assert not fusion.settles(bare[1].image, fused, [half])


@settings(max_examples=8, deadline=None)
@given(st.integers(0, 20), st.sampled_from(["bracket", "washer", "spanner"]), st.integers(1, 20))
def test_the_homography_is_as_uncertain_as_the_contacts_that_it_carries(seed: int, shape: str, index: int) -> None:
    scene = a_scene(shape, seed)
    fusion, contacts = begun(scene)
    fused = fusion.refine(scene[index].image, scene.homography(index))
    H = fused.homography
    assert H[2, 2] == 1.0 and np.abs(fused.homography_covariance[8]).max() == 0.0
    rows = []
    for (x, y), (u, v) in zip(contacts, apply_homography(H, contacts), strict=True):
        place = np.array([x, y, 1.0]) / float(H[2] @ (x, y, 1.0))
        none = np.zeros(3)
        rows += [np.concatenate([place, none, -u * place]), np.concatenate([none, place, -v * place])]
    J = np.array(rows)
    np.testing.assert_allclose(
        J @ fused.homography_covariance @ J.T, fused.covariance, rtol=1e-5, atol=1e-7 * np.abs(fused.covariance).max()
    )


def test_light_on_a_ring_does_not_tell_its_turn() -> None:
    # its sides hide what the outline could tell; light that falls off over it stays where it is
    case = suite(built_in(["washer"]), ["thick"], frames=25)[0]
    frames = run_case((case, ("auto",)))["auto"]
    assert [f.frame for f in frames if f.is_false_accept] == []


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 20), st.sampled_from(["washer", "disc"]), st.floats(2.0, 8.0))
def test_a_pose_slid_keeps_its_outline_and_moves_its_contacts(seed: int, shape: str, by: float) -> None:
    scene = a_scene(shape, seed)
    fusion, contacts = begun(scene)
    state = fusion._look(scene[3].image, scene.homography(3), 2, [True, True, True])
    outline = scene[0].outline[0]
    lies = apply_homography(state.H, outline).astype(np.float32)
    for H in state.slid(by):
        off = apply_homography(H, contacts) - apply_homography(state.H, contacts)
        assert np.sqrt(np.square(off).sum(axis=1).mean()) == pytest.approx(by, rel=0.1)
        gap = [abs(cv2.pointPolygonTest(lies, (x, y), True)) for x, y in apply_homography(H, outline).tolist()]
        assert max(gap) < 0.05 * by**2 + 0.2  # a straight step leaves a round outline a little

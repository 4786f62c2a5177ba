# SPDX-License-Identifier: Apache-2.0
"""What an inspection rests on: motions, noise, drawn runs and what they foretell, on curves and images that are known."""

import json
import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.images import PLAIN
from grasptrack.trackability import inspect
from grasptrack.trackability.appearance import QUANTUM, Edges, edge_direction_noise, gradient_statistics
from grasptrack.trackability.motions import MODELS, NAMES, SLIDING, Basis, Motions, motions_of, sliding_displacement
from grasptrack.trackability.prediction import (
    FILE,
    Drawn,
    SimulatedRun,
    Unforeseen,
    errors_of,
    log_chance,
    predict_run,
    shares_of,
)
from grasptrack.trackability.synthetic_view import REST, SHIFT, RunImage, RunSetting, Stage, denoise_image, draw_run
from grasptrack.tracking.camera import Beforehand
from grasptrack.tracking.numbers import NUMBERS
from scenery import L_PLATE, SQUARE, drawn, ellipse


def sampled(corners: np.ndarray, step: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Points and outward normals of a polygon with corners in the order of a contour, at the middle of equal steps."""
    points, normals = [], []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        length = math.dist(a, b)
        u = (np.arange(round(length / step)) + 0.5) / round(length / step)
        points.append(a + u[:, None] * (b - a))
        way = (b - a) / length
        normals.append(np.tile([way[1], -way[0]], (len(u), 1)))
    return np.vstack(points), np.vstack(normals)


def box(a: float, b: float) -> np.ndarray:
    return np.array([[-a, -b], [a, -b], [a, b], [-a, b]])


def turned(angle: float) -> np.ndarray:
    return np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])


def shown(found: Motions, name: str) -> float:
    return found.motions[NAMES.index(name)].shown


def of(points: np.ndarray, normals: np.ndarray, size: float, axes: np.ndarray | None = None) -> Motions:
    return motions_of(points, normals, Basis(points.mean(axis=0), np.eye(2) if axes is None else axes, size))


@given(half=st.integers(20, 400), thick=st.integers(10, 60))
def test_a_strip_shows_a_shift_along_it_by_its_ends_alone(half: int, thick: int) -> None:
    found = of(*sampled(box(half, thick)), math.sqrt(4.0 * half * thick))
    assert shown(found, "shift along") == pytest.approx(math.sqrt(thick / (half + thick)), rel=1e-9)
    assert shown(found, "shift across") == pytest.approx(math.sqrt(half / (half + thick)), rel=1e-9)
    if thick / (half + thick) < SLIDING**2:
        assert not found.models["similarity"].observable


@given(radius=st.floats(15.0, 300.0))
def test_a_circle_hides_turns_and_what_moves_a_circle_into_itself(radius: float) -> None:
    t = np.linspace(0.0, 2.0 * math.pi, 240, endpoint=False)
    normals = np.column_stack([np.cos(t), np.sin(t)])
    found = of(radius * normals, normals, math.sqrt(math.pi) * radius)
    assert shown(found, "turn") < 1e-9 and shown(found, "scale") == pytest.approx(1.0)
    assert [m.name for m in found.motions if "similarity" not in m.observed and m.name in NAMES[:4]] == ["turn"]
    assert not any(m.observable for m in found.models.values())
    moved = sliding_displacement(found, radius * normals)
    assert np.abs(np.einsum("ij,ij->i", moved, normals)).max() < 1e-6 * np.abs(moved).max()


@given(
    angle=st.floats(-3.0, 3.0), scale=st.floats(0.3, 5.0), shift=st.tuples(st.floats(-500, 500), st.floats(-500, 500))
)
def test_what_an_outline_shows_does_not_depend_on_where_it_lies_nor_on_its_size(
    angle: float, scale: float, shift: tuple[float, float]
) -> None:
    corners = np.array([[-70, -45], [70, -45], [70, 5], [-20, 5], [-20, 45], [-70, 45]], dtype=np.float64)
    points, normals = sampled(corners)
    first = of(points, normals, 90.0)
    R = turned(angle)
    second = of(scale * points @ R + shift, normals @ R, 90.0 * scale, axes=R)
    assert [m.shown for m in second.motions] == pytest.approx([m.shown for m in first.motions], rel=1e-6)
    assert [m.observed for m in second.motions] == [m.observed for m in first.motions]
    for name in MODELS:
        assert second.models[name].weakest == pytest.approx(first.models[name].weakest, rel=1e-6)


def test_an_outline_without_edges_shows_nothing() -> None:
    found = motions_of(np.zeros((0, 2)), np.zeros((0, 2)), Basis(np.zeros(2), np.eye(2), 50.0))
    assert not any(m.observable for m in found.models.values())


# --- edges ---------------------------------------------------------------------------------------


def wavering(noise: float, a: float, b: float, seed: int) -> Edges:
    """Edges on an ellipse, each off by noise of its own; normals as a chord of four px sees them."""
    count = round(math.pi * (a + b))
    t = 2.0 * math.pi * np.arange(count) / count
    ideal = np.column_stack([b * np.cos(t), a * np.sin(t)])
    ideal /= np.hypot(*ideal.T)[:, None]
    points = np.column_stack([a * np.cos(t), b * np.sin(t)])
    points += noise * np.random.default_rng(seed).standard_normal(count)[:, None] * ideal
    chord = np.roll(points, -2, axis=0) - np.roll(points, 2, axis=0)
    normals = np.column_stack([chord[:, 1], -chord[:, 0]]) / np.hypot(*chord.T)[:, None]
    full = np.full(count, 50.0)
    return Edges(points, normals, full, full, full, np.ones(count, np.bool_), np.zeros(count, np.int64), 2)


@given(noise=st.floats(0.02, 0.3), a=st.floats(60.0, 150.0), b=st.floats(60.0, 150.0), seed=st.integers(0, 99))
def test_directions_sway_by_the_noise_of_edges_on_any_smooth_outline(
    noise: float, a: float, b: float, seed: int
) -> None:
    edges = wavering(noise, a, b, seed)
    # a chord over four px sways by its ends' noise
    assert edge_direction_noise(edges) == pytest.approx(math.sqrt(2.0) * noise / 4.0, rel=0.45, abs=2e-3)


def test_the_directions_of_a_smooth_outline_do_not_sway() -> None:
    assert edge_direction_noise(wavering(0.0, 100.0, 70.0, 0)) < 1e-3


# --- texture -------------------------------------------------------------------------------------


def outline(corners: np.ndarray, centre: tuple[float, float] = (160.0, 120.0)) -> View:
    return View(Contour(sampled(corners)[0] + centre))


@settings(deadline=None, max_examples=8)
@given(noise=st.floats(0.8, 12.0), seed=st.integers(0, 99))
def test_noise_is_measured_and_is_no_structure(noise: float, seed: int) -> None:
    image = np.random.default_rng(seed).normal(128.0, noise, (240, 320)).round().astype(np.uint8)
    view = outline(SQUARE)
    for relief in gradient_statistics(image, view):
        assert relief.noise == pytest.approx(math.hypot(noise, 1.0 / math.sqrt(12.0)), rel=0.06)
        assert relief.rms <= 0.2 * noise


def test_slopes_within_and_round_an_outline_are_kept_apart() -> None:
    image = np.full((240, 320), 100, np.uint8)
    image[:, 112:209] += np.arange(97, dtype=np.uint8)  # a slope of 1 within
    image[:, :112], image[:, 209:] = 100, 100
    image[:72], image[169:] = 100, 100
    surface, ground = gradient_statistics(image, outline(SQUARE))
    assert surface.rms == pytest.approx(1.0, rel=0.05) and surface.least < 0.2
    assert ground.rms == 0.0


# --- drawn runs ----------------------------------------------------------------------------------


def setting(x: float, y: float, size: float, focal_sd: float = 0.4) -> RunSetting:
    return RunSetting(np.array([x, y]), size, 0.8 * size, 640, 480, Beforehand.with_focal(0.0, focal_sd, NUMBERS))


def test_a_view_that_has_not_moved_is_the_image_but_for_its_noise() -> None:
    image = drawn(SQUARE, noise=0.0)
    assert np.abs(Stage(image, PLAIN, QUANTUM).render_grey(REST).astype(int) - image).max() <= 1
    stage, plain = Stage(image, PLAIN, 6.0), np.hypot(*(np.mgrid[:240, :320] - np.array([[[120]], [[160]]]))) > 90
    one, other = (stage.render_grey(REST).astype(float)[plain] for _ in range(2))
    assert (one - image[plain]).std() == pytest.approx(6.0, rel=0.03)
    assert abs(np.corrcoef(one - image[plain], other - image[plain])[0, 1]) < 0.03  # fresh each time


@given(seed=st.integers(0, 999), size=st.floats(30.0, 200.0), x=st.floats(50, 590), y=st.floats(50, 430))
def test_a_run_begins_at_the_first_view_never_mirrors_and_keeps_the_object_in_sight(
    seed: int, size: float, x: float, y: float
) -> None:
    where = setting(x, y, size)
    corners = where.centre + 0.5 * size * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    before, longest = corners, 0.0
    for step in draw_run(where, 12, np.random.default_rng(seed)):
        moved = apply_homography(step.H, corners)
        ahead, back = np.roll(moved, -1, 0) - moved, moved - np.roll(moved, 1, 0)
        assert (back[:, 0] * ahead[:, 1] - back[:, 1] * ahead[:, 0] > 0).all()
        longest = max(longest, float(np.hypot(*(moved - before).T).max()))
        before = moved
    assert longest < 0.35 * size  # in steps that a tracker sees
    centre = before.mean(axis=0)
    assert np.hypot(*(centre - where.centre)) < (SHIFT + 0.2) * size
    away = np.abs(centre - where.image_centre), np.abs(where.centre - where.image_centre)
    assert (away[0] < np.maximum(away[1], where.image_centre) + 0.2 * size).all()


@given(seed=st.integers(0, 99), focal=st.floats(-0.5, 0.7))
def test_a_drawn_run_is_a_pinholes_view_of_a_plane(seed: int, focal: float) -> None:
    """K^-1 H K of a frontal first view has two columns alike long and at right angles, in any focal length that is known."""
    where = setting(250.0, 200.0, 120.0, 0.0)._replace(focal=Beforehand.with_focal(focal, 0.0, NUMBERS))
    f = 640.0 * math.exp(focal)
    K = np.array([[f, 0.0, 319.5], [0.0, f, 239.5], [0.0, 0.0, 1.0]])
    for step in draw_run(where, 6, np.random.default_rng(seed)):
        a, b, _ = (np.linalg.inv(K) @ step.H @ K).T
        assert np.linalg.norm(a) == pytest.approx(np.linalg.norm(b), rel=1e-6)
        assert abs(a @ b) < 1e-6 * (a @ a)


@given(gain=st.floats(0.9, 1.1), u=st.floats(-12.0, 12.0), v=st.floats(-12.0, 12.0))
def test_light_and_shutter_change_levels_and_edges_as_they_say(gain: float, u: float, v: float) -> None:
    image = drawn(SQUARE, noise=0.0)
    seen = Stage(image, PLAIN, QUANTUM).render_grey(RunImage(np.eye(3), gain, np.array([u, v]))).astype(float)
    assert seen.mean() == pytest.approx(gain * image.mean(), rel=0.01)  # a smear takes no light away
    assert seen.std() <= 1.01 * gain * image.std()


# --- what a run will give ------------------------------------------------------------------------

USUAL = Unforeseen(located=0.6, lost=0.05, weight=5.0, factor=1.0, factor_spread=0.4, beyond=1e-3, beyond_spread=0.8)


def test_each_fitted_number_stands_with_its_interval_and_its_script() -> None:
    told = json.loads(FILE.read_text(encoding="utf-8"))
    assert list(told) == list(Unforeseen._fields)
    for entry in told.values():
        assert 0.0 < entry["from"] <= entry["value"] <= entry["to"] and entry["by"].startswith(
            "research.studies.trackability --fit"
        )


def of_runs(located: int, error: float = 0.1, size: float = 100.0) -> Drawn:
    lost = "too little" if located < 12 else ""
    return Drawn.from_runs([SimulatedRun(12, (error,) * located, lost), SimulatedRun(12, (error,) * 12, "")], size)


@given(a=st.floats(0.05, 20.0), b=st.floats(0.05, 20.0), frames=st.integers(1, 120))
def test_shares_are_those_of_a_beta_distribution(a: float, b: float, frames: int) -> None:
    k = np.arange(frames + 1)
    chance = np.exp([log_chance(a, b, frames, each) for each in k.tolist()])
    assert chance.sum() == pytest.approx(1.0) and chance @ k == pytest.approx(frames * a / (a + b))
    least, most = shares_of(a, b, frames)
    assert 0.0 <= least <= most <= 1.0
    inside = chance[round(least * frames) : round(most * frames) + 1].sum()
    assert inside >= 0.95 - 1e-9
    assert (
        chance[: round(least * frames)].sum() <= 0.025 + 1e-9
        and chance[round(most * frames) + 1 :].sum() <= 0.025 + 1e-9
    )


@given(fewer=st.integers(0, 11))
def test_the_more_is_located_of_what_is_drawn_the_more_is_expected(fewer: int) -> None:
    low, high = (predict_run(of_runs(k), unforeseen=USUAL) for k in (fewer, fewer + 1))
    assert low.located < high.located and low.drawn.located + 1 == high.drawn.located
    assert low.located_interval[0] <= high.located_interval[0] and low.located_interval[1] <= high.located_interval[1]
    assert low.drawn.reason == "too little"


@given(error=st.floats(0.01, 3.0), size=st.floats(20.0, 600.0), times=st.floats(1.1, 5.0))
def test_errors_grow_with_what_is_drawn_and_with_the_size(error: float, size: float, times: float) -> None:
    least, middle, most = errors_of(of_runs(12, error, size), USUAL)
    assert 0.0 < least < middle < most
    assert most > error and most > USUAL.beyond * size
    for other in (of_runs(12, times * error, size), of_runs(12, error, times * size)):
        assert all(b > a for a, b in zip((least, middle, most), errors_of(other, USUAL), strict=True))
    # both together are a change of units
    scaled = errors_of(of_runs(12, times * error, times * size), USUAL)
    assert scaled == pytest.approx([times * e for e in (least, middle, most)])


def test_what_drifts_is_no_evidence_that_it_goes_on_and_may_be_off_as_far() -> None:
    held, adrift = (predict_run(of_runs(12)._replace(adrift=sd), unforeseen=USUAL) for sd in (0.0, 2.0))
    assert adrift.located_interval[0] < 0.5 < held.located_interval[0] and adrift.located_interval[1] == 1.0
    assert adrift.error_interval[1] > 2.0 * 1.9 > held.error_interval[1]
    assert adrift.error_interval[0] == held.error_interval[0]


def test_of_what_was_never_located_no_error_is_told() -> None:
    never = predict_run(Drawn.from_runs([SimulatedRun(12, (), "hidden")] * 2, 100.0), unforeseen=USUAL)
    assert math.isnan(never.error_px) and all(math.isnan(e) for e in never.error_interval)
    assert never.located < 0.2 and never.located_interval[0] == 0.0


# --- what fixes the contacts ---------------------------------------------------------------------


@settings(deadline=None, max_examples=8)
@given(noise=st.floats(0.8, 10.0), seed=st.integers(0, 99))
def test_noise_that_is_taken_off_is_not_in_the_next_image(noise: float, seed: int) -> None:
    pattern = np.random.default_rng(seed).normal(0.0, noise, (240, 320))
    image = np.clip(drawn(SQUARE, noise=0.0) + pattern, 0, 255).round().astype(np.uint8)
    plain = np.hypot(np.arange(240)[:, None] - 120, np.arange(320) - 160) > 90
    left = denoise_image(image, math.hypot(noise, 0.29))[plain].astype(float)
    # what is left of the pattern, against the fresh noise that hides it
    shared = float(np.mean((left - left.mean()) * pattern[plain])) / noise**2
    assert abs(shared) < 0.15


def on(within: float, round_it: float) -> np.ndarray:
    """A disc with spots on its surface, on the ground round it, or on neither."""
    y, x = np.mgrid[:240, :320]
    far = np.hypot(x - 160, y - 120)
    spots = 14.0 * np.sin(x / 4.0) * np.sin(y / 5.0) * np.where(far < 50, within * (far < 44), round_it * (far > 56))
    return np.clip(drawn(ellipse(50.0, 50.0)) + spots, 0, 255).astype(np.uint8)


@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("within", "round_it", "by"), [(0, 0, "nothing"), (1, 0, "surface"), (0, 1, "nothing"), (1, 1, "surface")]
)
def test_more_evidence_never_fixes_less_and_is_told_by_what_it_takes(within: int, round_it: int, by: str) -> None:
    seen = inspect(on(within, round_it))
    assert seen.settled is not None and seen.grasp is not None and seen.by == seen.settled.by == by
    outline, surface, ground = seen.settled.contact_deviations
    assert outline >= surface >= ground and outline > seen.grasp.limit
    assert (surface <= seen.grasp.limit) == bool(within) and (ground <= seen.grasp.limit) == (by != "nothing")
    assert (ground < 0.1 * outline) == bool(within or round_it)  # the ground alone leaves a disc's turn open by 1.5 px
    assert (seen.surface.settles, seen.ground.settles) == (surface, ground)
    assert (seen.level == "poor") == (within == 0) and (seen.strategy == "") == (by == "nothing")
    assert (seen.located > 0.5) == (by != "nothing")


def test_of_what_is_nearly_round_the_ground_tells_the_turn() -> None:
    image = drawn(ellipse(52.0, 50.0)).astype(float)
    grain = cv2.GaussianBlur(np.random.default_rng(3).standard_normal(image.shape), (0, 0), 2.0)
    beside = cv2.dilate((np.abs(image - image[0, 0]) > 20.0).astype(np.uint8), np.ones((13, 13))) == 0
    image = np.clip(image + 20.0 * grain / grain.std() * beside, 0, 255).astype(np.uint8)
    for strategy in ("auto", "homography"):
        # with the last image as prior that carries the contacts, and the core judges
        seen = inspect(image, strategy=strategy)
        assert seen.by == "ground" and "only the ground fixes it: on a belt it will be lost" in seen.verdict


@pytest.mark.slow
def test_what_slides_along_itself_is_expected_to_be_lost_and_found_where_its_surface_tells() -> None:
    bare, printed = (inspect(on(within, 0)) for within in (0, 1))
    assert bare.prediction is not None and bare.prediction.drawn.located == 0 and bare.prediction.drawn.reason
    assert bare.level == "poor" and bare.located < 0.2 and math.isnan(bare.error_px)
    assert printed.level != "poor" and printed.located_interval[1] == 1.0 and printed.error_px < 1.0


def test_noise_is_no_surface() -> None:
    """Whatever the noise, it fixes nothing that the outline leaves free, and the outline alone is as sure as with it."""
    for noise in (4.0, 12.0):
        seen = inspect(drawn(ellipse(50.0, 50.0), noise=noise), runs=1)
        assert seen.by == "nothing" and seen.settled is not None
        assert seen.settled.contact_deviations[1] == seen.settled.contact_deviations[0]


@pytest.mark.slow
@pytest.mark.parametrize("turn", [90.0, 180.0])
def test_a_print_ends_a_symmetry_unless_it_has_it_too(turn: float) -> None:
    """Of a square with blots, those turns are left under which the blots lie on themselves."""
    noise = cv2.GaussianBlur(np.random.default_rng(3).standard_normal((241, 241)), (0, 0), 3.0)
    own = sum(np.rot90(noise, k) for k in range(0, 4, round(turn / 90.0)))
    blots = np.zeros((240, 320))
    blots[80:161, 120:201] = (25.0 * own / own.std())[80:161, 80:161]
    plain = drawn(1.1 * SQUARE, angle=0.0).astype(float)
    assert inspect(plain.astype(np.uint8)).symmetry.order == 4
    printed = inspect(np.clip(plain + blots, 0, 255).astype(np.uint8)).symmetry
    assert printed.order == round(360.0 / turn) and printed.known
    once = np.roll(blots, 7, axis=1)
    assert inspect(np.clip(plain + once, 0, 255).astype(np.uint8)).symmetry.turns == ()


def test_an_equal_with_another_print_is_no_equal() -> None:
    both = drawn(0.8 * L_PLATE, 0.8 * L_PLATE, centres=((80.0, 70.0), (220.0, 160.0)), angle=0.0).astype(float)
    noise = [cv2.GaussianBlur(np.random.default_rng(k).standard_normal((50, 50)), (0, 0), 2.5) for k in (0, 1)]

    def printed(second: np.ndarray) -> np.ndarray:
        image = both.copy()
        for (x, y), blots in zip(((80, 70), (220, 160)), (noise[0], second), strict=True):
            part = np.clip(blots * 25.0 / blots.std(), -60.0, 60.0)[10:40, 5:45]
            image[y - 32 : y - 2, x - 48 : x - 8] += part
        return np.clip(image, 0, 255).astype(np.uint8)

    assert len(inspect(printed(noise[0]), runs=1).equals) == 1
    assert inspect(printed(noise[1]), runs=1).equals == ()


@given(sway_a=st.floats(0.0, 0.6), sway_b=st.floats(0.0, 0.6))
def test_noise_of_the_directions_only_hides_motions(sway_a: float, sway_b: float) -> None:
    points, normals = sampled(np.array([[-70, -45], [70, -45], [70, 5], [-20, 5], [-20, 45], [-70, 45]], float))
    frame = Basis(points.mean(axis=0), np.eye(2), 90.0)
    low, high = (motions_of(points, normals, frame, s) for s in sorted((sway_a, sway_b)))
    for name in MODELS:
        one, other = low.models[name], high.models[name]
        assert other.weakest <= one.weakest + 1e-9 and one.observable >= other.observable
        assert one.unswayed == pytest.approx(other.unswayed) and one.weakest <= one.unswayed + 1e-9
    assert all(b.shown <= a.shown + 1e-9 for a, b in zip(low.motions, high.motions, strict=True))

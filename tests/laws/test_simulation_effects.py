# SPDX-License-Identifier: Apache-2.0
"""Glare, rolling shutter, shake, compression, what else lies on the table, occluders that stay: each does what it says."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from edges import bilinear, flat, offsets, pan, plane_to_image, renderer
from grasptrack.geometry.homographies import apply_homography
from grasptrack_bench.simulation import (
    SHAPES,
    Conditions,
    Distractor,
    Pinhole,
    Scene,
    Shape,
    TextureMap,
    tilting_path,
)
from grasptrack_bench.simulation.camera import RollingShutter
from grasptrack_bench.simulation.lookalikes import Room
from grasptrack_bench.simulation.occluders import Drifting
from grasptrack_bench.simulation.outlines import inside_polygons
from test_simulation_disturbances import SMALL, scene

SEEDS = range(2)
PARTS = ("gasket", "half-disc", "pencil")


def shutter(made: Scene, index: int) -> RollingShutter:
    """How the rows of a frame are read out."""
    found = made[index].shutters
    assert found is not None
    return found[1]


def unit(made: Scene) -> float:
    """px to a table unit in the first frame."""
    return float(made.camera.matrix[0, 0] / made.path.distance[0])


def share_in_view(made: Scene, item: Distractor, index: int) -> float:
    H = plane_to_image(made)[index] @ item.place(index)
    seen = apply_homography(H, item.shape.samples(200))
    limit = [made.camera.width - 1, made.camera.height - 1]
    return float(np.all((seen >= 0) & (seen <= limit), axis=1).mean())


def laid(item: Distractor) -> Shape:
    return item.shape.moved(item.turn, item.shift)


def gap(a: Shape, b: Shape) -> float:
    """Least distance of two outlines; 0 where they overlap."""
    p, q = a.samples(500), b.samples(500)
    if inside_polygons([b.outer], p).any() or inside_polygons([a.outer], q).any():
        return 0.0
    return float(np.sqrt(((p[:, None] - q[None]) ** 2).sum(axis=2)).min())


# --- glare ---------------------------------------------------------------------------------------


@pytest.mark.sampled(1)
@pytest.mark.parametrize("shape", PARTS)
def test_a_highlight_saturates_its_ring_and_nothing_far_from_it(shape: str) -> None:
    made = scene("highlight", shape, 60, 3).with_conditions(noise=0.0)
    dark = made.with_conditions(glare=None)
    glare = made.conditions.glare
    assert glare is not None and [glare.ring(i) for i in range(3)] == [None] * 3
    assert (made[2].image == dark[2].image).all()
    shown = []
    for i in range(8, 60, 4):
        frame, ring = made[i], glare.ring(i)
        assert ring is not None
        pixels = np.argwhere(np.ones(frame.image.shape))[:, ::-1].astype(float)
        inner = inside_polygons([ring.mean(axis=0) + 0.97 * (ring - ring.mean(axis=0))], pixels)
        wide = ring.mean(axis=0) + (1.0 + 7.0 * glare.softness / glare.radius) * (ring - ring.mean(axis=0))
        near = inside_polygons([wide], pixels)
        image, bare = frame.image.ravel(), dark[i].image.ravel()
        assert (image[inner] == 255).all()
        assert (image[~near] == bare[~near]).all()
        assert not frame.visible(pixels[inner][:50]).any()
        width = np.ptp(ring, axis=0).max() / unit(made)
        assert 0.28 < width < 0.78
        shown.append(frame.outline_visible)
    assert max(shown) > 0.99 and min(shown) < 0.97  # it lies on the outline at times, and beside it at others
    places = np.array([ring.mean(axis=0) for i in range(7, 60) if (ring := glare.ring(i)) is not None])
    assert np.ptp(places, axis=0).min() > 0.3 * unit(made)


def test_a_highlight_grows_from_frame_three_on() -> None:
    glare = scene("highlight").conditions.glare
    assert glare is not None
    width = [float(np.ptp(ring[:, 0])) for i in range(3, 9) if (ring := glare.ring(i)) is not None]
    assert width == sorted(width) and width[0] == pytest.approx(0.25 * width[-1])


# --- rolling shutter -----------------------------------------------------------------------------


def test_rows_read_out_later_lie_farther_on() -> None:
    """A pan skews an upright edge by its speed times the time between the rows: the image and the truth agree."""
    step, readout = 9.0, 0.8
    light = Conditions(noise=0.0, readout=readout)
    given = {"camera": Pinhole(*SMALL), "table": flat(200), "surface": flat(50)}
    path = pan(step, 6, given["camera"])
    made = Scene(SHAPES["square"](), path, conditions=light, **given)
    plain = Scene(SHAPES["square"](), path, conditions=replace(light, readout=0.0), **given)
    frame = made[3]
    at = np.array([[100.0, 80.0], [100.0, 119.5], [200.0, 160.0]])
    expected = at - np.column_stack([step * readout * (at[:, 1] - 119.5) / 239.0, np.zeros(3)])
    rolled = shutter(made, 3)
    table = apply_homography(np.linalg.inv(plane_to_image(plain)[3]), at)
    assert rolled.project(table, made.camera) == pytest.approx(expected, abs=1e-6)
    off = offsets(frame.image, frame.outline, 50, 200)
    assert len(off) > 100 and abs(off.mean()) < 0.01 and off.std() < 0.02
    wrong = offsets(frame.image, plain[3].outline, 50, 200)
    assert np.abs(wrong).max() > 0.5


def test_a_rolled_point_is_where_its_own_rows_homography_sends_it() -> None:
    made = scene("rolling-shutter", "gasket", 40, 2)
    rolled, readout = shutter(made, 17), made.conditions.readout
    assert 0.6 <= readout <= 0.9
    plane = made.shape.samples(40)
    seen = rolled.project(plane, made.camera)
    assert np.abs(rolled.back(seen, made.camera) - plane).max() < 1e-9
    for point, px in zip(plane, seen, strict=True):
        late = readout * (px[1] / (made.camera.height - 1) - 0.5)
        H = made.path.between(17, [late]).table_to_image(made.camera)[0]
        assert apply_homography(H, point[None])[0] == pytest.approx(px, abs=2e-3)
    away = seen - apply_homography(plane_to_image(made)[17], plane)
    assert np.hypot(*away.T).max() > 0.05


def test_a_texture_goes_through_lens_and_shutter_as_the_outline_does() -> None:
    size, extent = 512, 2.0
    ramp = np.tile(np.linspace(20, 235, size), (size, 1)).astype(np.uint8)
    for lens, readout in ((0.0, 0.9), (-0.2, 0.9), (-0.2, 0.0)):
        camera = Pinhole(*SMALL, k1=lens)
        made = Scene(
            SHAPES["disc"](),
            replace(tilting_path(6, seed=4), target=pan(12.0, 6, Pinhole(*SMALL)).target),
            camera=camera,
            table=TextureMap(ramp, extent),
            conditions=Conditions(noise=0.0, readout=readout),
        )
        seen_by = shutter(made, 3) if readout else plane_to_image(made)[3]
        at = np.random.default_rng(1).uniform([-0.9, -0.6], [0.9, 0.6], (200, 2))
        seen = seen_by.project(at, camera) if readout else camera.distort(apply_homography(seen_by, at))
        use = np.all((seen > 2) & (seen < [SMALL[0] - 3, SMALL[1] - 3]), axis=1)
        value = bilinear(renderer(made).render_background(seen_by).astype(float), seen[use])
        expected = 20 + (at[use, 0] + extent) / (2 * extent) * 215
        assert use.sum() > 100 and np.abs(value - expected).max() < 1.5


def test_no_readout_is_the_limit_of_a_short_one() -> None:
    made = scene("rolling-shutter", frames=10, size=SMALL).with_conditions(noise=0.0, readout=1e-9)
    at_once = made.with_conditions(readout=0.0)
    assert np.abs(made[6].image.astype(int) - at_once[6].image).max() <= 2
    assert made[6].carry([[100.0, 90.0]]) == pytest.approx(at_once[6].carry([[100.0, 90.0]]), abs=1e-5)


def test_effects_combine() -> None:
    """Rolling rows, a lens, a thick part, motion blur, glare, compression, a sheet and a neighbour in one image."""
    first, sheet = scene("highlight", frames=20), scene("sheet", frames=20).distractors
    light = replace(first.conditions, exposure=0.3, readout=0.6, jpeg=90)
    beside = Distractor(SHAPES["star"](), flat(90), shift=(1.6, 0.0))
    made = Scene(
        first.shape,
        first.path,
        camera=Pinhole(k1=-0.1),
        conditions=light,
        distractors=(*sheet, beside),
        thickness=0.05,
        colour=True,
    )
    frame, start = made[9], made[0]
    points = np.concatenate(start.outline)
    assert np.abs(frame.carry(points) - np.concatenate(frame.outline)).max() < 1e-8
    assert np.abs(frame.back(frame.carry(points)) - points).max() < 1e-8
    assert frame.image.shape == (480, 640, 3) and len(frame.covers) == 1


# --- exposure, compression, noise ----------------------------------------------------------------


@pytest.mark.parametrize("seed", SEEDS)
def test_a_shaking_hand_is_fast_and_irregular_and_begins_at_rest(seed: int) -> None:
    made = scene("shake", frames=50, seed=seed)
    middle = np.array([apply_homography(H, [[0.0, 0.0]])[0] for H in plane_to_image(made)])
    steps = np.diff(middle, axis=0)
    speed = np.hypot(*steps.T)
    assert 10.0 < speed.max() < 16.0 and speed[0] < 4.0 and np.median(speed) > 3.0
    turns = (steps[1:] * steps[:-1]).sum(axis=1) < 0.0
    assert 8 < turns.sum() < 40  # it turns back every few frames, and not in every one
    assert made.conditions.exposure == 0.8


def test_a_shaken_image_is_smeared() -> None:
    made = scene("shake", frames=30, seed=1).with_conditions(noise=0.0)
    sharp = made.with_conditions(exposure=0.0)
    middle = np.array([apply_homography(H, [[0.0, 0.0]])[0] for H in plane_to_image(made)])
    i = 1 + int(np.argmax(np.hypot(*(middle[2:] - middle[:-2]).T)))

    def detail(image: np.ndarray) -> float:
        return float(np.percentile(np.abs(cv2.Laplacian(image.astype(float), cv2.CV_64F)), 99.5))

    assert detail(made[i].image) < 0.7 * detail(sharp[i].image)
    assert detail(made[0].image) > 0.75 * detail(sharp[0].image)


def test_compression_comes_last() -> None:
    made = scene("jpeg", frames=5, size=SMALL)
    assert made.conditions.noise == 8.0 and made.conditions.jpeg == 30
    taken = made.with_conditions(jpeg=0)[3].image
    code = cv2.imencode(".jpg", taken, [cv2.IMWRITE_JPEG_QUALITY, 30])[1]
    assert (made[3].image == cv2.imdecode(code, cv2.IMREAD_GRAYSCALE)).all()
    assert 2.0 < (made[3].image.astype(float) - taken).std() < 15.0


def test_nothing_moves_in_a_still_scene() -> None:
    made = scene("still", frames=20, size=SMALL)
    quiet = made.with_conditions(noise=0.0)
    assert all((quiet[i].image == quiet[0].image).all() for i in (5, 19))
    assert all(np.allclose(made[i].H_current_reference, np.eye(3), atol=1e-12) for i in (5, 19))
    noise = made[19].image.astype(float) - made[5].image
    assert noise.std() == pytest.approx(math.sqrt(2.0) * made.conditions.noise, rel=0.03)


# --- the table -----------------------------------------------------------------------------------


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", SEEDS)
def test_gravel_is_strong_and_its_pebbles_are_as_large_as_said(seed: int) -> None:
    made, plain = scene("gravel", seed=seed), scene("clean-4dof", seed=seed)
    image = made.with_conditions(noise=0.0, vignette=0.0)[0].image.astype(float)
    corner = image[:110, :200]
    contrast = abs(float(plain.surface.grey.image.mean()) - float(plain.table.grey.image.mean()))
    assert 0.2 * contrast < corner.std() < 0.6 * contrast
    field = corner - corner.mean()
    by_lag = [(field[:, : 200 - k] * field[:, k:]).mean() / (field**2).mean() for k in range(1, 25)]
    half = next(k for k, c in enumerate(by_lag, 1) if c < 0.5)
    assert 2 <= half <= 6  # discs of diameter d are half as alike at some 0.4 d
    assert max(abs(c) for c in by_lag[15:]) < 0.2


def test_a_sheet_is_somewhat_larger_than_the_part_and_at_times_parallel_to_it() -> None:
    turned, moving = [], []
    for seed in range(12):
        made = scene("sheet", "rectangle", frames=10, seed=seed)
        (sheet,) = made.distractors
        ring = laid(sheet).outer
        part = made.shape.outer
        assert inside_polygons([ring], part).all()
        assert 1.1 < cv2.contourArea(ring.astype(np.float32)) / cv2.contourArea(part.astype(np.float32)) < 4.5
        assert gap_inside(part, ring) < 0.45
        turned.append(abs(math.sin(2.0 * sheet.turn)) > 1e-6)
        moving.append(bool(np.any(made.slide)))
        assert np.ptp(sheet.surface.image) < 20 if sheet.surface is not None else False
    assert 2 <= sum(turned) <= 10 and 2 <= sum(moving) <= 10


def gap_inside(inner: np.ndarray, outer: np.ndarray) -> float:
    """Least distance between two nested rings."""
    a, b = Shape("", inner).samples(300), Shape("", outer).samples(300)
    return float(np.sqrt(((a[:, None] - b[None]) ** 2).sum(axis=2)).min())


def test_a_sheet_goes_with_the_part() -> None:
    seed = next(k for k in range(12) if np.any(scene("sheet", frames=4, seed=k).slide))
    made = scene("sheet", frames=30, seed=seed).with_conditions(noise=0.0, drift=0.0, vignette=0.0)
    (sheet,) = made.distractors
    level = float(sheet.surface.image.mean()) if sheet.surface is not None else -1.0
    paper = [
        p for p in laid(sheet).outer @ np.diag([0.97, 0.97]) if not inside_polygons([made.shape.outer], p[None])[0]
    ]
    for i in (0, 15, 29):
        seen = apply_homography(plane_to_image(made)[i], np.array(paper))
        use = np.all((seen > 2) & (seen < [636, 476]), axis=1)
        assert np.abs(bilinear(made[i].image.astype(float), seen[use]) - level).max(initial=0.0) < 12.0


# --- parts beside it -----------------------------------------------------------------------------


@pytest.mark.sampled(1)
@pytest.mark.parametrize("shape", [*PARTS, "spanner"])
def test_equal_parts_lie_beside_it_from_the_first_frame_on(shape: str) -> None:
    counts = set()
    for seed in range(5):
        made = scene("equals", shape, frames=8, seed=seed)
        counts.add(len(made.distractors))
        parts = [made.shape, *(laid(d) for d in made.distractors)]
        assert all(gap(a, b) > 0.02 for k, a in enumerate(parts) for b in parts[:k])
        for item in made.distractors:
            assert item.shape is made.shape and item.surface is None and item.times is None
            assert share_in_view(made, item, 0) >= 0.69
    assert counts <= {1, 2, 3} and len(counts) > 1


def test_an_equal_part_looks_the_same() -> None:
    made = scene("equals", frames=4, seed=1).with_conditions(noise=0.0, vignette=0.0)
    image, H = made[0].image.astype(float), plane_to_image(made)[0]
    inner = 0.7 * made.shape.samples(200)
    inner = inner[inside_polygons(made.shape.polygons, inner)]
    own = bilinear(image, apply_homography(H, inner))
    for item in made.distractors:
        seen = apply_homography(H @ item.place(0), inner)
        use = np.all((seen > 2) & (seen < [636, 476]), axis=1)
        assert use.sum() > 30
        assert np.abs(bilinear(image, seen[use]) - own[use]).mean() < 3.0


@pytest.mark.sampled(1)
@pytest.mark.parametrize("shape", PARTS)
def test_an_equal_part_enters_while_the_first_is_partly_covered(shape: str) -> None:
    moves = set()
    for seed in (3, 4):  # it comes by itself, or is laid down
        made = scene("equal-enters", shape, frames=60, seed=seed, size=SMALL)
        (item,) = made.distractors
        seen = [share_in_view(made, item, i) for i in range(60)]
        assert seen[0] == 0.0 and seen[1] < 0.1
        assert max(seen[25:45]) > 0.4
        shown = [made[i].outline_visible for i in (0, 26, 30, 34, 59)]
        assert shown[0] == shown[-1] == 1.0 and all(0.6 < v < 0.85 for v in shown[1:4])
        assert gap(made.shape, laid(item)) > 0.02
        moves.add(item.times is None)
    assert moves == {True, False}


@pytest.mark.parametrize("seed", SEEDS)
def test_a_crowd_is_of_other_parts_some_of_which_nearly_touch(seed: int) -> None:
    made = scene("crowd", "bracket", frames=4, seed=seed)
    parts = [made.shape, *(laid(d) for d in made.distractors)]
    gaps = [gap(a, b) * unit(made) for k, a in enumerate(parts) for b in parts[:k]]
    assert len(parts) >= 4 and len({p.name for p in parts}) == len(parts)
    assert min(gaps) > 1.5 and min(gaps) < 12.0


def test_room_on_a_table_is_the_distance_to_what_lies_there() -> None:
    room = Room([SHAPES["square"](), SHAPES["disc"]().moved(0.0, (2.0, 0.0))])
    radius = 1.0 / math.sqrt(math.pi)
    at = np.array([[0.0, 0.0], [0.9, 0.0], [0.0, -2.5], [2.0, 0.0], [2.0, 1.5], [-1.5, -1.5]])
    expected = [0.0, 0.4, 2.0, 0.0, 1.5 - radius, math.sqrt(2.0)]
    assert room.clearance(at) == pytest.approx(expected, abs=0.03)
    shift = room.pushed_up(SHAPES["square"](), math.pi, 0.3)
    assert shift is not None and shift == pytest.approx((-1.3, 0.0), abs=0.03)


def test_a_distractor_comes_to_its_place_and_stays() -> None:
    item = Distractor(SHAPES["star"](), turn=0.3, shift=(1.0, 0.5), away=(4.0, 0.0), times=(5.0, 15.0))
    assert [item.place(i)[0, 2] for i in (0, 5, 10, 15, 30)] == pytest.approx([5.0, 5.0, 3.0, 1.0, 1.0])
    moved = apply_homography(item.place(20), item.shape.outer)
    assert moved == pytest.approx(laid(item).outer)


# --- occluders that stay -------------------------------------------------------------------------


@pytest.mark.sampled(1)
@pytest.mark.parametrize("shape", PARTS)
def test_a_cover_stays_moves_slowly_and_hides_no_more_than_it_may(shape: str) -> None:
    for seed in range(2):
        made = scene("cover", shape, frames=60, seed=seed, size=SMALL)
        (over,) = made.covers
        assert isinstance(over, Drifting) and made[1].outline_visible == 1.0
        points = made.shape.samples(1000)
        rings = [over.placed(i) for i in range(60)]
        hidden = [float(inside_polygons([r], points).mean()) if r is not None else 0.0 for r in rings]
        assert max(hidden) <= 0.31 and np.mean(hidden[20:]) > 0.1 and max(hidden[20:]) > 0.2
        assert np.hypot(*np.diff(over.way[16:], axis=0).T).max() * unit(made) < 12.0
        seen = made[40]
        assert seen.outline_visible == pytest.approx(1.0 - hidden[40], abs=0.08)  # tilted, sides are not equally long


@pytest.mark.parametrize("shape", ["rectangle", "bracket", "half-disc", "bottle", "disc"])
def test_a_bars_edge_rests_parallel_to_a_side_some_pixels_inside_it(shape: str) -> None:
    for seed in range(3):
        made = scene("bar-parallel", shape, frames=60, seed=seed)
        (bar,) = made.covers
        assert isinstance(bar, Drifting)
        assert bar.placed(0) is None and bar.placed(59) is None
        outline = made.shape.samples(2000)
        for i in range(20, 44, 4):
            ring = bar.placed(i)
            assert ring is not None
            edge = ring[3] - ring[0]
            along = edge / np.hypot(*edge)
            out = (ring[1] - ring[0]) / np.hypot(*(ring[1] - ring[0]))
            depth = (outline @ out).max() - ring[0] @ out
            assert 3.0 - 0.01 <= depth * unit(made) <= 12.0 + 0.01
            assert abs(along @ out) < 1e-9
            farthest = outline[(outline @ out).max() - outline @ out < 0.012]
            assert np.ptp(farthest @ along) > (0.15 if shape == "disc" else 0.25)  # a whole side, not a corner
        assert 0.6 < made[30].outline_visible < 0.97


# --- thickness and prints ------------------------------------------------------------------------


def test_thin_parts_are_thin_and_tilt_less() -> None:
    made = [scene("thick-6", frames=20, seed=k, size=SMALL) for k in range(8)]
    assert all(0.02 <= m.thickness <= 0.06 for m in made)
    assert all(m.path.tilt.max() == pytest.approx(math.radians(20.0)) for m in made)


def test_the_camera_comes_over_what_it_first_sees_from_aside() -> None:
    made = [scene("aside", frames=20, seed=k, size=SMALL) for k in range(8)]
    assert all(0.02 <= m.thickness <= 0.1 for m in made)
    assert all(m.path.tilt[0] == pytest.approx(math.radians(25.0)) for m in made)
    assert all(np.all(np.diff(m.path.tilt) <= 0.0) and m.path.tilt[-4:].max() < 1e-9 for m in made)


@pytest.mark.parametrize("seed", SEEDS)
def test_prints_are_stronger_than_bare_surfaces_and_are_exchanged(seed: int) -> None:
    made = scene("print", frames=10, seed=seed, size=SMALL)
    image = made.surface.grey.image.astype(float)
    assert image.std() > 8.0 and np.degrees(made.path.tilt.max()) == pytest.approx(28.0)
    swap = scene("print-exchange", frames=40, seed=seed)
    (guest,) = swap.guests
    assert guest.shape is swap.shape and guest.surface is not None
    own, other = swap.surface.grey.image.astype(float), guest.surface.grey.image.astype(float)
    assert own.shape == other.shape and abs(own.mean() - other.mean()) < 6.0
    assert np.corrcoef(own.ravel(), other.ravel())[0, 1] < 0.6
    assert not swap[20].present and swap[39].present


def test_a_surface_and_a_table_of_ones_own_win() -> None:
    assert (scene("print", surface=flat(90), frames=2)._renderer._surface.image == 90).all()
    assert (scene("gravel", table=flat(190), frames=2)._renderer._table.image == 190).all()


def test_a_cover_that_reaches_behind_the_camera_is_not_in_view() -> None:
    ring = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    cover = Drifting(ring, np.zeros((1, 2)))
    H = np.array([[100.0, 0.0, 320.0], [0.0, 100.0, 240.0], [0.0, 1.5, 1.0]])  # the horizon runs through the cover
    assert cover.polygon(0, H, Pinhole()) is None
    H[2, 1] = 0.5
    assert cover.polygon(0, H, Pinhole()) is not None

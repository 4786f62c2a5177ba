# SPDX-License-Identifier: Apache-2.0
"""From an image to outlines: the right object, its holes, what the border cuts, to a tenth of a pixel."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasptrack import SourceError, open_source
from grasptrack.errors import ObservationError
from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.contacts import Grasp
from grasptrack.io.masks import open_masks, read_mask
from grasptrack.io.video import VideoWriter
from grasptrack.segmentation.closed_edges import lab_planes
from grasptrack.segmentation.contact_cut import region_at_contacts
from grasptrack.segmentation.first_look import find_candidates
from grasptrack.segmentation.proposals import MIN_EXTENT
from grasptrack.segmentation.silhouettes import candidate_thresholds, otsu_threshold
from grasptrack.tracking.initialization import object_at_contacts
from grasptrack_bench.method import chosen_grasp
from grasptrack_bench.scenes import SceneCase, ScenePart
from grasptrack_bench.simulation import SHAPES, SceneFrame, brushed_texture, plain_texture
from outlines import segment_object
from stages import EVEN, HEIGHT, WIDTH, photo, pose

BRACKET, GASKET, PLATE, DISC, FORK = (SHAPES[n]() for n in ("bracket", "gasket", "notched-plate", "disc", "fork"))
LIGHT, DARK_GROUND = (
    brushed_texture(3, colour=(190, 195, 200), extent=4.0, contrast=0.0),
    plain_texture(3, colour=(45, 45, 45), contrast=0.0),
)
PLAIN, DULL = plain_texture(2, contrast=0.0), brushed_texture(1, extent=4.0, contrast=0.0)


def distances(points: np.ndarray, polygon: np.ndarray) -> np.ndarray:
    """(n,) px from points to a closed polygon's sides."""
    a, b = polygon, np.roll(polygon, -1, axis=0)
    side = b - a
    t = np.clip(((points[:, None] - a) * side).sum(axis=2) / (side**2).sum(axis=1), 0.0, 1.0)
    return np.asarray(np.hypot(*(points[:, None] - a - t[..., None] * side).transpose(2, 0, 1)).min(axis=1))


@pytest.mark.parametrize("light", [False, True])
@pytest.mark.parametrize("shape", [BRACKET, GASKET, PLATE, SHAPES["blob"]()], ids=lambda s: s.name)
def test_the_outline_is_right_to_a_tenth_of_a_pixel(shape, light: bool) -> None:  # type: ignore[no-untyped-def]
    H = pose(161.3, 118.6, 17.0, tilt=15.0)
    ground, surface = (DARK_GROUND, LIGHT) if light else (PLAIN, DULL)
    view = segment_object(photo([(shape, H)], ground=ground, surface=surface, noise=0.0))
    assert len(view.contours) == len(shape.polygons)
    assert not view.is_clipped
    truth = [apply_homography(H, p) for p in shape.polygons]
    assert np.sqrt(np.mean(distances(view.outer.points, truth[0]) ** 2)) < 0.1
    for hole in view.contours[1:]:
        nearest = min(truth[1:], key=lambda p: float(np.hypot(*(p.mean(axis=0) - hole.points.mean(axis=0)))))
        assert np.sqrt(np.mean(distances(hole.points, nearest) ** 2)) < 0.15


@pytest.mark.parametrize("light", [False, True])
@pytest.mark.parametrize("scale, degrees", [(60.0, 140.0), (75.0, 20.0), (75.0, 140.0)])
def test_gaps_that_closed_edges_bridge_stay_open(light: bool, scale: float, degrees: float) -> None:
    H = pose(degrees=degrees, scale=scale, tilt=30.0)
    ground, surface = (DARK_GROUND, LIGHT) if light else (PLAIN, DULL)
    view = segment_object(photo([(FORK, H)], ground=ground, surface=surface))
    assert distances(apply_homography(H, FORK.polygons[0]), view.outer.points).max() < 3.0


@pytest.mark.parametrize("gap", [7.0, 9.0, 11.0])
def test_equals_side_by_side_are_two_objects(gap: float) -> None:
    beside = [pose(x=160.0 + side * 0.5 * (75.0 + gap)) for side in (-1, 1)]
    image = photo([(SHAPES["square"](), H) for H in beside], ground=PLAIN)
    assert np.ptp(segment_object(image).outer.points[:, 0]) < 80.0


@pytest.mark.parametrize("light", [False, True])
def test_polarity_and_levels(light: bool) -> None:
    ground, surface = (DARK_GROUND, LIGHT) if light else (PLAIN, DULL)
    best = find_candidates(photo([(PLATE, pose())], ground=ground, surface=surface))[0]
    assert best.polarity == (-1 if light else 1)
    assert (best.inside > best.outside) is light
    assert min(best.inside, best.outside) < best.level < max(best.inside, best.outside)


def test_contours_carry_strength_and_direction() -> None:
    view = segment_object(photo([(GASKET, pose())], ground=EVEN))
    assert view.outer.strength is not None
    assert np.median(view.outer.strength) > 20.0
    assert view.outer.signed_area > 0.0
    assert all(h.hole and h.signed_area < 0.0 for h in view.contours[1:])
    areas = np.array([h.area for h in view.contours[1:]])
    assert (np.diff(areas) < 1.0).all()


def test_the_object_under_a_pixel() -> None:
    image = photo([(BRACKET, pose(85.0, 120.0, scale=60.0)), (DISC, pose(245.0, 120.0, scale=60.0))])
    assert segment_object(image, object_at=(245.0, 120.0)).outer.points[:, 0].min() > 180.0
    assert segment_object(image, object_at=(75.0, 105.0)).outer.points[:, 0].max() < 180.0
    with pytest.raises(ObservationError, match="at 165,15"):
        segment_object(image, object_at=(165.0, 15.0))


@pytest.mark.parametrize(("x", "y", "side"), [(20.0, 120.0, 0), (300.0, 120.0, 1), (160.0, 20.0, 2), (160.0, 220.0, 3)])
def test_the_border_marks_what_it_cuts_and_nothing_else(x: float, y: float, side: int) -> None:
    view = segment_object(photo([(DISC, pose(x, y, scale=60.0))], ground=EVEN))
    assert view.is_clipped
    cut = view.outer.clipped
    assert cut is not None
    px, py = view.outer.points.T
    beyond = (px < 1.5, px > WIDTH - 2.5, py < 1.5, py > HEIGHT - 2.5)[side]
    assert np.count_nonzero(cut != beyond) <= 4  # flags are set before the points move to their edges
    assert 0.02 < cut.mean() < 0.5
    whole = apply_homography(pose(x, y, scale=60.0), DISC.outer)
    inner = ~cut & (np.abs(view.outer.points - np.array([WIDTH, HEIGHT]) / 2) < np.array([WIDTH, HEIGHT]) / 2 - 5).all(
        axis=1
    )
    assert distances(view.outer.points[inner], whole).max() < 0.6


def test_what_is_ignored_is_cut_off_and_no_object() -> None:
    image = photo([(DISC, pose(100.0, 120.0, scale=60.0)), (PLATE, pose(240.0, 120.0, scale=50.0))])
    ignore = np.zeros((HEIGHT, WIDTH), np.uint8)
    ignore[:, :165] = 9
    assert segment_object(image, ignore=ignore).outer.points[:, 0].min() > 160.0
    ignore[:] = 0
    ignore[100:140, :80] = 9
    view = segment_object(image, object_at=(110.0, 120.0), ignore=ignore)
    cut = view.outer.clipped
    assert cut is not None
    assert (view.outer.points[cut][:, 0] < 90.0).all()


def test_print_and_dark_spots_are_no_holes() -> None:
    image = photo([(PLATE, pose())], ground=PLAIN, surface=DULL)
    image[110:125, 140:160] = 30
    image[115:128, 175:190] = 110
    assert len(segment_object(image).contours) == 1


@pytest.mark.parametrize("level", [0, 7, 128, 255])
def test_an_even_image_has_no_object(level: int) -> None:
    with pytest.raises(ObservationError, match="no object stands out"):
        segment_object(np.full((HEIGHT, WIDTH), level, np.uint8))


def test_noise_and_a_gradient_are_no_objects() -> None:
    rng = np.random.default_rng(0)
    noise = np.clip(rng.normal(120.0, 5.0, (HEIGHT, WIDTH)), 0, 255).astype(np.uint8)
    slope = np.broadcast_to(np.linspace(60, 200, WIDTH).astype(np.uint8), (HEIGHT, WIDTH)).copy()
    for image in (noise, slope):
        with pytest.raises(ObservationError):
            segment_object(image)


def test_a_tiny_object_is_named_with_its_size() -> None:
    with pytest.raises(ObservationError, match=rf"px across; at least {MIN_EXTENT} px are needed") as caught:
        segment_object(photo([(DISC, pose(scale=12.0))], ground=PLAIN, surface=DULL))
    assert 10 <= caught.value.values["extent"] <= 18


def test_an_object_of_twenty_five_pixels_and_one_that_fills_the_view() -> None:
    small = segment_object(photo([(PLATE, pose(scale=25.0))], ground=PLAIN, surface=DULL))
    assert small.outer.area == pytest.approx(25.0**2, rel=0.05)
    large = segment_object(photo([(SHAPES["rectangle"](), pose(scale=175.0))], ground=PLAIN, surface=DULL))
    assert large.outer.area == pytest.approx(175.0**2, rel=0.02)


def test_low_contrast_and_strong_noise() -> None:
    faint = brushed_texture(5, colour=(165, 168, 168), contrast=0.0, extent=4.0)
    view = segment_object(photo([(BRACKET, pose())], ground=PLAIN, surface=faint, noise=1.5))
    assert view.outer.area == pytest.approx(75.0**2, rel=0.05)
    view = segment_object(photo([(BRACKET, pose())], noise=10.0))
    truth = apply_homography(pose(), BRACKET.outer)
    assert np.sqrt(np.mean(distances(view.outer.points, truth) ** 2)) < 0.5


def test_otsu_separates_two_levels() -> None:
    histogram = np.zeros(256)
    histogram[[50, 180]] = 900, 100
    level = otsu_threshold(histogram)
    assert level is not None and 50 < level < 180
    histogram[180] = 0
    assert otsu_threshold(histogram) is None
    assert candidate_thresholds(np.full(10, 3, np.uint8)) == []


# --- given contacts ------------------------------------------------------------------------------


def object_on(case: SceneCase) -> tuple[View, SceneFrame]:
    """The object that is found under a scene's own contacts in its first image."""
    frame = case.scene()[0]
    grasp = Grasp(chosen_grasp(frame.outline))
    said = FirstImage.of(grasp=grasp.contacts).within(frame.image.shape)
    return object_at_contacts(find_candidates(frame.image, said), grasp).view, frame


@pytest.mark.parametrize("name", ["egg", "key", "spanner"])
def test_contacts_find_a_part_that_hardly_differs_from_its_ground(name: str) -> None:
    view, frame = object_on(SceneCase(ScenePart(SHAPES[name]()), "faint", frames=8, seed=4001))
    assert np.quantile(distances(np.vstack(frame.outline[:1]), view.outer.points), 0.9) < 3.0


@pytest.mark.parametrize("kind", ["glossy-table", "touching"])
def test_contacts_in_a_hole_find_the_part_round_it(kind: str) -> None:
    view, frame = object_on(SceneCase(ScenePart(SHAPES["gear"]()), kind, frames=8, seed=4001))
    assert np.quantile(distances(frame.outline[0], view.outer.points), 0.9) < 2.0
    assert distances(chosen_grasp(frame.outline), view.contours[1].points).max() < 2.0


@settings(max_examples=20)
@given(
    turn=st.floats(0.0, 360.0),
    step=st.sampled_from([-60.0, -25.0, 25.0, 60.0]),
    noise=st.floats(0.0, 4.0),
    seed=st.integers(0, 99),
)
def test_the_cut_is_the_region_between_contacts(turn: float, step: float, noise: float, seed: int) -> None:
    drawn = np.full((240, 320), 128.0, np.float32)
    cv2.ellipse(drawn, (160, 120), (70, 40), turn, 0.0, 360.0, 128.0 + step, cv2.FILLED, cv2.LINE_AA)
    truth = np.abs(drawn - 128.0) > 0.5 * abs(step)
    image = np.clip(drawn + np.random.default_rng(seed).normal(0.0, noise, drawn.shape), 0, 255).astype(np.uint8)
    way = 40.0 * np.array([-math.sin(math.radians(turn)), math.cos(math.radians(turn))])
    contacts = np.array([160.0, 120.0]) + way * np.array([[1.0], [-1.0]])
    region = region_at_contacts(lab_planes(image), contacts, 100.0)
    assert region is not None
    inside = region.filled_window((0, 0, 320, 240)) > 0
    assert (inside & truth).sum() > 0.93 * (inside | truth).sum()
    again = region_at_contacts(lab_planes(image), contacts[::-1], 100.0)
    assert again is not None and np.array_equal(again.outer, region.outer)


@settings(max_examples=40)
@given(
    contacts=st.lists(st.tuples(st.floats(-5.0, 95.0), st.floats(-5.0, 65.0)), min_size=2, max_size=4),
    size=st.tuples(st.integers(3, 60), st.integers(3, 90)),
    flat=st.booleans(),
)
def test_no_contacts_and_no_image_stop_the_cut(
    contacts: list[tuple[float, float]], size: tuple[int, int], flat: bool
) -> None:
    image = np.full(size, 77, np.uint8) if flat else np.random.default_rng(1).integers(0, 256, size, np.uint8)
    region = region_at_contacts(lab_planes(image), np.array(contacts), 30.0)
    assert region is None or region.area >= 30.0


def test_contacts_move_with_the_picture_that_is_cut_out() -> None:
    said = FirstImage.of(grasp=[(30.0, 40.0), (60.0, 80.0)]).in_window(10, 20, 100, 200)
    assert said.grasp is not None and said.grasp.contacts.tolist() == [[20.0, 20.0], [50.0, 60.0]]


# --- masks ----------------------------------------------------------------------------------------


SIZE = (40, 50)


def marked(column: int, size: tuple[int, int] = SIZE) -> np.ndarray:
    mask = np.zeros(size, np.uint8)
    mask[5:20, column] = 1
    return mask


def folders(tmp_path: Path, frames: list[str], masks: list[str]) -> tuple[Path, Path]:
    for folder, names in (("frames", frames), ("masks", masks)):
        (tmp_path / folder).mkdir()
        for i, name in enumerate(names):
            image = np.full(SIZE, 99, np.uint8) if folder == "frames" else marked(i)
            cv2.imwrite(str(tmp_path / folder / name), image)
    return tmp_path / "frames", tmp_path / "masks"


def columns(frames: Path, masks: Path) -> list[int]:
    source = open_source(frames)
    found = open_masks(masks, source)
    return [int(found.mask_for(frame).any(axis=0).argmax()) for frame in source]


def test_by_name_even_when_the_order_differs_and_masks_are_left_over(tmp_path: Path) -> None:
    paths = folders(tmp_path, ["b.bmp", "a.bmp"], ["a.png", "b.png", "c.png"])
    assert columns(*paths) == [0, 1]


def test_by_order_when_no_name_matches(tmp_path: Path) -> None:
    paths = folders(tmp_path, ["f1.png", "f2.png", "f10.png"], ["m8.png", "m9.png", "m10.png"])
    assert columns(*paths) == [0, 1, 2]


def test_by_order_for_a_video(tmp_path: Path) -> None:
    _, masks = folders(tmp_path, [], [f"{i:03d}.png" for i in range(4)])
    writer = VideoWriter(tmp_path / "v.mp4")
    for _ in range(4):
        writer.write(np.zeros((*SIZE, 3), np.uint8))
    writer.close()
    assert columns(tmp_path / "v.mp4", masks) == [0, 1, 2, 3]
    (masks / "003.png").unlink()
    with pytest.raises(SourceError, match="3 masks for 4 frames"):
        columns(tmp_path / "v.mp4", masks)


def test_what_does_not_match_is_said(tmp_path: Path) -> None:
    frames, masks = folders(tmp_path, ["1.png", "2.png"], ["1.png"])
    with pytest.raises(SourceError, match=r'none for frame "2.png"'):
        columns(frames, masks)
    (masks / "1.png").rename(masks / "x.png")
    with pytest.raises(SourceError, match="1 masks for 2 frames"):
        columns(frames, masks)
    cv2.imwrite(str(masks / "1.png"), marked(0))
    cv2.imwrite(str(masks / "2.png"), marked(0, (20, 30)))
    with pytest.raises(SourceError, match=r'"2.png" is 30x20 px, but frame 1 is 50x40'):
        columns(frames, masks)
    with pytest.raises(SourceError, match="no such folder"):
        open_masks(tmp_path / "nope")


def test_any_value_but_black_counts_in_any_kind_of_file(tmp_path: Path) -> None:
    mask = marked(7)
    expected = mask * np.uint8(255)
    alpha = np.dstack([np.full((*SIZE, 3), 255, np.uint8), expected])
    for name, image in {
        "labels.png": mask,
        "deep.png": mask.astype(np.uint16),
        "colour.png": np.dstack([0 * mask, mask, 0 * mask]),
        "alpha.png": alpha,
    }.items():
        cv2.imwrite(str(tmp_path / name), image)
        np.testing.assert_array_equal(read_mask(tmp_path / name), expected, err_msg=name)


def test_the_noise_of_a_jpeg_is_no_object(tmp_path: Path) -> None:
    mask = np.zeros((64, 64), np.uint8)
    mask[20:40, 20:40] = 255
    cv2.imwrite(str(tmp_path / "m.jpg"), mask, [cv2.IMWRITE_JPEG_QUALITY, 60])
    assert (read_mask(tmp_path / "m.jpg") != mask).mean() < 0.01

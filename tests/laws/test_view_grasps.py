# SPDX-License-Identifier: Apache-2.0
"""The picture of synthesised grasps: legible for any image and object, and its parts where they belong."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from grasptrack.geometry.contours import Contour, View
from grasptrack.grasp.contacts import GraspList
from grasptrack.grasp.hand import HandPx
from grasptrack.view.draw import sector_polygon
from grasptrack.view.grasps import Planned, describe_hand, format_quality, write_grasps
from grasptrack.view.panel import (
    contour_strip,
    grasp_opening,
    image_window,
    inward_normals,
    panel_grid,
    quiet_corner,
    slip_strips,
)
from ranked import across, ellipse, hand_for, ranked

SQUARE = Contour([[10, 10], [25, 10], [40, 10], [40, 25], [40, 40], [25, 40], [10, 40], [10, 25]])
RING = View([ellipse(80, 60, (160, 120)), ellipse(40, 30, (160, 120), hole=True)])
PLATE = ellipse(80, 60, (160, 120))
NONE = GraspList([], "too wide for the opening of 20 px", {"too wide for the opening of 20 px": 812, "no room": 3})


def planned(outline: Contour | View, grasps: GraspList, *neighbours: Contour) -> Planned:
    view = outline if isinstance(outline, View) else View(outline)
    return Planned(view, [View(n) for n in neighbours], hand_for(view), grasps)


def drawn(
    tmp_path: Path,
    image: np.ndarray,
    *objects: Planned,
    title: str = "plate.png",
    mm: float | None = None,
    fingers: int = 2,
) -> np.ndarray:
    before = image.copy()
    write_grasps(tmp_path / "g.png", image, objects, fingers=fingers, friction=0.5, title=title, px_per_mm=mm)
    assert [p.name for p in tmp_path.iterdir()] == ["g.png"] and (image == before).all()
    page = cv2.imread(str(tmp_path / "g.png"))
    assert page is not None and page.shape == (900, 1600, 3)
    edge = np.concatenate([page[0], page[-1], page[:, 0], page[:, -1]])
    assert (edge == 255).all()  # nothing runs off the page
    return page


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    "image",
    [
        np.full((240, 320), 128, np.uint8),
        np.full((240, 320, 3), 128, np.uint8),
        np.full((240, 320, 4), 128, np.uint8),
        np.full((240, 320), 30000, np.uint16),
        np.full((1500, 2000, 3), 128, np.uint8),
        np.full((122, 1600), 128, np.uint8),
    ],
    ids=["grey", "colour", "alpha", "16 bit", "large", "flat"],
)
def test_any_image(image: np.ndarray, tmp_path: Path) -> None:
    drawn(tmp_path, image, planned(PLATE, across(PLATE, 3)))


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("count", "fingers"), [(0, 2), (1, 3), (2, 2), (5, 3), (10, 2), (14, 3)])
def test_any_number_of_grasps(count: int, fingers: int, tmp_path: Path) -> None:
    grasps = across(PLATE, count, fingers) if count else NONE
    drawn(tmp_path, np.full((240, 320), 128, np.uint8), planned(PLATE, grasps), mm=4.2, fingers=fingers)


@pytest.mark.slow
@pytest.mark.parametrize("axes", [(150.0, 110.0), (5.0, 100.0), (140.0, 6.0), (12.0, 9.0), (900.0, 700.0)])
def test_objects_of_any_shape(axes: tuple[float, float], tmp_path: Path) -> None:
    outline = ellipse(*axes, (160, 120))
    drawn(tmp_path, np.full((240, 320), 128, np.uint8), planned(outline, across(outline, 4)), title="x" * 200)


def test_several_objects_and_one_without_grasp(tmp_path: Path) -> None:
    others = [ellipse(12, 8, (20.0 + 45 * i, 30)) for i in range(7)]
    objects = [planned(o, across(o, 2), *others) for o in others]
    drawn(tmp_path, np.full((240, 320), 128, np.uint8), planned(RING, NONE), *objects)


def test_fingers_outline_and_regions_are_where_they_are(tmp_path: Path) -> None:
    # An image with the panel's proportions that is shown altogether: a px is 770 / 240 px of the page.
    image, scale = np.full((240, 302), 128, np.uint8), 770 / 240
    page = drawn(tmp_path, image, planned(PLATE, GraspList([ranked(PLATE, [[80, 120], [240, 120]])])))
    top, left = 900 - 62 - 770, 20

    def at(x: float, y: float) -> np.ndarray:
        return page[round(top + (y + 0.5) * scale), round(left + (x + 0.5) * scale)].astype(int)

    np.testing.assert_allclose(at(20, 20), 0.72 * 128, atol=1)
    blue, _, red = at(75, 114).tolist()  # a finger over grey
    assert blue > red + 40
    blue, _, red = at(81, 126).tolist()  # where the contact may slip to
    assert red > blue + 120
    assert at(160, 60).min() > 180  # the outline


def test_a_spread_grasp_in_a_hole(tmp_path: Path) -> None:
    grasps = across(RING, 4, spread=True)
    inside = grasps[0].fingers.reshape(-1, 2) - [160, 120]
    assert (np.hypot(inside[:, 0] / 40, inside[:, 1] / 30) < 1.05).all()
    drawn(tmp_path, np.full((240, 320), 128, np.uint8), planned(RING, grasps))


def test_a_strip_runs_along_the_outline_and_over_its_first_point() -> None:
    view = View(SQUARE)
    np.testing.assert_allclose(contour_strip(view, 0, 0.5, 3.0), [[14.5, 10], [20.5, 10]])
    np.testing.assert_allclose(contour_strip(view, 0, 0.0, 5.0), [[10, 15], [10, 10], [15, 10]])
    assert contour_strip(view, 0, 0.0, 0.0).shape == contour_strip(view, 0, 0.0, math.nan).shape == (0, 2)
    whole = contour_strip(view, 0, 1.0, 1e9)
    np.testing.assert_allclose(np.linalg.norm(np.diff(whole, axis=0), axis=1).sum(), 120.0)


def test_each_contact_has_its_strip_on_its_own_contour() -> None:
    grasp = ranked(RING, [[120, 120], [200, 120]], spread=True, region=8.0)
    for piece, contact in zip(slip_strips(grasp, RING), grasp.contacts, strict=True):
        assert abs(np.linalg.norm(np.diff(piece, axis=0), axis=1).sum() - 16.0) < 0.1
        assert np.linalg.norm(piece - contact, axis=1).max() < 8.1


def test_cones_open_into_the_material() -> None:
    grasp = ranked(PLATE, [[80, 120], [240, 120]])
    np.testing.assert_allclose(inward_normals(grasp, View(PLATE), 0.5), [[1, 0], [-1, 0]], atol=0.02)
    polygon = sector_polygon(grasp.contacts[0], np.array([1.0, 0.0]), math.atan(0.5), 10.0)
    np.testing.assert_allclose(polygon[0], grasp.contacts[0])
    rise = (polygon[1:, 1] - polygon[0, 1]) / (polygon[1:, 0] - polygon[0, 0])
    np.testing.assert_allclose([rise[0], rise[-1]], [-0.5, 0.5])


def test_off_the_outline_the_way_in_serves_for_the_cone() -> None:
    grasp = ranked(PLATE, [[80, 120], [240, 120]])
    np.testing.assert_allclose(inward_normals(grasp, View(SQUARE), 0.5), grasp.directions)


@pytest.mark.parametrize("aspect", [0.3, 1.0, 4.0])
@pytest.mark.parametrize("shape", [(100, 100), (480, 640), (40, 900), (2000, 3000)])
def test_a_window_holds_outline_and_fingers_in_the_frame_s_proportions(shape: tuple[int, int], aspect: float) -> None:
    outline, finger = np.array([[20.0, 5.0], [90.0, 38.0]]), np.array([[-30.0, 20.0], [10.0, 20.0]])
    for most in (1.0, 1.7, 100.0):
        left, top, right, bottom = image_window([outline], [finger], shape, aspect, 0.1, most)
        assert left <= -30.0 and right >= 90.0 and top <= 5.0 and bottom >= 38.0
        assert (right - left) / (bottom - top) == pytest.approx(aspect)
    far = image_window([outline], [np.add(finger, [1e6, 0.0])], shape, aspect, 0.1)
    assert far[2] - far[0] < 4.0 * 70.0 * max(1.0, aspect)


def test_three_fingers_open_by_the_way_of_the_farthest() -> None:
    assert grasp_opening(ranked(PLATE, [[80, 120], [240, 120]])) == pytest.approx(160.0)
    three = across(ellipse(50, 50, (160, 120), 300), 1, 3)[0]
    assert grasp_opening(three) == pytest.approx(100.0, rel=1e-3) and three.opening < 90.0


def test_an_inset_takes_the_corner_that_hides_least() -> None:
    frame, near = (0.0, 0.0, 100.0, 100.0), [np.array([[90.0, 10.0], [95.0, 12.0]]), np.array([[10.0, 90.0]])]
    assert quiet_corner(frame, 0.4, np.array([[50.0, 50.0]]), []) == 0
    assert quiet_corner(frame, 0.4, np.array([[20.0, 30.0], [90.0, 90.0]]), near) == 2
    assert quiet_corner(frame, 0.4, np.array([[20.0, 30.0]]), [*near, np.array([[200.0, 200.0]])]) == 3
    assert quiet_corner(frame, 0.4, np.array([[5.0, 5], [95, 5], [5, 95], [95, 95]]), near) is None


def test_a_grasp_that_is_small_on_its_object_is_shown_large_too(tmp_path: Path) -> None:
    rod = ellipse(150.0, 5.0, (160, 120), 600)
    page = drawn(
        tmp_path, np.full((240, 320), 128, np.uint8), planned(rod, GraspList([ranked(rod, [[160, 115], [160, 125]])]))
    )
    corner = page[70:370, 20:400].reshape(-1, 3).astype(int)
    assert np.count_nonzero(corner[:, 0] > corner[:, 2] + 60) > 500  # the inset's fingers


@pytest.mark.parametrize("count", range(1, 10))
@pytest.mark.parametrize("aspect", [0.2, 1.0, 5.0])
def test_small_panels_stay_in_their_area_and_apart(count: int, aspect: float) -> None:
    boxes = panel_grid((1.0, 2.0, 5.6, 4.0), count, aspect)
    assert len(boxes) == count
    for i, (x, y, w, h) in enumerate(boxes):
        assert (
            w > 1.0 and h > 0.1 and x >= 1.0 - 1e-9 and x + w <= 6.6 + 1e-9 and y >= 2.0 - 1e-9 and y + h <= 6.0 + 1e-9
        )
        for u, v, a, b in boxes[:i]:
            assert x >= u + a or u >= x + w or y >= v + b or v >= y + h


def test_words_for_qualities_and_hands() -> None:
    assert [format_quality(q) for q in (1.0, 0.456, 0.01, 0.0043, 0.0001, 0.0)] == [
        "1.00", "0.46", "0.01", "0.004", "<0.001", "<0.001",
    ]  # fmt: skip
    assert describe_hand(HandPx(0.0, math.inf, 12.34, 10.0, 3.0), None) == "of 12.3 x 10 px"
    assert describe_hand(HandPx(0.0, 200.0, 12.0, 10.0, 3.0), 4.0) == "of 3 x 2.5 mm, opening up to 50 mm"
    assert describe_hand(HandPx(20.0, 200.0, 12.0, 10.0, 3.0), None) == "of 12 x 10 px, opening 20 to 200 px"
    assert describe_hand(HandPx(20.0, math.inf, 12.0, 10.0, 3.0), None) == "of 12 x 10 px, opening from 20 px"

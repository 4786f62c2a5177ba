# SPDX-License-Identifier: Apache-2.0
"""Parts from masks and photos: outline, holes, and a surface without the photo's background."""

import math

import numpy as np
import pytest

from edges import renderer
from grasptrack.errors import ContourError, InputError
from grasptrack_bench.simulation import SHAPES, Scene, TextureMap, part_of_photo, shape_from_mask, similarity_path
from grasptrack_bench.simulation.coverage import inside_mask
from grasptrack_bench.simulation.lookalikes import best_fit
from grasptrack_bench.simulation.masks import mask_polygons
from grasptrack_bench.simulation.outlines import polygon_moments, trace_isolines


def mask_of(name: str, scale: float = 120.0, angle: float = 0.4, size: int = 420) -> np.ndarray:
    turned = SHAPES[name]().moved(angle)
    return inside_mask([p * scale + size / 2 + 0.3 for p in turned.polygons], size, size)


def test_isolines_are_where_the_field_has_the_level() -> None:
    y, x = np.mgrid[:90, :110]
    field = np.minimum(30.0 - np.hypot(x - 54.3, y - 44.2), np.hypot(x - 54.3, y - 44.2) - 11.0)
    outer, hole = sorted(trace_isolines(field, 0.0), key=len, reverse=True)
    assert polygon_moments(outer)[0] == pytest.approx(math.pi * 900, rel=1e-3)
    assert polygon_moments(hole)[0] == pytest.approx(-math.pi * 121, rel=1e-2)
    assert np.hypot(*(outer - [54.3, 44.2]).T) == pytest.approx(30.0, abs=0.02)


def test_isolines_of_noise_all_close_and_cover_what_is_high() -> None:
    noise = np.pad(np.random.default_rng(0).standard_normal((60, 70)), 1, constant_values=-9.0)
    curves = trace_isolines(noise, 0.0)
    steps = np.concatenate([np.roll(c, -1, axis=0) - c for c in curves])
    assert np.hypot(*steps.T).max() < math.sqrt(2.0)
    assert (inside_mask(curves, 72, 62) == (noise > 0.0)).all()


@pytest.mark.parametrize("name", ["gasket", "bean", "hook", "square", "gear"])
def test_a_mask_of_a_part_gives_the_part(name: str) -> None:
    found = shape_from_mask(mask_of(name), name)
    assert len(found.holes) == len(SHAPES[name]().holes)
    fit = best_fit(found, SHAPES[name]())
    assert fit.distance < 2.0 / 120.0  # corners are rounded by a pixel or two
    area, *middle = np.sum([polygon_moments(p) for p in mask_polygons(mask_of(name))], axis=0)
    assert area == pytest.approx(120.0**2, rel=0.004)
    assert np.array(middle) / area == pytest.approx([210.3, 210.3], abs=0.05)


def test_a_smooth_outline_is_found_to_a_fraction_of_a_pixel() -> None:
    ring = mask_polygons(mask_of("disc"))[0]
    off = np.hypot(*(ring - 210.3).T) - 120.0 / math.sqrt(math.pi)
    assert np.abs(off).max() < 0.5  # a mask's own accuracy
    assert abs(off.mean()) < 0.05 and off.std() < 0.15


def test_the_largest_piece_counts_and_specks_do_not() -> None:
    mask = mask_of("bracket")
    mask[5:25, 5:25] = True
    mask[200:202, 200:202] = False
    assert len(shape_from_mask(mask).holes) == 1
    assert best_fit(shape_from_mask(mask), SHAPES["bracket"]()).distance < 0.02


def test_a_silhouette_at_the_border_ends_there() -> None:
    ring = mask_polygons(np.ones((40, 60), np.uint8))[0]
    assert ring.min(axis=0) == pytest.approx([-0.5, -0.5], abs=0.05)
    assert ring.max(axis=0) == pytest.approx([59.5, 39.5], abs=0.05)


@pytest.mark.parametrize(
    ("mask", "says"),
    [
        (np.zeros((40, 40)), "empty"),
        (np.eye(40), "too few"),
        (np.eye(200), "too thin"),
        (np.zeros((4, 4, 3)), "one plane"),
    ],
)
def test_what_is_no_silhouette_is_refused(mask: np.ndarray, says: str) -> None:
    with pytest.raises(ContourError, match=says):
        shape_from_mask(mask)


def test_a_part_of_a_photo_takes_its_surface_along_and_leaves_the_background() -> None:
    mask = mask_of("notched-plate")
    y, x = np.mgrid[: mask.shape[0], : mask.shape[1]]
    photo = np.where(mask, 120 + 50 * np.sin(x / 9.0) * np.cos(y / 7.0), 255).astype(np.uint8)
    shape, surface = part_of_photo(photo, mask)
    assert surface.image.max() <= 171  # nothing of the white around it

    # Seen as large as in the photo, frontal, it is the photo again.
    path = similarity_path(1, distance=1.0)
    scene = Scene(shape, path, surface=surface, table=TextureMap(np.full((8, 8), 255, np.uint8), 9.0))
    H = np.array([[120.0, 0.0, 210.3], [0.0, 120.0, 210.3], [0.0, 0.0, 1.0]])
    view = renderer(scene)
    again = view.render_background(H)
    view.draw_part(again, H)
    again = again[: mask.shape[0], : mask.shape[1]]
    deep = inside_mask([(p * 120 * 0.9) + 210.3 for p in SHAPES["notched-plate"]().moved(0.4).polygons], 420, 420)
    assert np.abs(again - photo)[deep].mean() < 1.0


def test_colours_are_carried_outward_in_colour_too() -> None:
    mask = mask_of("bean")
    photo = np.where(mask[..., None], (40, 90, 140), (255, 255, 255)).astype(np.uint8)
    _, surface = part_of_photo(photo, mask)
    assert (surface.image.reshape(-1, 3) == (40, 90, 140)).all()


def test_photo_and_mask_must_match() -> None:
    with pytest.raises(InputError, match="same size"):
        part_of_photo(np.zeros((5, 5), np.uint8), np.zeros((5, 6)))
    with pytest.raises(InputError, match="8-bit"):
        part_of_photo(np.zeros((5, 6)), np.zeros((5, 6)))


def test_a_photo_of_a_table_lies_where_it_says() -> None:
    image = np.arange(60 * 80, dtype=np.uint16).reshape(60, 80).astype(np.uint8)
    texture = TextureMap(image, 4.0)
    corners = np.array([[-0.5, 29.5, 1.0], [79.5, 29.5, 1.0], [39.5, -0.5, 1.0]]) @ texture.to_table.T
    assert corners[:, :2] == pytest.approx(np.array([[-4.0, 0.0], [4.0, 0.0], [0.0, -3.0]]))
    assert (texture.coloured.grey.image == image).all()

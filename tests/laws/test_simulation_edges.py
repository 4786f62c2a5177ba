# SPDX-License-Identifier: Apache-2.0
"""Scenes, and parts from masks and photos, against their own truth: the rendered edge is the stated outline."""

import math
from dataclasses import replace

import numpy as np
import pytest

from edges import flat, offsets, plane_to_image, renderer
from grasptrack.errors import ContourError, InputError
from grasptrack.geometry.homographies import apply_homography
from grasptrack_bench.simulation import (
    DISTURBANCES,
    SHAPES,
    Scene,
    Shape,
    TextureMap,
    near_twin,
    part_of_photo,
    shape_from_mask,
    similarity_path,
)
from grasptrack_bench.simulation.coverage import inside_mask
from grasptrack_bench.simulation.lookalikes import best_fit
from grasptrack_bench.simulation.masks import mask_polygons
from grasptrack_bench.simulation.outlines import polygon_moments, trace_isolines

PART, TABLE = 60, 180
LIMIT = 0.01
"""px that the edge may lie off the outline on average."""


def bare(shape: Shape, disturbance: str, seed: int = 2) -> Scene:
    """The scene of a disturbance without texture, noise and light: what is left are its edges."""
    scene = DISTURBANCES[disturbance].scene(shape, 40, seed, surface=flat(PART), table=flat(TABLE))
    even = {"noise": 0.0, "vignette": 0.0, "gradient": (0.0, 0.0), "drift": 0.0, "jumps": (), "shadow": None, "jpeg": 0}
    return Scene(
        shape,
        scene.path,
        camera=scene.camera,
        table=flat(TABLE),
        surface=flat(PART),
        conditions=replace(scene.conditions, **even),
        covers=scene.covers,
        guests=[replace(guest, surface=None) for guest in scene.guests],
        distractors=[replace(item, surface=flat(TABLE) if item.flat else None) for item in scene.distractors],
        thickness=scene.thickness,
    )


def outline_of(scene: Scene, index: int) -> tuple[np.ndarray, ...]:
    """Where the part is, or what lies in its place."""
    guest = scene.guest(index)
    if guest is None:
        return scene[index].outline
    assert guest.shape is not None
    return tuple(apply_homography(plane_to_image(scene)[index], p) for p in guest.shape.polygons)


@pytest.mark.sampled(5)
@pytest.mark.parametrize("name", [n for n in list(DISTURBANCES)[:35] if n not in ("thick", "thick-6", "aside")])
def test_edges_lie_on_the_stated_outline(name: str) -> None:
    soft = name in ("blur", "motion-blur", "shake")
    found = []
    for shape in ("notched-plate", "bean"):
        scene = bare(SHAPES[shape](), name)
        frames = range(5, 40, 12)
        found += [
            offsets(scene[i].image, outline_of(scene, i), PART, TABLE, reach=12.0 if soft else 6.0) for i in frames
        ]
    off = np.concatenate(found)
    assert len(off) > 1000
    if name == "motion-blur":  # what turns or speeds up while it is exposed is not seen where it is in the middle of it
        assert abs(off.mean()) < 2 * LIMIT and off.std() < 0.06
    elif name == "shake":  # a hand turns back within an exposure
        assert abs(off.mean()) < 5 * LIMIT and off.std() < 0.5
    else:
        assert abs(off.mean()) < LIMIT and off.std() < 0.02


@pytest.mark.parametrize("shape", ["notched-plate", "gasket"])
def test_the_upper_face_of_a_thick_part_lies_on_its_outline_where_no_side_shows(shape: str) -> None:
    scene = bare(SHAPES[shape](), "thick")
    assert scene.thickness > 0.0
    found = []
    for i in range(10, 40, 9):
        table = scene.path.pose(i).table_to_image(scene.camera)[0]
        down = table @ np.linalg.inv(plane_to_image(scene)[i])

        def hidden(point: np.ndarray, normal: np.ndarray, down: np.ndarray = down) -> np.ndarray:
            return np.asarray(((apply_homography(down, point) - point) * normal).sum(axis=1) < -0.05)

        found.append(offsets(scene[i].image, scene[i].outline, PART, TABLE, where=hidden))
    off = np.concatenate(found)
    assert len(off) > 500
    assert abs(off.mean()) < LIMIT and off.std() < 0.02


def test_sides_show_where_the_lower_face_is_seen_and_join_the_upper_one() -> None:
    scene = bare(SHAPES["rectangle"](), "thick", seed=5)
    flat_one = Scene(
        scene.shape, scene.path, table=flat(TABLE), surface=flat(PART), conditions=scene.conditions, camera=scene.camera
    )
    i = int(np.argmax(scene.path.tilt))
    with_sides = scene[i].image.astype(float)
    seen = (with_sides < TABLE - 2).sum()
    assert seen > (flat_one[i].image < TABLE - 2).sum()
    # Across the seam of upper face and side no table shines through: nothing is brighter than face and side.
    inner = scene[i].outline[0]
    foot = flat_one[i].outline[0]
    middle = 0.5 * (inner + np.roll(inner, -1, axis=0))
    shown = ((0.5 * (foot + np.roll(foot, -1, axis=0)) - middle) * (middle - inner.mean(axis=0))).sum(axis=1) > 20.0
    assert shown.any()
    x, y = np.rint(middle[shown]).astype(int).T
    assert (with_sides[y, x] < PART + 5).all()


def test_edges_of_silhouettes_and_twins_lie_on_their_outlines() -> None:
    y, x = np.mgrid[:220, :300]
    mask = (((x - 150) / 110) ** 2 + ((y - 105) / 70) ** 2 < 1) & (np.hypot(x - 190, y - 110) > 25)
    for shape in (shape_from_mask(mask), near_twin(SHAPES["bracket"](), 3)):
        scene = bare(shape, "clean-6dof", seed=1)
        off = np.concatenate([offsets(scene[i].image, scene[i].outline, PART, TABLE) for i in (0, 17, 39)])
        assert len(off) > 500
        assert abs(off.mean()) < LIMIT and off.std() < 0.02


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

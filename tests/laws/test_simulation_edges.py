# SPDX-License-Identifier: Apache-2.0
"""Every kind of scene against its own truth: on plain surfaces the rendered edge is the stated outline."""

from dataclasses import replace

import numpy as np
import pytest

from edges import flat, offsets, plane_to_image
from grasptrack.geometry.homographies import apply_homography
from grasptrack_bench.simulation import DISTURBANCES, SHAPES, Scene, Shape, near_twin, shape_from_mask

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

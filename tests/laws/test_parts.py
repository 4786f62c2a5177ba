# SPDX-License-Identifier: Apache-2.0
"""Parts on file: what is written is what is read, and what is no part ends in one line."""

import io
import json
import math
import zipfile
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import grasptrack as gt
from grasptrack.cli.main import main
from grasptrack.errors import InputError
from grasptrack.io.parts import LARGEST_FILE
from scenery import L_PLATE, drawn

NAMES = st.text("abc äß-_.12", min_size=1, max_size=60).filter(str.strip)


def l_plate(
    name: str = "plate", scale: float = math.nan, side: int = 1, hole: float = 0.0, noise: float = 1.5
) -> gt.Part:
    """A part with a hole, or none, drawn `side` times as large."""
    centre = np.array([160.0, 120.0]) * side
    image = drawn(
        L_PLATE * side, centres=((160.0 * side, 120.0 * side),), angle=0.0, size=(240 * side, 320 * side), noise=noise
    )
    outer = np.vstack(
        [np.linspace(a, b, 30, endpoint=False) for a, b in zip(L_PLATE, np.roll(L_PLATE, -1, 0), strict=True)]
    )
    contours = [gt.Contour(outer * side + centre)]
    if hole:
        t = np.linspace(0.0, -2.0 * np.pi, 60, endpoint=False)
        ring = np.column_stack([np.cos(t), np.sin(t)]) * hole * side + centre - np.array([40.0, 20.0]) * side
        contours.append(gt.Contour(ring, hole=True))
    grasp = gt.Grasp(np.array([[-70.0, 0.0], [-20.0, 20.0]]) * side + centre)
    return gt.Part.of(
        image, gt.View(contours), [grasp], name=name, hand=gt.Hand(px_per_mm=None if math.isnan(scale) else scale)
    )


@given(NAMES, st.one_of(st.just(math.nan), st.floats(0.01, 1e3)), st.sampled_from([0.0, 6.0]))
def test_a_part_comes_back_as_it_was_kept(
    tmp_path_factory: pytest.TempPathFactory, name: str, scale: float, hole: float
) -> None:
    part, file = l_plate(name, scale, hole=hole), tmp_path_factory.mktemp("parts") / "a.part"
    part.save(file)
    again, data = gt.Part.load(file), file.read_bytes()
    assert (again.name, again.friction, again.finger) == (part.name, part.friction, part.finger)
    assert again.px_per_mm == part.px_per_mm or math.isnan(scale)
    assert again.origin == part.origin
    np.testing.assert_array_equal(again.image, part.image)
    for one, other in zip(again.view.contours, part.view.contours, strict=True):
        np.testing.assert_array_equal(one.points, other.points)
        assert one.hole == other.hole
    np.testing.assert_allclose(again.grasps[0].contacts, part.grasps[0].contacts)
    again.save(file)
    assert len(file.read_bytes()) == len(data) <= LARGEST_FILE


def test_a_measured_outline_that_crosses_itself_by_a_hair_comes_back(tmp_path: Path) -> None:
    """As the edges of a first look may: what was taught must be found tomorrow."""
    part = l_plate()
    points = part.view.outer.points.copy()
    across = np.array([[0.0, -1.0], [1.0, 0.0]]) @ (points[41] - points[40])
    points[[40, 41]] = points[41] + 0.015 * across, points[40] + 0.02 * across
    with pytest.raises(gt.ContourError, match="cross itself"):
        gt.Contour(points)
    replace(part, view=gt.View([gt.Contour.trusted(points)])).save(tmp_path / "a.part")
    np.testing.assert_array_equal(gt.Part.load(tmp_path / "a.part").view.outer.points, points)


def test_a_large_picture_is_reduced_until_it_fits(tmp_path: Path) -> None:
    part = l_plate(side=6, scale=6.0, noise=30.0)
    part.save(tmp_path / "a.part")
    again = gt.Part.load(tmp_path / "a.part")
    assert (tmp_path / "a.part").stat().st_size <= LARGEST_FILE and max(again.image.shape) < max(part.image.shape)
    np.testing.assert_allclose(again.size_mm, part.size_mm, rtol=0.01)


def repacked(data: bytes, **members: bytes | None) -> bytes:
    """A part's file with other members in the place of its own."""
    with zipfile.ZipFile(io.BytesIO(data)) as packed:
        kept = {name: packed.read(name) for name in packed.namelist()}
    kept |= {name.replace("_", "."): content for name, content in members.items() if content is not None}
    for name in [name for name, content in members.items() if content is None]:
        del kept[name.replace("_", ".")]
    made = io.BytesIO()
    with zipfile.ZipFile(made, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in kept.items():
            packed.writestr(name, content)
    return made.getvalue()


def hostile_files() -> dict[str, bytes]:
    from grasptrack.io import parts

    data = parts._packed_bytes(l_plate())
    told = json.loads(zipfile.ZipFile(io.BytesIO(data)).read("part.json"))
    wide = cv2.imencode(".png", np.zeros((3, 5000), np.uint8))[1].tobytes()

    def with_keys(**keys: object) -> bytes:
        return repacked(data, part_json=json.dumps({**told, **keys}).encode())

    return {
        "empty": b"",
        "text": b"no zip",
        "cut": data[: len(data) // 2],
        "long": data + bytes(LARGEST_FILE),
        "bomb": repacked(data, outline_csv=b"0" * (1 << 22)),
        "no picture": repacked(data, image_png=None),
        "wide picture": repacked(data, image_png=wide),
        "cut picture": repacked(data, image_png=zipfile.ZipFile(io.BytesIO(data)).read("image.png")[:-40]),
        "jpeg": repacked(data, image_png=cv2.imencode(".jpg", np.zeros((99, 99), np.uint8))[1].tobytes()),
        "outline of words": repacked(data, outline_csv=b"contour,x,y\n0,a,b\n"),
        "outline of infinities": repacked(data, outline_csv=b"contour,x,y\n" + b"0,inf,nan\n" * 20),
        "outline far away": repacked(data, outline_csv=b"contour,x,y\n0,1e9,0\n0,2e9,0\n0,2e9,1e9\n0,1e9,1e9\n" * 3),
        "deep": repacked(data, part_json=b"[" * 30_000),
        "list": repacked(data, part_json=b"[]"),
        "other format": with_keys(format=99),
        "no name": with_keys(name=""),
        "name of a terminal's commands": with_keys(name="\x1b[2J"),
        "name of a number": with_keys(name=3),
        "no grasps": with_keys(grasps=[]),
        "grasps of words": with_keys(grasps=["x"]),
        "grasp elsewhere": with_keys(grasps=[{"contacts": [[0, 0], [1, 1]], "directions": [[1, 0], [0, 1]]}]),
        "no direction": with_keys(grasps=[{**told["grasps"][0], "directions": [[0, 0], [0, 0]]}]),
        "friction": with_keys(friction=-1),
        "finger": with_keys(finger={"width": 1e999, "reach": 1}),
        "scale": with_keys(px_per_mm=0),
        "huge number": with_keys(friction=10**400),
    }


@pytest.mark.parametrize("kind", list(hostile_files()))
def test_what_is_no_part_ends_in_one_line(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "a.part"
    file.write_bytes(hostile_files()[kind])
    with pytest.raises(InputError, match=r'^part "'):
        gt.Part.load(file)
    assert main(["parts", str(file), "--output", str(tmp_path / "out")]) == 2
    said = capsys.readouterr()
    assert said.out == "" and said.err.count("\n") == 1 and "Traceback" not in said.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.part"]


def test_nothing_outside_its_members_is_read_or_written(tmp_path: Path) -> None:
    from grasptrack.io import parts

    (tmp_path / "a.part").write_bytes(repacked(parts._packed_bytes(l_plate()), **{"../outside_txt": b"x"}))
    assert gt.Part.load(tmp_path / "a.part").name == "plate"
    assert not (tmp_path.parent / "outside.txt").exists()


def test_a_missing_file_or_an_empty_folder_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for path in (tmp_path / "none.part", tmp_path):
        assert main(["parts", str(path), "--output", str(tmp_path / "out")]) == 2
        assert capsys.readouterr().err.count("\n") == 1


def test_a_part_is_refused_that_could_not_be_found() -> None:
    part = l_plate()
    for change in ({"name": " "}, {"name": "x" * 61}, {"friction": 0.0}):
        asked = {"name": "plate", **change}
        with pytest.raises(InputError):
            gt.Part.of(part.image, part.view, list(part.grasps), **asked)
    with pytest.raises(InputError, match="1 to 10 grasps"):
        gt.Part.of(part.image, part.view, [], name="plate")


@pytest.mark.parametrize(
    "origin", [(1e308, 1e308, 0.0), (0.0, 1.0, 1.0), (math.nan, 1.0, 1.0), (640.0, math.inf, 0.0), (640.0, 0.0, -1e7)]
)
def test_a_first_image_that_is_none_is_told_in_one_line(origin: tuple[float, float, float], tmp_path: Path) -> None:
    """One whose width and middle summed up to infinity ended the search for the part."""
    replace(l_plate(), origin=origin).save(tmp_path / "a.part")
    with pytest.raises(InputError):
        gt.Part.load(tmp_path / "a.part")

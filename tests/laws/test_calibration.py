# SPDX-License-Identifier: Apache-2.0
"""A camera's lens: there and back, as OpenCV has it, and from every kind of file that users have."""

import json
import tempfile
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack.errors import InputError
from grasptrack.files import LARGEST_BYTES, read_yaml
from grasptrack.geometry.cameras import Camera
from grasptrack.io.calibration import read_camera
from grasptrack_bench.simulation.camera import Pinhole as Rendered

K = [[700.1, 0.0, 319.5], [0.0, 702.0, 239.5], [0.0, 0.0, 1.0]]
D = [-0.1, 0.02, 0.001, -0.002, 0.0]
SIZE = (640, 480)

small = st.floats(-0.002, 0.002)
brown = st.tuples(st.floats(-0.3, 0.3), st.floats(-0.05, 0.05), small, small, st.floats(-0.02, 0.02))
fisheye = st.tuples(st.floats(-0.1, 0.1), st.floats(-0.05, 0.05), small, small)
lenses = st.one_of(
    brown.map(lambda d: (d, "brown")),
    st.tuples(brown, brown).map(lambda d: ((*d[0], *d[1][:3]), "brown")),
    fisheye.map(lambda d: (d, "fisheye")),
)


def points(seed: int = 0, count: int = 60, beyond: float = 200.0) -> np.ndarray:
    return np.random.default_rng(seed).uniform((-beyond, -beyond), (640 + beyond, 480 + beyond), (count, 2))


@given(lenses, st.integers(0, 99))
def test_there_and_back(lens: tuple, seed: int) -> None:
    camera, p = Camera(K, *lens, size=SIZE), points(seed)
    assert np.allclose(camera.undistort(camera.distort(p)), p, atol=1e-8)
    assert np.allclose(camera.distort(camera.undistort(p)), p, atol=1e-8)


@given(lenses, st.integers(0, 99))
def test_where_the_polynomials_hold_they_are_those_of_opencv(lens: tuple, seed: int) -> None:
    camera, p = Camera(K, *lens, size=SIZE), points(seed)
    p = p[camera.within(p)]
    rays = np.column_stack([(p - np.array(K)[:2, 2]) / (K[0][0], K[1][1]), np.ones(len(p))])[:, None]
    project = cv2.fisheye.projectPoints if lens[1] == "fisheye" else cv2.projectPoints
    seen = project(rays, np.zeros(3), np.zeros(3), np.array(K), np.array(lens[0]))[0].reshape(-1, 2)
    assert len(p) > 20 and np.allclose(camera.distort(p), seen, atol=1e-8)


@given(lenses)
def test_the_jacobian_is_that_of_the_map(lens: tuple) -> None:
    camera, p = Camera(K, *lens, size=SIZE), points(count=20, beyond=0.0)
    e = 1e-3 * np.eye(2)
    by_hand = np.stack([(camera.distort(p + d) - camera.distort(p - d)) / 2e-3 for d in e], axis=-1)
    assert np.allclose(camera.jacobian(p), by_hand, atol=1e-6)
    assert (np.linalg.det(camera.jacobian(points())) > 0).all()  # one to one, also far outside


@given(st.floats(-0.2, 0.2), st.floats(-0.02, 0.04))
def test_it_is_the_lens_of_the_renderer(k1: float, k2: float) -> None:
    rendered = Rendered(k1=k1, k2=k2)
    camera = Camera(rendered.matrix, (k1, k2, 0, 0), size=SIZE)
    assert np.allclose(camera.distort(points(beyond=0.0)), rendered.distort(points(beyond=0.0)), atol=1e-9)


@given(lenses, st.sampled_from([0.25, 0.5, 1.5, 2.0]))
def test_a_scaled_image_has_a_scaled_camera(lens: tuple, scale: float) -> None:
    camera, p = Camera(K, *lens, size=SIZE), points(beyond=0.0)
    scaled = camera.resized(round(640 * scale), round(480 * scale))
    assert np.allclose(scaled.distort((p + 0.5) * scale - 0.5), (camera.distort(p) + 0.5) * scale - 0.5, atol=1e-9)


def test_a_lens_that_turns_back_goes_on_along_its_tangent() -> None:
    camera = Camera(K, (-0.3, 0.0, 0.0, 0.0), size=SIZE)
    along = np.column_stack([np.linspace(320, 4000, 400), np.full(400, 239.5)])
    assert (np.diff(camera.distort(along)[:, 0]) > 0).all()
    assert camera.within(along)[0] and not camera.within(along)[-1]


def test_another_shape_of_image_is_refused() -> None:
    with pytest.raises(InputError, match="the calibration is for 640x480 px, the images are 1280x720"):
        Camera(K, D, size=SIZE).resized(1280, 720)


ROS = """# by hand
image_width: 640
image_height: 480
camera_name: narrow "stereo"  # a name
camera_matrix:
  rows: 3
  cols: 3
  data: [700.1, 0., 319.5,
         0., 702, 239.5, 0, 0, 1]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-1.0e-1, .02, 0.001, -0.002, 0]
projection_matrix:
  rows: 3
  cols: 4
  data: [1., 0., 0., 0.]
"""
TOPIC = """---
header:
  stamp: {sec: 0, nanosec: 4}
  frame_id: "a # b"
height: 480
width: 640
distortion_model: plumb_bob
d:
- -0.1
- 0.02
- 0.001
- -0.002
- 0.0
k: [700.1, 0.0, 319.5, 0.0, 702.0, 239.5, 0.0, 0.0, 1.0]
binning_x: 0
roi:
  do_rectify: false
---
height: 1
"""
KALIBR = """cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.1, 0.02, 0.001, -0.002]
  distortion_model: radtan
  intrinsics: [700.1, 702.0, 319.5, 239.5]
  resolution: [640, 480]
  rostopic: /cam0/image_raw
cam1:
  resolution: [1, 1]
"""


def opencv(path: Path, matrix: str = "camera_matrix", lens: str = "distortion_coefficients") -> Path:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Mon 3 # January")
    storage.write("image_width", 640)
    storage.write("image_height", 480)
    storage.write(matrix, np.array(K))
    storage.write(lens, np.array([D]))
    storage.release()
    return path


def test_all_kinds_of_files_hold_the_same_camera(tmp_path: Path) -> None:
    paths = [opencv(tmp_path / f"cv.{kind}") for kind in ("yml", "xml", "json", "yaml")]
    paths += [opencv(tmp_path / "old.xml", "cameraMatrix", "dist_coeffs"), opencv(tmp_path / "k.yml", "K", "D")]
    for name, text in (("ros.yaml", ROS), ("topic.yaml", TOPIC), ("kalibr.yaml", KALIBR)):
        paths.append(tmp_path / name)
        paths[-1].write_text(text)
    paths.append(tmp_path / "plain.json")
    paths[-1].write_text(json.dumps({"mtx": K, "dist": [D], "image_size": SIZE}))
    for path in paths:
        camera = read_camera(path)
        assert np.array_equal(camera.matrix, K) and np.array_equal(camera.distortion, D[: len(camera.distortion)]), path
        assert camera.size == SIZE and camera.model == "brown" and camera.distorted


OLD_OPENCV = "%YAML:1.0\ncamera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [{K}]\nD: [{D}]\n"
INI = """# oST version 5.0 parameters

[image]

width
640

height
480

[cam]

camera matrix
{rows}

distortion
{d}
"""
EUROC = """sensor_type: camera
T_BS:
  cols: 4
  rows: 1
  data: [1.0, 0.0, 0.0, 0.0]
resolution: [640, 480]
camera_model: pinhole
intrinsics: [700.1, 702.0, 319.5, 239.5] # fu, fv, cu, cv
distortion_model: radial-tangential
distortion_coefficients: [{D}]
"""
FOUR = {"fx": 700.1, "fy": 702.0}


def test_dialects_of_other_tools_hold_the_same_camera(tmp_path: Path) -> None:
    numbers = ", ".join(map(str, D))
    texts = {
        "old.yml": OLD_OPENCV.format(K=", ".join(str(v) for row in K for v in row), D=numbers),
        "ost.ini": INI.format(rows="\n".join(" ".join(map(str, row)) for row in K), d=numbers.replace(",", "")),
        "euroc.yaml": EUROC.format(D=", ".join(map(str, D[:4]))),
        "rs.json": json.dumps(
            FOUR | {"width": 640, "height": 480, "ppx": 319.5, "ppy": 239.5, "model": "brown_conrady", "coeffs": D}
        ),
        "transforms.json": json.dumps(
            {"w": 640, "h": 480, "fl_x": 700.1, "fl_y": 702.0, "cx": 319.5, "cy": 239.5}
            | dict(zip(("k1", "k2", "p1", "p2"), D, strict=False))
        ),
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text)
        camera = read_camera(tmp_path / name)
        assert np.array_equal(camera.matrix, K), name
        assert np.array_equal(camera.distortion, D[: len(camera.distortion)]), name
        assert camera.model == "brown" and camera.size in (SIZE, None), name


@given(st.integers(0, 200), st.integers(0, 120), st.sampled_from([1, 2, 4]), st.booleans())
def test_a_part_of_a_sensor_shows_what_the_whole_one_shows_there(left: int, top: int, binning: int, told: bool) -> None:
    """A point of the whole image lies at (p - offset + 1/2) / binning - 1/2 in that of the part."""
    wide, high = (640 - left) // 4 * 4, (480 - top) // 4 * 4
    roi = (
        f"roi: {{x_offset: {left}, y_offset: {top}, width: {wide}, height: {high}, do_rectify: {str(told).lower()}}}\n"
    )
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "part.yaml"
        path.write_text(ROS + f"binning_x: {binning}\nbinning_y: {binning}\n" + roi)
        part, whole, p = read_camera(path), Camera(K, D, size=SIZE), points(beyond=0.0)
    assert part.size == (wide // binning, high // binning)

    def in_part(seen: np.ndarray) -> np.ndarray:
        return (seen - (left, top) + 0.5) / binning - 0.5

    assert np.allclose(part.distort(in_part(p)), in_part(whole.distort(p)), atol=1e-8)


def test_a_fisheye_and_a_focal_length_alone(tmp_path: Path) -> None:
    (tmp_path / "f.yaml").write_text(KALIBR.replace("radtan", "equidistant"))
    assert read_camera(tmp_path / "f.yaml").model == "fisheye"
    (tmp_path / "s.json").write_text('{"width": 640, "height": 480, "focal": 704, "k1": -0.1, "k2": 0.02}')
    rendered, p = Rendered(k1=-0.1, k2=0.02), points(beyond=0.0)
    assert np.allclose(read_camera(tmp_path / "s.json").distort(p), rendered.distort(p))


GOOD_K, GOOD_D = "K: [700,0,320,0,700,240,0,0,1]\n", "D: [0,0,0,0]\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("hello world", "line 1 is no YAML"),
        ("K: [1, 2\nD: 3", "line 2 is no YAML that can be read: expected"),
        ("K: 1\nK: 2", "line 2 .* duplicate key"),
        ("K: [700,0,320,0,700,240,0,0,*b]", "undefined alias"),
        ("[" * 3000, "nested too deeply"),
        ("- 1\n- 2\n", "no camera_matrix"),
        ("K: 2020-13-45\n", "no YAML"),
        ("#" * (LARGEST_BYTES + 1), "too large"),
        ('{"K":', "is no JSON"),
        ('<?xml version="1.0"?><a>', "is no XML"),
        (GOOD_D, "no camera_matrix"),
        (GOOD_K, "no distortion_coefficients"),
        ("K: [700,0,320,0,700,240,0,0]\n" + GOOD_D, "9 numbers, not 8"),
        ("K: [700,0,320,0,x,240,0,0,1]\n" + GOOD_D, "no number"),
        ("K: [700,0,320,0,.nan,240,0,0,1]\n" + GOOD_D, "finite"),
        ("K: [-700,0,320,0,700,240,0,0,1]\n" + GOOD_D, "above 0"),
        (GOOD_K + "D: [0,0,0]\n", "0, 4, 5, 8, 12 coefficients, not 3"),
        (GOOD_K + GOOD_D + "distortion_model: omni\n", "plumb_bob, rational_polynomial or equidistant"),
        (GOOD_K + GOOD_D + "image_width: 640\n", "image_width and image_height"),
        (GOOD_K + "D: [-3,0,0,0]\n", "folds the image"),
        ('{"focal": 700, "k1": 0}', "needs width and height"),
        (
            "K: [0.008,0,0.0032,0,0.008,0.0024,0,0,1]\nwidth: 640\nheight: 480\n" + GOOD_D,
            "focal length is in px, 0.1 to 100",
        ),
        (GOOD_K + GOOD_D + "roi: {x_offset: -3}\n", "roi.x_offset is a whole number"),
        ('{"fx":700,"fy":700,"ppx":320,"ppy":240,"model":"inverse_brown_conrady","coeffs":[0.1,0,0,0,0]}', "plumb_bob"),
        ("<?xml?><root><camera><model><px>8</px><u0>3</u0></model></camera></root>", "ViSP, which is not read"),
        ('ParGroup: Cam1: "Internal Parameters";', "HALCON, which is not read"),
        ('{"K": [7' + "0" * 400 + ',0,320,0,700,240,0,0,1], "D": [0,0,0,0]}', "no number"),
        (GOOD_K + GOOD_D + "image_width: .inf\nimage_height: 480\n", "image_width and image_height"),
    ],
)
def test_a_bad_file_is_one_line_that_names_it(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "camera.any"
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_camera(path)
    assert str(caught.value).startswith(f'camera "{path}": ') and "\n" not in str(caught.value)


def test_what_is_no_text_or_not_there(tmp_path: Path) -> None:
    (tmp_path / "b").write_bytes(b"\xff\xfe\x00\x81")
    for name in ("b", "missing", "."):
        with pytest.raises(InputError, match="camera "):
            read_camera(tmp_path / name)


values = st.recursive(
    st.one_of(
        st.floats(allow_nan=False, allow_infinity=False), st.text("abcxyz_", min_size=1).filter(lambda t: t != "null")
    ),
    lambda inner: st.one_of(
        st.lists(st.floats(-1e6, 1e6), max_size=4),
        st.dictionaries(st.text("abck_", min_size=1), inner, min_size=1, max_size=3),
    ),
    max_leaves=6,
)


def written(value: object, indent: int = 0) -> str:
    if isinstance(value, dict):
        rows = []
        for key, inner in value.items():
            below = isinstance(inner, dict)
            text = "\n" + written(inner, indent + 2) if below else " " + written(inner)
            rows.append(" " * indent + f"{key}:{text}")
        return "\n".join(rows)
    if isinstance(value, list):
        return "[" + ", ".join(written(v) for v in value) + "]"
    return repr(value) if isinstance(value, float) else str(value)


@given(st.dictionaries(st.text("abck_", min_size=1), values, min_size=1, max_size=4))
def test_plain_yaml_is_read_as_it_was_written(content: dict) -> None:
    assert read_yaml(written(content)) == content


def test_aliases_that_refer_to_aliases_cost_nothing(tmp_path: Path) -> None:
    rows = ["a0: &a0 [1, 2, 3, 4, 5, 6, 7, 8, 9]"]
    rows += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 60)]
    (tmp_path / "bomb.yaml").write_text("\n".join([*rows, "K: *a59", "D: [0, 0, 0, 0]"]))
    with pytest.raises(InputError, match="no number"):
        read_camera(tmp_path / "bomb.yaml")


@pytest.mark.parametrize("text", ["a: 1e-5", "%YAML:1.0\n---\na: 1e-5", "a: !!anything 1e-5\n", "a: .00001 # b"])
def test_a_number_is_one_without_a_point_too(text: str) -> None:
    assert float(read_yaml(text)["a"]) == 1e-5


def test_open_brackets_are_refused_before_they_cost_time() -> None:
    with pytest.raises(InputError, match="line 2 begins what is nested too deeply"):
        read_yaml("a: 1\n" + "[" * 500_000)  # the parser would take minutes
    assert read_yaml(f"a: {'[' * 20}1{']' * 20}")


@given(st.text("ab:[]-# ,\n\t\"'{}1.&*!%|>?@`\\~", max_size=40))
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        read_yaml(text)
    except InputError as error:
        assert str(error).startswith("line ")

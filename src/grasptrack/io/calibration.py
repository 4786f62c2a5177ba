# SPDX-License-Identifier: Apache-2.0
"""Calibrations from files: ROS, OpenCV, Kalibr, EuRoC, RealSense, NeRF, and JSON with the same keys."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

import cv2

from grasptrack import arguments
from grasptrack.errors import InputError
from grasptrack.files import read_keys, read_text
from grasptrack.geometry.cameras import Camera, Model

_MATRIX = ("camera_matrix", "k", "mtx", "intrinsic_matrix", "intrinsics", "camera")
_DISTORTION = ("distortion_coefficients", "dist_coeffs", "distortion_coeffs", "distortion", "dist", "coeffs", "d")
_MODEL = ("distortion_model", "camera_model", "model")
_FOUR = (("fx", "fl_x"), ("fy", "fl_y"), ("cx", "ppx"), ("cy", "ppy"))
"""Names of a camera's four numbers where each has its own: of JSON, RealSense, NeRF."""
_WIDTH, _HEIGHT = ("image_width", "width", "w"), ("image_height", "height", "h")
_SIZE = ("image_size", "resolution", "size")
_MODELS: dict[str, Model] = {
    **dict.fromkeys(("plumbbob", "rationalpolynomial", "brown", "radtan", "pinhole", "opencv", "none", ""), "brown"),
    **dict.fromkeys(("radialtangential", "brownconrady", "distortionbrownconrady", "distortionnone"), "brown"),
    **dict.fromkeys(("equidistant", "fisheye", "kannalabrandt", "opencvfisheye", "kannalabrandt4"), "fisheye"),
    "distortionkannalabrandt4": "fisheye",
}
_INVERSE = tuple(f"{before}{kind}brownconrady" for before in ("", "distortion") for kind in ("inverse", "modified"))
"""RealSense's, which lead from seen px to ideal ones: without coefficients they are as any."""
_FOREIGN = {r"<u0>": "is one of ViSP", r"ParGroup\b": "is one of HALCON"}
"""What is told apart by a pattern in its text, and not read."""
WIDEST, LONGEST = 0.1, 100.0
"""Focal lengths in widths of the image between which a pinhole camera's lies: fields of view of 157 and of 0.6 degrees."""


@arguments.checked(path=arguments.instance(str, os.PathLike))
def read_camera(path: str | os.PathLike[str]) -> Camera:
    """A camera from a calibration file.

    ROS camera_info as YAML, with its region of interest and binning, or ini; OpenCV's YAML or XML; Kalibr's camera chain (its
    first camera); EuRoC's sensor; RealSense's intrinsics; NeRF's transforms; or JSON. The names of the keys
    are those of these tools, in capitals or not: camera_matrix or K (3x3, nine numbers, or fx fy cx cy),
    distortion_coefficients or D, distortion_model (plumb_bob, rational_polynomial, equidistant; Brown's where none is
    named), image_width and image_height. In place of a matrix `focal` in px with the axis in the middle will do, and
    in place of coefficients `k1`, `k2`.

    Raises:
        InputError: the file cannot be read, a key is missing, or what it holds is no camera. The message names the file.
    """
    file = Path(path)
    try:
        return _camera_from_content(_read_content(file))
    except InputError as error:
        raise InputError(f'camera "{file}": {error}', **error.values, path=str(file)) from None


# --- files ---------------------------------------------------------------------------------------


def _read_content(file: Path) -> dict[str, Any]:
    text = read_text(file, "calibration")
    for pattern, whose in _FOREIGN.items():
        if re.search(pattern, text):
            raise InputError(f"{whose}, which is not read: export it for OpenCV or ROS")
    if re.match(r"\s*(#[^\n]*\n\s*)*\[[A-Za-z_]\w*\][ \t]*\n", text):
        return _read_ros_ini(text)
    if not text.lstrip().startswith("<"):
        return read_keys(re.sub(r"\A\s*%YAML[^\n]*\n(?!---)", "", text))  # OpenCV's, which need not begin its document
    found = _read_opencv_xml(text)
    return found if isinstance(found, dict) else {}


def _read_ros_ini(text: str) -> dict[str, Any]:
    """What camera_calibration writes beside its YAML: below each name its rows of numbers."""
    found: dict[str, list[float]] = {}
    name = ""
    for line in text.splitlines():
        row = line.split()
        if not row or row[0].startswith(("#", "[")):
            continue
        try:
            found.setdefault(name, []).extend(float(part) for part in row)
        except ValueError:
            name = line.strip()
    return {key: values[0] if len(values) == 1 else values for key, values in found.items()}


def _read_opencv_xml(text: str) -> Any:
    """What OpenCV's own reader finds in XML."""
    storage = cv2.FileStorage()
    try:
        storage.open(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        return _node_to_python(storage.root())
    except (cv2.error, UnicodeDecodeError, SystemError):
        raise InputError("is no XML that can be read") from None
    finally:
        storage.release()


def _node_to_python(node: Any) -> Any:
    """A node and all below it as Python's own dictionaries, lists, numbers and words."""
    if node.isMap():
        return {key: _node_to_python(node.getNode(key)) for key in node.keys()}  # noqa: SIM118
    if node.isSeq():
        return [_node_to_python(node.at(i)) for i in range(node.size())]
    if node.isInt() or node.isReal():
        return node.real()
    return node.string() if node.isString() else None


# --- what they mean ------------------------------------------------------------------------------


def _camera_from_content(content: dict[str, Any]) -> Camera:
    known = {_normalized_key(str(name)): value for name, value in content.items()}
    first = known.get("cam0")
    if isinstance(first, dict):  # Kalibr
        known = {_normalized_key(str(name)): value for name, value in first.items()}
    size = _image_size(known)
    matrix = _camera_matrix(known, size)
    name = _find_value(known, _MODEL[:1])
    name = _find_value(known, _MODEL[1:]) if name is None else name
    coefficients, kind = _distortion_coefficients(known), _normalized_key(str(name or ""))
    model = _MODELS.get(kind) if kind not in _INVERSE or any(coefficients) else "brown"
    if model is None:
        told = "plumb_bob, rational_polynomial or equidistant"
        raise InputError(f'its distortion_model is {told}, not "{name}"', model=name)
    matrix, size = _part_read_out(known, matrix, size)
    width = 2.0 * matrix[0][2] + 1.0 if size is None else size[0]
    if model == "brown" and not WIDEST * width < matrix[0][0] < LONGEST * width and matrix[0][0] > 0.0 < width:
        raise InputError(
            f"its focal length is in px, {WIDEST:g} to {LONGEST:g} times the image's width, not {matrix[0][0]:g}",
            focal=matrix[0][0],
        )
    return Camera(matrix, coefficients, model, size)


def _part_read_out(
    known: dict[str, Any], matrix: list[list[float]], size: tuple[int, int] | None
) -> tuple[list[list[float]], tuple[int, int] | None]:
    """Matrix and size of the images where ROS tells of a sensor of which a part is read out, and its px put together."""
    roi = known.get("roi")
    roi = roi if isinstance(roi, dict) else {}
    left, top, wide, high = (
        _pixel_count(roi.get(name, 0), f"roi.{name}") for name in ("x_offset", "y_offset", "width", "height")
    )
    by_x, by_y = (max(1, _pixel_count(known.get(name, 1), name)) for name in ("binningx", "binningy"))
    if (left, top, wide, high, by_x, by_y) == (0, 0, 0, 0, 1, 1):
        return matrix, size
    if size is not None:
        size = (wide or size[0]) // by_x, (high or size[1]) // by_y
    rows = [list(row) for row in matrix]
    for row, offset, binning in ((rows[0], left, by_x), (rows[1], top, by_y)):
        # the border of the first px at -0.5 stays there
        row[:] = [value / binning for value in row]
        row[2] += (0.5 - offset) / binning - 0.5
    return rows, size


def _pixel_count(value: Any, name: str) -> int:
    """A whole number of px, 0 or more."""
    number = _float_or_none(value)
    if number is None or number < 0 or not number.is_integer():
        raise InputError(f"its {name} is a whole number, 0 or more, not {value}")
    return int(number)


def _normalized_key(name: str) -> str:
    return re.sub(r"[\W_]", "", name).lower()


def _find_value(known: dict[str, Any], names: tuple[str, ...]) -> Any:
    return next((known[_normalized_key(name)] for name in names if known.get(_normalized_key(name)) is not None), None)


def _image_size(known: dict[str, Any]) -> tuple[int, int] | None:
    width, height = _find_value(known, _WIDTH), _find_value(known, _HEIGHT)
    both = _find_value(known, _SIZE)
    if width is None and height is None and isinstance(both, list) and len(both) == 2:
        width, height = both
    if width is None and height is None:
        return None
    sides = [_float_or_none(side) for side in (width, height)]
    if any(side is None or side < 1 or not side.is_integer() for side in sides):
        raise InputError("its image_width and image_height are whole numbers of px, both of them")
    return int(sides[0] or 0), int(sides[1] or 0)


def _camera_matrix(known: dict[str, Any], size: tuple[int, int] | None) -> list[list[float]]:
    focal = _float_or_none(known.get("focal"))
    found = _find_value(known, _MATRIX)
    if found is None and focal is not None:
        if size is None:
            raise InputError("a focal length alone needs width and height, too")
        return [[focal, 0.0, (size[0] - 1) / 2.0], [0.0, focal, (size[1] - 1) / 2.0], [0.0, 0.0, 1.0]]
    four = [_float_or_none(_find_value(known, names)) for names in _FOUR]
    if found is None and not any(value is None for value in four):
        found = four
    if found is None:
        raise InputError("it has no camera_matrix (nor K)")
    values = _flat_numbers(found, "camera_matrix")
    if len(values) == 4:  # fx fy cx cy
        fx, fy, cx, cy = values
        return [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]
    if len(values) != 9:
        raise InputError(f"its camera_matrix has 9 numbers, not {len(values)}", count=len(values))
    return [values[0:3], values[3:6], values[6:9]]


def _distortion_coefficients(known: dict[str, Any]) -> list[float]:
    found = _find_value(known, _DISTORTION)
    if found is not None:
        return _flat_numbers(found, "distortion_coefficients")
    named = [_float_or_none(known.get(key, 0.0)) for key in ("k1", "k2", "p1", "p2", "k3")]
    if not any(key in known for key in ("k1", "k2", "p1", "p2", "k3")):
        raise InputError("it has no distortion_coefficients (nor D); without distortion they are five zeros")
    return [float("nan") if value is None else value for value in named]


def _flat_numbers(found: Any, what: str) -> list[float]:
    """All numbers of a list, of a list of lists, or of the `data` of a matrix."""
    data = found.get("data") if isinstance(found, dict) else found
    rows = data if isinstance(data, list) else [data]
    flat = [value for row in rows for value in (row if isinstance(row, list) else [row])]
    numbers = [_float_or_none(value) for value in flat]
    if data is None or any(value is None for value in numbers):
        raise InputError(f"its {what} holds what is no number")
    return [value for value in numbers if value is not None]


def _float_or_none(value: Any) -> float | None:
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return None
    try:
        return float(value)
    except OverflowError:  # a whole number of more than 308 digits
        return None

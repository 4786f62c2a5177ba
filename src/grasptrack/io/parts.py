# SPDX-License-Identifier: Apache-2.0
"""Parts on file: a zip of JSON, PNG and CSV, small, versioned, and read without unpacking anything to disk.

`part.json` tells format, name, friction, scale, finger and grasps; `image.png` shows the part with some ground round it;
`outline.csv` has its contours, one point a row: `contour,x,y`, contour 0 the outer one, px of the picture, the centre of its
top-left pixel at (0, 0).
"""

from __future__ import annotations

import csv
import io
import json
import math
import os
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from grasptrack import arguments
from grasptrack.errors import GraspTrackError, InputError
from grasptrack.files import read_bytes, read_json, write_file
from grasptrack.geometry.contours import Contour, View
from grasptrack.grasp.contacts import Grasp
from grasptrack.io.headers import image_size_in_header, is_whole_image
from grasptrack.io.results import software_versions
from grasptrack.presentation import plain_value
from grasptrack.tracking.parts import KnownPart
from grasptrack.typing import Floats, Pixels

FORMAT = 1
"""Raised when a member or key changes its meaning or goes away; new keys alone do not raise it."""
SUFFIX = ".part"
LARGEST_FILE = 300_000
"""Bytes of a part's file."""
LARGEST_MEMBERS = {"part.json": 1 << 16, "image.png": LARGEST_FILE, "outline.csv": 1 << 20}
"""Bytes of its members, unpacked."""
MOST_SIDE, MOST_POINTS, MOST_CONTOURS = 1200, 20_000, 200
"""px of the picture's sides, points of an outline, and its contours."""
STAMP = (1980, 1, 1, 0, 0, 0)
"""Time of every member: the same part gives the same bytes."""


class Part(KnownPart):
    """A part that can be kept on file: taught once, found tomorrow."""

    @arguments.checked(path=arguments.instance(str, os.PathLike))
    def save(self, path: str | Path) -> None:
        """Write it to one file of at most 300 kB, whole at any moment or absent; of a large part the picture is reduced.

        Args:
            path: of the file; one that exists is replaced.

        Raises:
            InputError: it cannot be written.
        """
        part = _reduced_part(self, MOST_SIDE / max(self.image.shape[:2]))
        data = _packed_bytes(part)
        while len(data) > LARGEST_FILE:
            part = _reduced_part(part, min(0.9, math.sqrt(0.9 * LARGEST_FILE / len(data))))
            data = _packed_bytes(part)
        write_file(Path(path), data, "part")

    @classmethod
    @arguments.checked(path=arguments.instance(str, os.PathLike))
    def load(cls, path: str | Path) -> Part:
        """Read a part that `save` has written, or another program by the same format.

        Args:
            path: of the file.

        Raises:
            InputError: it cannot be read, or holds no part.
        """
        file = Path(path)
        try:
            return _unpacked_part(cls, _read_members(file))
        except GraspTrackError as error:
            raise InputError(f'part "{file}" {error}', path=str(file)) from None
        except (KeyError, TypeError, ValueError, OverflowError, RecursionError) as error:
            raise InputError(f'part "{file}" is no part that can be read: {error!r}', path=str(file)) from None


def _reduced_part(part: KnownPart, scale: float) -> KnownPart:
    """The same in a smaller picture; a scale of 1 and more changes nothing."""
    if scale >= 1.0:
        return part
    height, width = part.image.shape[:2]
    size = (max(1, round(width * scale)), max(1, round(height * scale)))
    image = np.asarray(cv2.resize(part.image, size, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    x, y = size[0] / width, size[1] / height
    H = np.array([[x, 0.0, 0.5 * x - 0.5], [0.0, y, 0.5 * y - 0.5], [0.0, 0.0, 1.0]])
    mean = math.sqrt(x * y)
    grasps = tuple(Grasp(g.contacts * [x, y] + H[:2, 2], g.quality) for g in part.grasps)
    finger = part.finger[0] * mean, part.finger[1] * mean
    view = part.view.transformed(H)
    origin = part.origin and (part.origin[0] * x, part.origin[1] * x, part.origin[2] * y)
    return KnownPart(
        part.name, image, view, grasps, part.directions, part.friction, finger, part.px_per_mm * mean, part.face_up, origin
    )  # fmt: skip


def _packed_bytes(part: KnownPart) -> bytes:
    """The bytes of its file."""
    good, picture = cv2.imencode(".png", part.image, [cv2.IMWRITE_PNG_COMPRESSION, 9])
    if not good:
        raise InputError("a part's picture cannot be encoded")
    told = {
        "format": FORMAT,
        "name": part.name,
        "versions": software_versions(),
        "units": "px of image.png, the centre of its top-left pixel at (0, 0), x right, y down",
        "friction": part.friction,
        "px_per_mm": part.px_per_mm,
        "face_up": part.face_up,
        "origin": part.origin and {"width": part.origin[0], "middle": part.origin[1:]},
        "finger": {"width": part.finger[0], "reach": part.finger[1]},
        "grasps": [
            {"contacts": g.contacts, "directions": ways, "quality": g.quality}
            for g, ways in zip(part.grasps, part.directions, strict=True)
        ],
    }
    table = io.StringIO()
    rows = csv.writer(table, lineterminator="\n")
    rows.writerow(["contour", "x", "y"])
    for k, contour in enumerate(part.view.contours):
        rows.writerows([k, x, y] for x, y in contour.points.tolist())
    members = {
        "part.json": json.dumps(plain_value(told), indent=2, allow_nan=False).encode(),
        "image.png": picture.tobytes(),
        "outline.csv": table.getvalue().encode(),
    }
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w") as packed:
        for name, content in members.items():
            how = zipfile.ZIP_STORED if name.endswith(".png") else zipfile.ZIP_DEFLATED
            packed.writestr(zipfile.ZipInfo(name, STAMP), content, how, 9)
    return data.getvalue()


def _read_members(file: Path) -> dict[str, bytes]:
    """The members that a part has, none longer than it may be.

    Raises:
        InputError: no such file, no zip, or a member is missing, encrypted or too large. The message does not name the file.
    """
    data = read_bytes(file, "part", LARGEST_FILE)
    found: dict[str, bytes] = {}
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as packed:
            for name, most in LARGEST_MEMBERS.items():
                with packed.open(name) as member:
                    found[name] = member.read(most + 1)
                if len(found[name]) > most:
                    raise InputError(f"has a {name} of more than {most} bytes")
    except KeyError as error:
        raise InputError(f"is no part: {error.args[0]}") from None
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError, OSError, ValueError) as error:
        raise InputError(f"is no part, a zip of {', '.join(LARGEST_MEMBERS)}: {error}") from None
    return found


def _unpacked_part(cls: type[Part], members: Mapping[str, bytes]) -> Part:
    """The part that members tell.

    Raises:
        InputError, KeyError, TypeError, ValueError, OverflowError: they tell none.
    """
    told = read_json(members["part.json"].decode("utf-8"))
    if told.get("format") != FORMAT:
        raise InputError(f"has format {told.get('format')!r}; this version reads {FORMAT}")
    view, image = _read_outline(members["outline.csv"].decode("utf-8")), _read_picture(members["image.png"])
    scale, finger, origin = told.get("px_per_mm"), told["finger"], told.get("origin")
    listed = told["grasps"]
    x, y = (0.0, 0.0) if origin is None else origin["middle"]
    if not isinstance(listed, list):
        raise InputError("has no list of grasps")
    part = cls(
        told["name"],
        image,
        view,
        tuple(Grasp(g["contacts"], math.nan if g.get("quality") is None else float(g["quality"])) for g in listed),
        tuple(_unit_vectors(g["directions"]) for g in listed),
        float(told["friction"]),
        (float(finger["width"]), float(finger["reach"])),
        math.nan if scale is None else float(scale),
        told.get("face_up", False) is True,
        None if origin is None else (float(origin["width"]), float(x), float(y)),
    )
    part.check_values()
    return part


def _unit_vectors(given: Any) -> Floats:
    """(k, 2) directions of length 1."""
    ways = np.asarray(given, dtype=np.float64)
    if ways.ndim != 2 or ways.shape[1] != 2 or not np.isfinite(ways).all() or not np.hypot(*ways.T).all():
        raise InputError("has a grasp whose directions are none")
    return np.asarray(ways / np.hypot(*ways.T)[:, None], dtype=np.float64)


def _read_outline(text: str) -> View:
    """The contours of outline.csv."""
    rows = list(csv.reader(io.StringIO(text)))
    if not rows or rows[0][:3] != ["contour", "x", "y"] or len(rows) > MOST_POINTS + 1:
        raise InputError(f"has an outline.csv without the columns contour,x,y, or of more than {MOST_POINTS} points")
    points: dict[int, list[tuple[float, float]]] = {}
    for row in rows[1:]:
        points.setdefault(int(row[0]), []).append((float(row[1]), float(row[2])))
    if sorted(points) != list(range(len(points))) or len(points) > MOST_CONTOURS:
        raise InputError(f"has contours that are not counted from 0, or more than {MOST_CONTOURS}")
    rings = [np.array(points[k]) for k in range(len(points))]
    if any(not (ring != np.roll(ring, 1, axis=0)).any(axis=1).all() for ring in rings):
        raise InputError("has an outline with the same point twice in succession")
    # measured ones may cross themselves, by less than a pixel
    return View([Contour.trusted(ring, hole=k > 0) for k, ring in enumerate(rings)])


def _read_picture(data: bytes) -> Pixels:
    """The picture, decoded only where its header says that it is small."""
    size = image_size_in_header(data) if data.startswith(b"\x89PNG") and is_whole_image(data) else None
    if size is None or not all(0 < side <= MOST_SIDE for side in size):
        raise InputError(f"has an image.png that is none, or with a side of more than {MOST_SIDE} px")
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_ANYCOLOR)
    if image is None or image.dtype != np.uint8:
        raise InputError("has an image.png that cannot be decoded")
    return np.ascontiguousarray(image)


def part_files(paths: Sequence[str | Path]) -> list[Path]:
    """Files of parts: those that are given, and those that end in .part of each folder, in the order of names.

    Raises:
        InputError: there is none in a folder.
    """
    found: list[Path] = []
    for path in map(Path, paths):
        files = sorted(path.glob(f"*{SUFFIX}")) if path.is_dir() else [path]
        if not files:
            raise InputError(f'there is no file of a part (*{SUFFIX}) in "{path}"', path=str(path))
        found += files
    return found


def load_parts(files: Sequence[Path], *, same_tilt: bool) -> list[Part]:
    """Parts of some files, for a camera that leans as the one that taught them did, or another.

    Raises:
        InputError: a file that is none of a part.
    """
    return [replace(Part.load(file), same_tilt=same_tilt) for file in files]

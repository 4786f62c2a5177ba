# SPDX-License-Identifier: Apache-2.0
"""What an image file's own first bytes say of it, before it is decoded: size, pages, orientation, whether it is whole."""

from __future__ import annotations

import contextlib
import re
import struct
from collections.abc import Iterator
from typing import NamedTuple


def is_whole_image(data: bytes) -> bool:
    """False for a JPEG or PNG without its end marker; True where the format keeps none."""
    if data.startswith(b"\xff\xd8"):
        return data.find(b"\xff\xd9", _scan_of(data)) > 0
    if data.startswith(b"\x89PNG"):
        return b"IEND" in data
    return True


def _scan_of(data: bytes) -> int:
    """Where the first scan of a JPEG begins; what comes before may hold a thumbnail with an end marker of its own."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != 0xDA:
        at += 1 if data[at + 1] == 0xFF else 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return at


def format_for_pillow(data: bytes) -> str:
    """The format of what Pillow is to read: AVIF, GIF, HEIF, and PNG or WebP of several images; empty of all else."""
    brands = data[8 : min(int.from_bytes(data[:4], "big"), 256)]
    if data[4:8] == b"ftyp" and re.match(b"avi[fs]|hei|hev|mif1|msf1", brands):
        return "AVIF" if re.search(b"avi[fs]", brands) else "HEIF"
    if data.startswith(b"GIF8"):
        return "GIF"
    if data.startswith(b"\x89PNG") and data.find(b"acTL", 0, data.find(b"IDAT")) > 0:
        return "PNG"
    return "WEBP" if data[8:16] == b"WEBPVP8X" and len(data) > 20 and data[20] & 2 else ""


def orientation_of(data: bytes) -> int:
    """How the EXIF block of a PNG or WebP says that it lies, 1 to 8; 1 where nothing is said."""
    at = data.find(b"eXIf" if data.startswith(b"\x89PNG") else b"EXIF") if data[:4] in (b"\x89PNG", b"RIFF") else -1
    block = data[at + (4 if data[:1] == b"\x89" else 8) :].removeprefix(b"Exif\0\0") if at > 0 else b""
    with contextlib.suppress(struct.error):
        if block[:4] in TIFF:
            return next(tiff_directories(block)).orientation
    return 1


# --- sizes ------------------------------------------------------------------------------------------
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of JPEG that begin a frame and tell its size."""
_PORTABLE = re.compile(rb"P[1-6fF](?:\s|#[^\n\r]*[\n\r])+(\d{1,9})(?:\s|#[^\n\r]*[\n\r])+(\d{1,9})\s(?:(\d{1,5})\s)?")
TIFF, _MOST_PAGES = (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"), 100_000
MULTIPLIED = 1
"""Extra sample of a TIFF by which the others have been multiplied."""
_TIFF_TYPES = {1: "B", 3: "H", 4: "I", 16: "Q"}


def image_size_in_header(data: bytes) -> tuple[int, int] | None:
    """Width and height in px that a file claims; None where it is of another format, or has no whole header."""
    try:
        if data.startswith(b"\x89PNG"):
            return _read_pair(">II", data, 16)
        if data.startswith(b"\xff\xd8"):
            return _jpeg_size(data)
        if data.startswith(b"BM"):
            return _read_pair("<HH" if data[14:18] == b"\x0c\0\0\0" else "<ii", data, 18)  # OS/2's, or Windows's
        if data[:4] in TIFF:
            first = next(tiff_directories(data), None)
            return None if first is None else first.size
        if data.startswith(b"RIFF") and data[8:12] == b"WEBP":
            return _webp_size(data)
        if data.startswith(b"\xff\x4f\xff\x51") or data[4:8] == b"jP  ":
            return _jpeg_2000_size(data)
        found = _PORTABLE.match(data)
        return (int(found[1]), int(found[2])) if found else None
    except (struct.error, IndexError, ValueError):
        return None


def largest_value(data: bytes) -> int:
    """What white is in a PGM or PPM of 8 bits, by its header; 255 of all else."""
    found = _PORTABLE.match(data) if data[:2] in (b"P2", b"P3", b"P5", b"P6") else None
    return min(255, int(found[3] or 255)) if found else 255


def _read_pair(layout: str, data: bytes, at: int) -> tuple[int, int]:
    first, second = struct.unpack_from(layout, data, at)
    return abs(int(first)), abs(int(second))  # a BMP's height is negative where its first row is the upper one


def _jpeg_size(data: bytes) -> tuple[int, int] | None:
    at = 2
    while at + 9 <= len(data):
        if data[at] != 0xFF:  # a decoder looks for the next marker as well
            at += 1
            continue
        marker = data[at + 1]
        if marker in _JPEG_FRAMES:
            height, width = _read_pair(">HH", data, at + 5)
            return width, height
        if marker in (0xFF, 0x00, 0x01) or 0xD0 <= marker <= 0xD8:
            at += 1 if marker == 0xFF else 2
            continue
        if marker in (0xD9, 0xDA):
            return None
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return None


def _jpeg_2000_size(data: bytes) -> tuple[int, int] | None:
    if data[4:8] == b"jP  ":
        height, width = _read_pair(">II", data, data.index(b"ihdr") + 4)
        return width, height
    right, bottom, left, top = struct.unpack_from(">IIII", data, 8)
    return right - left, bottom - top


class TiffDirectory(NamedTuple):
    """Width and height in px, None where they are not told; whether it is a smaller copy of another one; what its tags say."""

    size: tuple[int, int] | None
    is_reduced: bool
    orientation: int
    samples: int
    extra: int


def tiff_directories(data: bytes) -> Iterator[TiffDirectory]:
    """Of the pages of a TIFF, and of a block of EXIF, in order.

    Raises:
        struct.error: the next one is cut off.
    """
    order = "<" if data[:1] == b"I" else ">"
    big = data[2:4] in (b"+\0", b"\0+")
    (at,) = struct.unpack_from(order + ("Q" if big else "I"), data, 8 if big else 4)
    seen: set[int] = set()
    while 0 < at < len(data) and at not in seen and len(seen) < _MOST_PAGES:
        seen.add(at)
        (count,) = struct.unpack_from(order + ("Q" if big else "H"), data, at)
        at += 8 if big else 2
        told = {254: 0, 274: 1, 277: 1, 338: 0}
        for entry in range(min(count, 4096)):
            place = at + entry * (20 if big else 12)
            tag, kind = struct.unpack_from(order + "HH", data, place)
            if tag in (*told, 256, 257) and kind in _TIFF_TYPES:
                (told[tag],) = struct.unpack_from(order + _TIFF_TYPES[kind], data, place + (12 if big else 8))
        size = (told[256], told[257]) if len(told) == 6 else None
        yield TiffDirectory(size, bool(told[254] & 1), told[274], told[277], told[338])
        (at,) = struct.unpack_from(order + ("Q" if big else "I"), data, at + count * (20 if big else 12))


def pages_of(data: bytes) -> list[int]:
    """Indices of the pages of a TIFF that are images of their own, as large as the first; of another format one."""
    if data[:4] not in TIFF:
        return [0]
    pages: list[TiffDirectory] = []
    with contextlib.suppress(struct.error):  # the last directory may be cut off
        pages.extend(tiff_directories(data))
    return [k for k, page in enumerate(pages) if not page.is_reduced and page.size == pages[0].size] or [0]


def _webp_size(data: bytes) -> tuple[int, int] | None:
    if len(data) < 30:
        return None
    kind = data[12:16]
    if kind == b"VP8X":
        return 1 + int.from_bytes(data[24:27], "little"), 1 + int.from_bytes(data[27:30], "little")
    if kind == b"VP8L":
        bits = int.from_bytes(data[21:25], "little")
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    if kind == b"VP8 ":
        width, height = _read_pair("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    return None

# SPDX-License-Identifier: Apache-2.0
"""The size of an image by the first bytes of its file: JPEG, PNG, TIFF, BMP, WebP, and the portable formats (PGM and so on)."""

from __future__ import annotations

import re
import struct

_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of JPEG that begin a frame and tell its size."""
_PORTABLE = re.compile(rb"P[1-6fF](?:\s|#[^\n\r]*[\n\r])+(\d{1,9})(?:\s|#[^\n\r]*[\n\r])+(\d{1,9})\s")
_TIFF_TYPES = {1: "B", 3: "H", 4: "I", 16: "Q"}


def image_size_in_header(data: bytes) -> tuple[int, int] | None:
    """Width and height in px that a file claims; None where it is of another format, or has no whole header."""
    try:
        if data.startswith(b"\x89PNG"):
            return _pair(">II", data, 16)
        if data.startswith(b"\xff\xd8"):
            return _jpeg(data)
        if data.startswith(b"BM"):
            return _bmp(data)
        if data[:4] in (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"):
            return _tiff(data)
        if data.startswith(b"RIFF") and data[8:12] == b"WEBP":
            return _webp(data)
        found = _PORTABLE.match(data)
        return (int(found[1]), int(found[2])) if found else None
    except (struct.error, IndexError):
        return None


def _pair(layout: str, data: bytes, at: int) -> tuple[int, int]:
    first, second = struct.unpack_from(layout, data, at)
    return abs(int(first)), abs(int(second))  # a BMP's height is negative where its first row is the upper one


def _jpeg(data: bytes) -> tuple[int, int] | None:
    at = 2
    while at + 9 <= len(data):
        if data[at] != 0xFF:  # a decoder looks for the next marker as well
            at += 1
            continue
        marker = data[at + 1]
        if marker in _FRAMES:
            height, width = _pair(">HH", data, at + 5)
            return width, height
        if marker in (0xFF, 0x00, 0x01) or 0xD0 <= marker <= 0xD8:
            at += 1 if marker == 0xFF else 2
            continue
        if marker in (0xD9, 0xDA):
            return None
        at += 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return None


def _bmp(data: bytes) -> tuple[int, int]:
    head = int.from_bytes(data[14:18], "little")
    return _pair("<HH", data, 18) if head == 12 else _pair("<ii", data, 18)


def _tiff(data: bytes) -> tuple[int, int] | None:
    """The first directory's; of BigTIFF too."""
    order = "<" if data[:1] == b"I" else ">"
    big = data[2:4] in (b"+\0", b"\0+")
    (at,) = struct.unpack_from(order + ("Q" if big else "I"), data, 8 if big else 4)
    (count,) = struct.unpack_from(order + ("Q" if big else "H"), data, at)
    at += 8 if big else 2
    sides: dict[int, int] = {}
    for entry in range(min(count, 4096)):
        place = at + entry * (20 if big else 12)
        tag, kind = struct.unpack_from(order + "HH", data, place)
        if tag in (256, 257) and kind in _TIFF_TYPES:
            (sides[tag],) = struct.unpack_from(order + _TIFF_TYPES[kind], data, place + (12 if big else 8))
    return (sides[256], sides[257]) if len(sides) == 2 else None


def _webp(data: bytes) -> tuple[int, int] | None:
    if len(data) < 30:
        return None
    kind = data[12:16]
    if kind == b"VP8X":
        return 1 + int.from_bytes(data[24:27], "little"), 1 + int.from_bytes(data[27:30], "little")
    if kind == b"VP8L":
        bits = int.from_bytes(data[21:25], "little")
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    if kind == b"VP8 ":
        width, height = _pair("<HH", data, 26)
        return width & 0x3FFF, height & 0x3FFF
    return None

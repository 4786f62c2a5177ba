# SPDX-License-Identifier: Apache-2.0
"""Is a file as long as it says of itself? Decoders answer a truncated file with grey areas, noise or silence."""

from __future__ import annotations

from pathlib import Path
from typing import BinaryIO

_MATROSKA, _SEGMENT = b"\x1a\x45\xdf\xa3", b"\x18\x53\x80\x67"


def is_whole_image(data: bytes) -> bool:
    """False for a JPEG or PNG without its end marker; True where the format keeps none."""
    if data.startswith(b"\xff\xd8"):
        return data.find(b"\xff\xd9", _scan_of(data)) > 0
    if data.startswith(b"\x89PNG"):
        return b"IEND" in data
    return True


def is_whole_video(path: Path) -> bool:
    """False for an MP4, MOV, Matroska, WebM or AVI file that ends before its own tables say; True for other formats."""
    size = path.stat().st_size
    with path.open("rb") as file:
        head = file.read(12)
        if head[4:8] in (b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide"):
            return _boxes_end(file, size) <= size
        if head.startswith(_MATROSKA):
            return _segment_end(file) <= size
        if head.startswith(b"RIFF"):
            return int.from_bytes(head[4:8], "little") + 8 <= size
    return True


def _scan_of(data: bytes) -> int:
    """Where the first scan of a JPEG begins; what comes before may hold a thumbnail with an end marker of its own."""
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] != 0xDA:
        at += 1 if data[at + 1] == 0xFF else 2 + int.from_bytes(data[at + 2 : at + 4], "big")
    return at


def _boxes_end(file: BinaryIO, size: int) -> int:
    """Where the last top-level box of an ISO media file ends."""
    end = 0
    while end + 8 <= size:
        file.seek(end)
        head = file.read(16)
        length = int.from_bytes(head[:4], "big")
        if length == 1:
            length = int.from_bytes(head[8:16], "big")
        if length == 0:
            return size
        if length < 8:
            break
        end += length
    return end


def _segment_end(file: BinaryIO) -> int:
    """Where the segment of a Matroska file ends; 0 for one of unknown size, as a live recording has."""
    file.seek(len(_MATROSKA))
    file.seek(_read_ebml_number(file)[0], 1)
    if file.read(len(_SEGMENT)) != _SEGMENT:
        return 0
    length, unknown = _read_ebml_number(file)
    return 0 if unknown else file.tell() + length


def _read_ebml_number(file: BinaryIO) -> tuple[int, bool]:
    """An EBML number, whose leading zeros count its bytes; all ones mean that the size is unknown."""
    first = file.read(1)
    if not first or first[0] == 0:
        return 0, True
    extra = 8 - first[0].bit_length()
    value = int.from_bytes(bytes([first[0] & (0x7F >> extra)]) + file.read(extra), "big")
    return value, value == (1 << (7 * (extra + 1))) - 1

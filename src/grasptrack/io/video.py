# SPDX-License-Identifier: Apache-2.0
"""Video files, through PyAV: read as a source, and written as H.264 in MP4 as browsers play it (OpenCV writes none)."""

from __future__ import annotations

import math
import re
import struct
import warnings
from collections.abc import Generator, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import InputError, SourceError, install_hint
from grasptrack.io.base import UNREAD, Image, Source
from grasptrack.io.limits import check_size, max_megapixels
from grasptrack.io.pixels import EightBits

_TEXT_ART = frozenset({"ansi", "bintext", "xbin", "idf"})
"""Decoders with which FFmpeg draws any text file as a video of letters."""

_STILLS = frozenset({"heic", "heix", "heim", "heis", "mif1", "avif"})
"""Brands of files that hold an image, in tiles where it is large."""

_DEEP, _WITH_ALPHA = re.compile("(rgb|bgr)48|gbrp16"), re.compile("yuva|rgba|argb|bgra|abgr|gbrap|ya8|ya16|pal8")
"""Formats of pixels."""


def open_media(file: Any, **options: Any) -> Any:
    """A container of PyAV's to read from; metadata that are not in UTF-8 are no error, in whichever version."""
    import av

    if int(av.__version__.partition(".")[0]) < 19:
        options["metadata_errors"] = "replace"
    return av.open(file, "r", **options)


class VideoSource(Source):
    """The first video stream of a file: grey where it is recorded so, else BGR, as `UprightImages` makes it.

    Times are presentation times in s, as the file has them. A file that is damaged or cut short raises SourceError
    after the frames that can be read.
    """

    kind = "video"

    def __init__(self, path: Path, fps: float | None = None) -> None:
        super().__init__(str(path), fps)
        self._path, self.files = path, (path,)
        if path.stat().st_size == 0:
            raise SourceError(f'video "{path}" is empty', path=str(path))
        with self._open_container() as container:
            stream = container.streams.video[0]
            if stream.metadata.get("alpha_mode") == "1":  # beside the images, as of VP8 and VP9
                told = "what is transparent in it is not read, and shows the colours beneath"
                warnings.warn(f'video "{self._path}": {told}', stacklevel=2)
            warn_of_aspect(stream, f'video "{self._path}"')
            rate = float(stream.average_rate or 0)
            self.fps = fps or (rate if rate > 0 else None)
            self.exact = stream.frames > 0
            self.count = stream.frames or max(round((container.duration or 0) * 1e-6 * rate), 0) or None  # us

    def _open_container(self) -> Any:
        import av

        try:
            container = open_media(str(self._path), options=_decoder_limit())
        except (av.FFmpegError, OSError, ValueError) as error:
            if not is_whole_video(self._path):
                reason = "is truncated: no frame of it can be read"
            elif isinstance(error, PermissionError):
                reason = "cannot be read: Permission denied"
            else:
                reason = "is no video that can be read"
            raise SourceError(f'"{self._path}" {reason}', path=str(self._path)) from None
        try:
            check_stream(container, f'"{self._path}"')
        except SourceError:
            container.close()
            raise
        return container

    def _read_images(self) -> Generator[tuple[Image, float | None, str], None, None]:
        import av

        index, longest, last = 0, 0.0, math.nan
        self.shortfall = ""
        with self._open_container() as container:
            told, upright = _told_end(container), UprightImages(container.streams.video[0])
            try:
                base = container.streams.video[0].time_base
                for frame in decode_frames(container):
                    time = None if frame.pts is None else float(frame.pts * (frame.time_base or base))
                    image = UNREAD if 0 < index < self.first else upright(frame)  # the first one sets the scale
                    yield image, time, f"frame {index} of {self._path.name}"
                    if time is not None:
                        longest, last = max(longest, time - last if index else 0.0), time
                    index += 1
            except av.FFmpegError:
                kind = "damaged" if is_whole_video(self._path) else "truncated"
                raise SourceError(
                    f'video "{self._path}" is {kind}: it can be read up to frame {index}',
                    path=str(self._path),
                    frame=index,
                ) from None
        if not is_whole_video(self._path):
            raise SourceError(
                f'video "{self._path}" is truncated: it ends after {index} frames', path=str(self._path), frame=index
            )
        if index == 0:
            raise SourceError(f'video "{self._path}" holds no frame that can be read', path=str(self._path))
        if self.exact and self.count is not None and index < self.count:
            self.shortfall = f"it ends early: its header tells of {self.count} frames, {index} could be read"
        elif told is not None and last + 2.0 * longest < told:
            # the last frame lasts as long as the longest, and rounding
            self.shortfall = f"it ends early: its header tells of {told:.2f} s, its last frame is at {last:.2f} s"


def check_stream(container: Any, name: str) -> None:
    """See that what was opened holds a video of a size that is read, and limit its decoder to that."""
    tiles = len(container.streams.video)
    if tiles > 1 and container.metadata.get("major_brand", "").strip() in _STILLS:
        raise SourceError(
            f"{name} is a HEIF image of {tiles} tiles, which FFmpeg does not put together: {install_hint('heif')}"
        )
    codec = container.streams.video[0].codec_context if tiles else None
    if codec is None or codec.name in _TEXT_ART:
        why = "it has no video stream" if codec is None else "it is text"
        raise SourceError(f"{name} is no video that can be read: {why}", name=name)
    check_size(*UprightImages(container.streams.video[0]).size_of(codec.width, codec.height), f"video {name}")
    codec.options = {**codec.options, **_decoder_limit()}


def warn_of_aspect(stream: Any, name: str) -> None:
    """Say, where its pixels are not square, that contacts are told in px of another size than that of the file or stream."""
    upright, codec = UprightImages(stream), stream.codec_context
    size = upright.size_of(codec.width, codec.height)
    if size != (codec.width, codec.height):
        wide = f"pixels are {upright.aspect:.4g} times as wide as high"
        warnings.warn(f"{name}: its {wide}; it is read with square ones, {size[0]}x{size[1]}", stacklevel=3)


def _decoder_limit() -> dict[str, str]:
    """What makes decoders themselves refuse larger images."""
    return {"max_pixels": str(math.ceil(max_megapixels() * 1e6))}


def decode_frames(container: Any) -> Iterator[Any]:
    """All frames; before a decoding error is raised, those that the decoder still holds."""
    import av

    stream = container.streams.video[0]
    try:
        for packet in container.demux(stream):
            for frame in packet.decode():
                if getattr(frame, "is_corrupt", False):
                    raise av.InvalidDataError(1, "damaged frame")
                yield frame
    except av.FFmpegError:
        try:
            held = [f for f in stream.codec_context.decode(None) if not getattr(f, "is_corrupt", False)]
        except av.FFmpegError:
            held = []
        yield from held
        raise


class UprightImages:
    """Pictures as they are to be seen: turned and mirrored as the header asks, with square pixels, in 8 bits.

    Values of 16 bits, which do not tell how many are used, have one scale for all of a video, and what is transparent is
    black, see `EightBits`. PyAV's stream tells the aspect of its pixels; without one they are square.
    """

    def __init__(self, stream: Any = None) -> None:
        self._to_eight = EightBits()
        self.aspect = float((None if stream is None else stream.sample_aspect_ratio) or 1.0)

    def __call__(self, frame: Any) -> Image:
        """(H, W) or (H, W, 3) uint8."""
        name = frame.format.name
        if name.startswith("gray16"):
            image: Image = self._to_eight(frame.to_ndarray(format=name))
        elif _DEEP.match(name):
            image = self._to_eight(frame.to_ndarray(format="bgr48le"))
        elif _WITH_ALPHA.match(name):
            image = self._to_eight(frame.to_ndarray(format="bgra"))
        else:
            image = frame.to_ndarray(format="gray" if name.startswith(("gray", "mono")) else "bgr24")
        height, width = image.shape[:2]
        if self.size_of(width, height) != (width, height):
            image = cv2.resize(image, self.size_of(width, height), interpolation=cv2.INTER_LINEAR)
        a, b, c, d = _display_matrix(frame)
        if abs(a) + abs(d) < abs(b) + abs(c):  # x and y change places
            image, a, d = image.swapaxes(0, 1), c, b
        return np.ascontiguousarray(image[:: -1 if d < 0 else 1, :: -1 if a < 0 else 1])

    def size_of(self, width: int, height: int) -> tuple[int, int]:
        """Width and height of a picture with square pixels; no side becomes shorter."""
        return round(width * max(self.aspect, 1.0)), round(height / min(self.aspect, 1.0))


def _display_matrix(frame: Any) -> tuple[int, int, int, int]:
    """a, b, c, d by which the header has the pixel (x, y) at (a x + c y, b x + d y), but for where that begins."""
    for data in frame.side_data:
        if data.type.name == "DISPLAYMATRIX":
            a, b, _, c, d, *_ = struct.unpack("=9i", bytes(data))
            return a, b, c, d
    return 1, 0, 0, 1


def _told_end(container: Any) -> float | None:
    """s at which the last frame's time is over, as the header tells; None where it does not, or may mean another stream."""
    stream = container.streams.video[0]
    begins = float((stream.start_time or 0) * stream.time_base)
    if stream.duration:
        return begins + float(stream.duration * stream.time_base)
    if len(container.streams) == 1 and container.duration:
        return begins + float(container.duration) * 1e-6
    return None


DEFAULT_FPS = 25.0
MAX_FPS = 240.0
"""frames/s; a header that says more than this has no constant rate, and is not believed."""
_BT601, _LIMITED = 6, 1
_QUALITY = {"crf": "20", "preset": "veryfast", "threads": "1"}


class VideoWriter:
    """Writes BGR images of one size to an MP4 file, which begins with the first image and is playable once closed.

    Sides are made even, as the format wants them, by repeating the last row or column. A file that exists is written over.
    Frames/s are constant; None, or what is beyond belief, stands for 25.
    """

    def __init__(self, path: Path, fps: float | None = None) -> None:
        self._path = path
        self._fps = Fraction(fps if fps and fps <= MAX_FPS else DEFAULT_FPS).limit_denominator(1001)
        self._container: Any = None
        self._stream: Any = None
        self._count = 0

    def write(self, image: NDArray[np.uint8]) -> None:
        """Add an image (H, W, 3), BGR."""
        import av

        height, width = image.shape[:2]
        if height % 2 or width % 2:
            image = np.pad(image, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
        if self._container is None:
            self._open_container(image.shape[1], image.shape[0])
        # OpenCV's conversion keeps grey grey; FFmpeg's fast one tints it green.
        planes: Any = cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_BGR2YUV_I420)
        frame = av.VideoFrame.from_ndarray(planes, format="yuv420p")
        frame.pts = self._count
        frame.time_base = 1 / self._fps
        self._count += 1
        self._container.mux(self._stream.encode(frame))

    def _open_container(self, width: int, height: int) -> None:
        import av

        if "libx264" not in av.codecs_available:
            raise InputError("this build of PyAV has no H.264 encoder (libx264): leave the video out (--no-video)")
        # The index in front lets a browser start before the whole file is there.
        self._container = av.open(str(self._path), "w", options={"movflags": "+faststart"})
        stream = self._container.add_stream("libx264", rate=self._fps, options=_QUALITY)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        stream.time_base = 1 / self._fps
        stream.codec_context.colorspace, stream.codec_context.color_range = _BT601, _LIMITED
        self._stream = stream

    def close(self) -> None:
        """Write what the encoder still holds and the index; may be called again."""
        if self._container is None:
            return
        container, self._container = self._container, None
        try:
            container.mux(self._stream.encode(None))
        finally:
            container.close()


# --- is a file as long as it says of itself? ------------------------------------------------------

_MATROSKA, _SEGMENT = b"\x1a\x45\xdf\xa3", b"\x18\x53\x80\x67"


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

# SPDX-License-Identifier: Apache-2.0
"""Images out of messages: those of ROS (sensor_msgs) and of Foxglove, raw, compressed, or as H.264."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import SourceError
from grasptrack.io.base import Image
from grasptrack.io.images import decode_image
from grasptrack.io.limits import check_size
from grasptrack.io.pixels import EightBits, PixelFormat, raw_image, ros_format, to_image

_IMAGES = {
    ("sensor_msgs", "Image"): "raw",
    ("sensor_msgs", "CompressedImage"): "compressed",
    ("foxglove", "RawImage"): "raw",
    ("foxglove", "CompressedImage"): "compressed",
    ("foxglove", "CompressedVideo"): "video",
}
_CODECS = {"h264": "h264", "h265": "hevc", "vp9": "vp9", "av1": "libdav1d"}


class Topic(NamedTuple):
    """A topic of a recording, the type of its messages as spelt there, and their number, None where it is not known."""

    name: str
    type: str
    length: int | None

    @property
    def image_form(self) -> str:
        """What its messages hold: "raw", "compressed" or "video"; empty where they are no images."""
        return "" if self.name.endswith("/compressedDepth") else image_kind(self.type)


def image_kind(message_type: str) -> str:
    """ "raw", "compressed" or "video" for a type of message with images in it, as sensor_msgs/msg/Image; else empty."""
    package, *_, name = re.split(r"[./]", message_type) if message_type else [""]
    return _IMAGES.get((package.removesuffix("_msgs") if package == "foxglove_msgs" else package, name), "")


def stamp_of(message: Any) -> int | None:
    """ns of the header's or Foxglove's time stamp; None where it was left at zero."""
    stamp = message.header.stamp if hasattr(message, "header") else getattr(message, "timestamp", None)
    seconds = next((getattr(stamp, key) for key in ("sec", "seconds") if hasattr(stamp, key)), 0)
    rest = next((getattr(stamp, key) for key in ("nanosec", "nsec", "nanos") if hasattr(stamp, key)), 0)
    return int(seconds) * 1_000_000_000 + int(rest) or None


class MessageImages:
    """The images of one topic's "raw", "compressed" or "video" messages, in order, as grey (H, W) or BGR (H, W, 3), 8 bits.

    Deeper values use so many `bits`, from 9 to 16; None takes what suits the first image, for all of them.
    """

    def __init__(self, kind: str, bits: int | None = None) -> None:
        self._kind = kind
        self._to_eight = EightBits(None if bits is None else float((1 << bits) - 1))
        self._decoder: Any = None

    def decode_message(self, message: Any, name: str) -> Image | None:
        """A message's image; None where a video gives none yet."""
        if self._kind == "raw":
            return self._decode_raw(message, name)
        if self._kind == "compressed":
            return self._decode_compressed(message, name)
        return self._decode_video(message.data, message.format.lower(), name)

    def _decode_raw(self, message: Any, name: str) -> Image:
        check_size(message.width, message.height, name)
        form = ros_format(message.encoding)
        data, swapped = np.frombuffer(message.data, np.uint8), bool(getattr(message, "is_bigendian", 0))
        values = raw_image(data, message.width, message.height, form, message.step, big_endian=swapped)
        return self._to_eight_bits(values, form)

    def _to_eight_bits(self, values: NDArray[Any], form: PixelFormat) -> Image:
        if form.bits in (16, 32):  # 16 bits say nothing of how many are used
            values, form = self._to_eight(values), form._replace(bits=8)
        return to_image(values, form)

    def _decode_compressed(self, message: Any, name: str) -> Image | None:
        codec = re.search("h264|h265|hevc", str(message.format).lower())
        if codec:  # image_transport_plugins' and others'
            return self._decode_video(message.data, codec[0].replace("hevc", "h265"), name)
        image = decode_image(bytes(message.data), name)
        first, _, rest = str(message.format).partition(";")  # "bayer_rggb8; png compressed bayer_rggb8"
        within = rest.partition("compressed")[2].strip() or first.strip()
        if image.ndim == 2 and within.startswith("bayer"):  # the mosaic itself was compressed
            return self._to_eight_bits(image, ros_format(within)._replace(bits=8 * image.dtype.itemsize))
        return self._to_eight(image)

    def _decode_video(self, data: Any, kind: str, name: str) -> Image | None:
        import av

        from grasptrack.io.video import UprightImages

        if self._decoder is None:
            codec = _CODECS.get(kind)
            if codec is None:
                raise SourceError(f'{name} is video of format "{kind}"; {", ".join(_CODECS)} are read')
            self._decoder = av.CodecContext.create(codec, "r")
        try:
            frames = self._decoder.decode(av.Packet(bytes(data)))
        except av.FFmpegError:
            return None  # up to the first key frame
        return UprightImages()(frames[-1]) if frames else None

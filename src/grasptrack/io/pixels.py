# SPDX-License-Identifier: Apache-2.0
"""Raw pixels of cameras and of ROS as 8-bit images: Bayer mosaics, packed and deep grey, other orders of colours.

Where a format names its depth, as Mono12 does, values are scaled by that depth, always the same: light that changes must
change the grey levels, and nothing else may.
"""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import SourceError


class PixelFormat(NamedTuple):
    """How raw values are to be read.

    Attributes:
        channels: values for each pixel.
        bits: of a value that are used, counted from the lowest.
        order: "mono", "bgr", "rgb", "bgra", "rgba", a Bayer pattern such as "RGGB", or "yuyv", "uyvy", "nv12", "nv21".
        packed: "" where each value has whole bytes, "p" where they follow one another without gaps, the lowest bits
            first, "Packed" for two pixels in three bytes as GigE Vision has it.
    """

    channels: int
    bits: int
    order: str
    packed: str = ""

    @property
    def value_type(self) -> type[np.uint8] | type[np.uint16] | type[np.float32]:
        """Of one value that is not packed."""
        return np.uint8 if self.bits <= 8 else np.uint16 if self.bits <= 16 else np.float32

    def rows_of(self, height: int) -> int:
        """Rows of values of an image so many px high: half-sized colours follow the grey of some."""
        return height + height // 2 if self.order in ("nv12", "nv21") else height


_BAYER = {"RG": "RGGB", "GR": "GRBG", "GB": "GBRG", "BG": "BGGR"}
_COLOURS = {"RGB": 3, "BGR": 3, "RGBa": 4, "BGRa": 4, "RGBA": 4, "BGRA": 4}
_YUV = {"YUV422_8": "yuyv", "YCbCr422_8": "yuyv", "YUV422_8_UYVY": "uyvy", "YUV422Packed": "uyvy"}
_ROS = {
    "mono8": PixelFormat(1, 8, "mono"),
    "mono16": PixelFormat(1, 16, "mono"),
    "mono10": PixelFormat(1, 10, "mono"),
    "mono12": PixelFormat(1, 12, "mono"),
    "32FC1": PixelFormat(1, 32, "mono"),
    "8UC1": PixelFormat(1, 8, "mono"),
    "16UC1": PixelFormat(1, 16, "mono"),
    "rgb8": PixelFormat(3, 8, "rgb"),
    "bgr8": PixelFormat(3, 8, "bgr"),
    "8UC3": PixelFormat(3, 8, "bgr"),
    "rgba8": PixelFormat(4, 8, "rgba"),
    "bgra8": PixelFormat(4, 8, "bgra"),
    "8UC4": PixelFormat(4, 8, "bgra"),
    "rgb16": PixelFormat(3, 16, "rgb"),
    "bgr16": PixelFormat(3, 16, "bgr"),
    "yuv422": PixelFormat(2, 8, "uyvy"),
    "uyvy": PixelFormat(2, 8, "uyvy"),
    "yuv422_yuy2": PixelFormat(2, 8, "yuyv"),
    "yuyv": PixelFormat(2, 8, "yuyv"),
    "nv12": PixelFormat(1, 8, "nv12"),
    "nv21": PixelFormat(1, 8, "nv21"),
    **{
        f"bayer_{pattern.lower()}{bits}": PixelFormat(1, bits, pattern)
        for pattern in _BAYER.values()
        for bits in (8, 16)
    },
}


def genicam_format(name: str) -> PixelFormat:
    """A format by its name in GenICam: Mono12, BayerRG10p, RGB8, BGRa8Packed."""
    if name in _YUV:
        return PixelFormat(2, 8, _YUV[name])
    mono = re.fullmatch(r"(?:Mono|Bayer(RG|GR|GB|BG))(8|10|12|14|16)(p|Packed|)", name)
    if mono:
        pattern, bits, packed = mono.groups()
        return PixelFormat(1, int(bits), _BAYER[pattern] if pattern else "mono", packed if bits != "8" else "")
    colour = re.fullmatch(r"(RGBA?|BGRA?|RGBa|BGRa)(8|10|12|16)(?:Packed)?", name)
    if colour:
        return PixelFormat(_COLOURS[colour[1]], int(colour[2]), colour[1].lower())
    raise SourceError(
        f"pixels of format {name} are not read: choose Mono, Bayer, RGB or BGR (--set PixelFormat=Mono8)", format=name
    )


def ros_format(encoding: str) -> PixelFormat:
    """A format by its name in sensor_msgs/Image and foxglove.RawImage."""
    found = _ROS.get(encoding) or _ROS.get(encoding.lower())
    if found is None:
        raise SourceError(
            f'images of encoding "{encoding}" are not read, only {", ".join(list(_ROS)[:14])}, yuv422, nv12 and bayer_*',
            encoding=encoding,
        )
    return found


def raw_image(
    data: NDArray[np.uint8], width: int, height: int, form: PixelFormat, step: int = 0, *, big_endian: bool = False
) -> NDArray[Any]:
    """Raw bytes (n,) as an array (H, W) or (H, W, channels) of 8, 16 or 32 bits, nothing changed yet.

    `step` is bytes from a row to the next, 0 where nothing lies between them; sides of NV12 and NV21 are even.
    """
    if form.packed:
        return _unpack_values(data, width, height, form)
    if form.rows_of(height) > height and (width % 2 or height % 2):
        raise SourceError(f"an image of half-sized colours has an even number of px on each side, not {width}x{height}")
    row = width * form.channels * np.dtype(form.value_type).itemsize
    step, height = step or row, form.rows_of(height)
    if width < 1 or height < 1 or step < row or data.size < step * (height - 1) + row:
        raise SourceError(
            f"an image of {width}x{height} px needs {row * height} bytes, but has {data.size}, {step} a row",
            width=width,
            height=height,
        )
    rows = data[: step * height]
    if rows.size < step * height:  # the last row may end with its pixels
        rows = np.concatenate([rows, np.zeros(step * height - rows.size, np.uint8)])
    values = np.ascontiguousarray(rows.reshape(height, step)[:, :row]).view(form.value_type)
    if big_endian:
        values = values.byteswap()
    return values if form.channels == 1 else values.reshape(height, width, form.channels)


def _unpack_values(data: NDArray[np.uint8], width: int, height: int, form: PixelFormat) -> NDArray[np.uint16]:
    """Values of 10, 12 or 14 bits that share bytes, as uint16."""
    count = width * height
    needed = -(-count * (12 if form.packed == "Packed" else form.bits) // 8)
    if width < 1 or height < 1 or data.size < needed:
        raise SourceError(f"an image of {width}x{height} px needs {needed} bytes, but has {data.size}", width=width)
    if form.packed == "Packed":  # high byte, both low parts, high byte
        whole = np.zeros(-(-needed // 3) * 3, np.uint8)
        whole[:needed] = data[:needed]
        first, middle, second = whole.reshape(-1, 3).T.astype(np.uint16)
        low = form.bits - 8
        mask = (1 << low) - 1
        pair = np.stack([first << low | middle & mask, second << low | middle >> 4 & mask], axis=1)
        return np.asarray(pair.ravel()[:count].reshape(height, width), dtype=np.uint16)
    size = form.bits // 2  # bytes of four values
    whole = np.zeros(-(-needed // size) * size, np.uint8)
    whole[:needed] = data[:needed]
    parts = whole.reshape(-1, size).T.astype(np.uint32)
    values = np.empty((parts.shape[1], 4), np.uint16)
    for k in range(4):
        byte, shift = divmod(k * form.bits, 8)
        joined = sum(part << np.uint32(8 * i) for i, part in enumerate(parts[byte : byte + 3]))
        values[:, k] = joined >> np.uint32(shift) & np.uint32((1 << form.bits) - 1)
    return values.ravel()[:count].reshape(height, width)


def to_image(raw: NDArray[Any], form: PixelFormat) -> NDArray[np.uint8]:
    """Raw values, as `raw_image` gives them, as grey (H, W) or BGR (H, W, 3), 8 bits."""
    image: Any = raw
    if image.dtype != np.uint8:
        image = cv2.convertScaleAbs(image, alpha=255.0 / ((1 << form.bits) - 1))
        image = image.reshape(raw.shape)
    if form.order == "mono" or form.order == "bgr":
        return np.ascontiguousarray(image, dtype=np.uint8)
    codes = {
        "rgb": cv2.COLOR_RGB2BGR,
        "rgba": cv2.COLOR_RGBA2BGR,
        "bgra": cv2.COLOR_BGRA2BGR,
        "yuyv": cv2.COLOR_YUV2BGR_YUYV,
        "uyvy": cv2.COLOR_YUV2BGR_UYVY,
        "nv12": cv2.COLOR_YUV2BGR_NV12,
        "nv21": cv2.COLOR_YUV2BGR_NV21,
        # OpenCV names a mosaic by its second row's second and third pixel.
        "RGGB": cv2.COLOR_BayerBG2BGR,
        "GRBG": cv2.COLOR_BayerGB2BGR,
        "GBRG": cv2.COLOR_BayerGR2BGR,
        "BGGR": cv2.COLOR_BayerRG2BGR,
    }
    return np.asarray(cv2.cvtColor(np.ascontiguousarray(image), codes[form.order]), dtype=np.uint8)


# --- images of files, whose depth nothing tells ----------------------------------------------------

_FULL_SCALES = {"u": (1023.0, 4095.0, 16383.0, 65535.0), "f": (1.0, 255.0, 1023.0, 4095.0, 16383.0, 65535.0)}
SATURATED = 0.05
"""Share of an image's values from which on the first image's scale is not that of the sequence: no glint takes as much."""


class EightBits:
    """Images of any depth as uint8, grey (H, W) or BGR (H, W, 3).

    8-bit values stay as they are. Deeper images are scaled by one factor for the whole sequence, that of the smallest usual
    full scale (1 for fractions, else 255 for float images, 10, 12, 14 or 16 bits) that holds the first image's largest value,
    so that a dark 12-bit recording is not left with a dozen grey levels; what is brighter later on saturates, as in a camera.
    Only where much of an image would, as after a first one that was nearly black, the scale rises. What is transparent shows
    black.

    Args:
        full: value of deeper images that becomes 255; None takes the one that suits the first of them.
    """

    def __init__(self, full: float | None = None) -> None:
        self._full, self._told = full, full is not None

    def __call__(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        """The image in 8 bits, (H, W) or (H, W, 3)."""
        plain = image
        if image.ndim == 3 and image.shape[2] == 4:
            opaque = np.iinfo(image.dtype).max if image.dtype.kind == "u" else 1.0
            plain = image[:, :, :3]
            if image[:, :, 3].min() < opaque and image[:, :, 3].any():  # where all is transparent, alpha is not meant
                plain = (plain * (image[:, :, 3:] / opaque)).astype(image.dtype)
        if plain.dtype == np.uint8:
            return np.ascontiguousarray(plain, dtype=np.uint8)
        if plain.dtype == np.bool_:
            return plain.astype(np.uint8) * np.uint8(255)
        values = np.nan_to_num(plain.astype(np.float32), posinf=0.0, neginf=0.0)
        if self._full is None or (not self._told and np.count_nonzero(values > self._full) > SATURATED * values.size):
            peak = float(values.max(initial=0.0))
            scales = _FULL_SCALES["f" if plain.dtype.kind == "f" else "u"]
            self._full = next((s for s in scales if s >= peak), peak)
        with np.errstate(over="ignore"):
            scaled: NDArray[np.uint8] = np.clip(values * (255.0 / self._full) + 0.5, 0.0, 255.0).astype(np.uint8)
        return scaled

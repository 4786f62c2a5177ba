# SPDX-License-Identifier: Apache-2.0
"""Kinds of files that hold images: how Pillow, OpenCV, tifffile and PyAV write each, and what has to come out of it.

`tests/scenarios/test_source_kinds.py` tries all of them, and the table in `docs/sources.md` is written from them. Videos and
bags are in `sequence_kinds.py`.
"""

import io
import struct
from collections.abc import Callable, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from PIL import Image

Pixels = np.ndarray
EXACT, CLOSE, ROUGH = 0.0, 1.0, 4.0
"""Mean difference in grey levels that a kind may have: none, of rounding and of colours in half size, of strong compression."""


class Held(NamedTuple):
    """What a file holds.

    Attributes:
        images: (H, W) or BGR (H, W, 3) uint8 each, upright.
        times: s, None where the file has none.
    """

    images: Sequence[Pixels]
    times: Sequence[float] | None = None


class Kind(NamedTuple):
    """One kind of file.

    Attributes:
        format: as people call it, and what suffix it has; what is special about this one.
        suffix: of its name.
        what: the encoding or dialect.
        write: makes the file of a number, which gives size and content, and tells what it holds.
        within: as above.
        refused: the line that refuses it, as a pattern; empty where it is read.
        needs: package that writes it.
    """

    format: str
    suffix: str
    what: str
    write: Callable[[Path, int], Held]
    within: float = EXACT
    refused: str = ""
    needs: str = "PIL"

    @property
    def can_be_written(self) -> bool:
        return find_spec(self.needs) is not None


SIZES = ((48, 64), (64, 48), (36, 100), (120, 90), (50, 150))
"""Height and width in px, by a file's number."""


def colours(number: int, shift: int = 0, size: tuple[int, int] | None = None) -> Pixels:
    """(H, W, 3) BGR, smooth, and unlike itself turned or mirrored."""
    height, width = size or SIZES[number % len(SIZES)]
    y, x = np.mgrid[:height, :width].astype(np.float64)
    blob = np.exp(-(((x - 0.3 * width - shift) / (0.2 * width)) ** 2) - ((y - 0.7 * height) / (0.25 * height)) ** 2)
    planes = [40 + 170 * x / width, 200 - 150 * y / height, 30 + 200 * blob]
    return np.stack(planes, axis=-1).round().astype(np.uint8)


def grey(number: int, shift: int = 0) -> Pixels:
    """(H, W) uint8."""
    return colours(number, shift)[:, :, 2]


def deep(number: int, bits: int = 16, shift: int = 0) -> Pixels:
    """(H, W) uint16 of so many bits."""
    return ((grey(number, shift).astype(np.float64) + 20) / 275 * (2**bits - 1)).round().astype(np.uint16)


def in_eight(values: Pixels, full: float) -> Pixels:
    """By the definition of the scale."""
    return np.clip(np.asarray(values, np.float64) * 255.0 / full + 0.5, 0, 255).astype(np.uint8)


def lit(bgr: Pixels, alpha: Pixels) -> Pixels:
    """On black."""
    return (bgr * (alpha[:, :, None] / 255.0)).astype(np.uint8)


def alpha_of(number: int) -> Pixels:
    """(H, W) uint8, clear on the left."""
    height, width = SIZES[number % len(SIZES)]
    return np.tile((255.0 * np.arange(width) / (width - 1)).astype(np.uint8), (height, 1))


def indexed(number: int) -> Image.Image:
    return Image.fromarray(colours(number)[:, :, ::-1]).quantize(40)


def rgb_of(picture: Image.Image) -> Pixels:
    return np.ascontiguousarray(np.asarray(picture.convert("RGB"))[:, :, ::-1])


def pillow(form: str, make: Callable[[int], Image.Image], held: Callable[[int], Pixels], **options: Any) -> Any:
    """Writes with Pillow."""

    def write(path: Path, number: int) -> Held:
        make(number).save(path, form, **options)
        return Held([held(number)])

    return write


def as_rgb(number: int) -> Image.Image:
    return Image.fromarray(colours(number)[:, :, ::-1])


def as_grey(number: int) -> Image.Image:
    return Image.fromarray(grey(number))


def as_rgba(number: int) -> Image.Image:
    return Image.fromarray(np.dstack([colours(number)[:, :, ::-1], alpha_of(number)]))


def as_bits(number: int) -> Image.Image:
    return Image.fromarray(grey(number) > 100)


def bits_held(number: int) -> Pixels:
    return np.where(grey(number) > 100, 255, 0).astype(np.uint8)


def clear(number: int, make: Callable[[int], Pixels] = colours) -> Pixels:
    image = make(number)
    shown = lit(np.atleast_3d(image), alpha_of(number))
    return np.repeat(shown, 3, axis=2) if image.ndim == 2 else shown


def as_grey_alpha(number: int) -> Image.Image:
    return Image.merge("LA", (as_grey(number), Image.fromarray(alpha_of(number))))


def multiplied(number: int) -> Pixels:
    return np.dstack([clear(number)[:, :, ::-1], alpha_of(number)])


def as_cmyk(number: int) -> Image.Image:
    return as_rgb(number).convert("CMYK")


def turned(form: str, **options: Any) -> Any:
    """An image that its EXIF says to turn or mirror, each of the five files another way."""
    flip = Image.Transpose
    ways = {2: flip.FLIP_LEFT_RIGHT, 3: flip.ROTATE_180, 5: flip.TRANSPOSE, 6: flip.ROTATE_90, 8: flip.ROTATE_270}

    def write(path: Path, number: int) -> Held:
        way = list(ways)[number % 5]
        exif = Image.Exif()
        exif[274] = way
        as_rgb(number).transpose(ways[way]).save(path, form, exif=exif, **options)
        return Held([colours(number)])

    return write


def moving(form: str, timed: bool = True, **options: Any) -> Any:
    """Four images in one file, of 40 ms each where the format has times."""

    def write(path: Path, number: int) -> Held:
        shown = [colours(number, 9 * k) for k in range(4)]
        first, *others = (Image.fromarray(image[:, :, ::-1]) for image in shown)
        first.save(path, form, save_all=True, append_images=others, **({"duration": 40} if timed else {}), **options)
        return Held(shown, [0.04 * k for k in range(4)] if timed else None)

    return write


def write_gif(path: Path, number: int) -> Held:
    """Colours of a palette, in images that change a part only."""
    base = indexed(number)
    shown = []
    for k in range(4):
        picture = base.copy()
        picture.paste(k, (5 + 4 * k, 6, 15 + 4 * k, 20))
        shown.append(picture)
    shown[0].save(path, "GIF", save_all=True, append_images=shown[1:], duration=50)
    return Held([rgb_of(picture) for picture in shown], [0.05 * k for k in range(4)])


def write_clear_gif(path: Path, number: int) -> Held:
    picture = indexed(number)
    hole = np.asarray(picture).copy()
    hole[10:20, 12:30] = 39
    made = Image.fromarray(hole)
    made.putpalette(picture.getpalette() or [])
    made.save(path, "GIF", transparency=39)
    shown = rgb_of(picture)
    shown[hole == 39] = 0
    return Held([shown])


def opencv(make: Callable[[int], Pixels], held: Callable[[int], Pixels], *options: int) -> Any:
    """Writes with OpenCV."""

    def write(path: Path, number: int) -> Held:
        assert cv2.imwrite(str(path), make(number), list(options))
        return Held([held(number)])

    return write


def deep_colours(number: int) -> Pixels:
    return colours(number).astype(np.uint16) * 257


def tiff(make: Callable[[int], Pixels], held: Callable[[int], Sequence[Pixels]], **options: Any) -> Any:
    """Writes with tifffile."""

    def write(path: Path, number: int) -> Held:
        import tifffile

        tifffile.imwrite(path, make(number), **options)
        return Held(held(number))

    return write


def stack(number: int) -> Pixels:
    return np.stack([grey(number, 9 * k) for k in range(4)])


def write_pyramid(path: Path, number: int) -> Held:
    """A large image and its smaller copies, as scanners and microscopes write them."""
    import tifffile

    image = colours(number)[:, :, ::-1]
    with tifffile.TiffWriter(path) as file:
        file.write(image, photometric="rgb")
        file.write(image[::2, ::2], photometric="rgb", subfiletype=1)
    return Held([colours(number)])


def write_thumbnailed(path: Path, number: int) -> Held:
    """A JPEG with a thumbnail in its EXIF, as every camera writes it."""
    small, whole = io.BytesIO(), io.BytesIO()
    as_rgb(number).resize((16, 12)).save(small, "JPEG")
    as_rgb(number).save(whole, "JPEG", quality=95, subsampling=0)
    data, segment = whole.getvalue(), b"Exif\0\0" + small.getvalue()
    path.write_bytes(data[:2] + b"\xff\xe1" + struct.pack(">H", len(segment) + 2) + segment + data[2:])
    return Held([colours(number)])


def write_low(path: Path, number: int) -> Held:
    image = np.rint(grey(number) * (100 / 255)).astype(np.uint8)
    path.write_bytes(f"P5\n{image.shape[1]} {image.shape[0]}\n100\n".encode() + image.tobytes())
    return Held([grey(number)])


def write_mpo(path: Path, number: int) -> Held:
    """As phones write it: what follows the first image is a preview, or how bright a better screen may show it."""
    as_rgb(number).save(path, "MPO", save_all=True, append_images=[as_grey(number).convert("RGB")])
    return Held([colours(number)])


def heif(**options: Any) -> Any:
    """Writes with pillow-heif."""

    def write(path: Path, number: int) -> Held:
        import pillow_heif

        shown = [colours(number, 9 * k) for k in range(options.get("count", 1))]
        file = pillow_heif.from_bytes("RGB", shown[0].shape[1::-1], shown[0][:, :, ::-1].tobytes())
        for image in shown[1:]:
            file.add_frombytes("RGB", image.shape[1::-1], image[:, :, ::-1].tobytes())
        file.save(path, quality=90)
        return Held(shown)

    return write


def write_tiled(path: Path, number: int) -> Held:
    """In tiles, as phones write every photo, and turned by its header."""
    import pillow_heif

    size = 128 * (1 + number % 2), 384
    image = cv2.resize(colours(number), size)
    exif = Image.Exif()
    exif[274] = 6
    before, pillow_heif.options.GRID_TILE_SIZE = pillow_heif.options.GRID_TILE_SIZE, 64
    try:
        pillow_heif.register_heif_opener()
        Image.fromarray(np.rot90(image)[:, :, ::-1]).save(path, "HEIF", exif=exif.tobytes(), quality=90)
    finally:
        pillow_heif.options.GRID_TILE_SIZE = before
    return Held([image])


def cut(write: Any) -> Any:
    """The first 70 % of such a file."""

    def write_part(path: Path, number: int) -> Held:
        write(path, number)
        data = path.read_bytes()
        path.write_bytes(data[: int(0.7 * len(data))])
        return Held([])

    return write_part


NOT_READ = "cannot be read: it is damaged, or no image of a kind that is read"
_PNG, _JPEG, _TIFF = ("PNG", "png"), ("JPEG", "jpg"), ("TIFF", "tif")
_WEBP, _AVIF, _GIF, _HEIC = ("WebP", "webp"), ("AVIF", "avif"), ("GIF", "gif"), ("HEIC", "heic")
_BMP, _JP2 = ("BMP", "bmp"), ("JPEG 2000", "jp2")


def _tif(what: str, write: Any, within: float = EXACT, refused: str = "") -> Kind:
    return Kind(*_TIFF, what, write, within, refused, "tifffile")


STILLS = (
    Kind(*_PNG, "grey", pillow("PNG", as_grey, grey)),
    Kind(*_PNG, "colours", pillow("PNG", as_rgb, colours)),
    Kind(*_PNG, "palette", pillow("PNG", indexed, lambda n: rgb_of(indexed(n)))),
    Kind(*_PNG, "1 bit", pillow("PNG", as_bits, bits_held)),
    Kind(*_PNG, "with alpha", pillow("PNG", as_rgba, clear)),
    Kind(*_PNG, "grey with alpha", pillow("PNG", as_grey_alpha, lambda n: clear(n, grey))),
    Kind(*_PNG, "grey, 16 bits", opencv(deep, lambda n: in_eight(deep(n), 65535), cv2.IMWRITE_PNG_COMPRESSION, 1)),
    Kind(*_PNG, "grey, 12 of 16 bits", opencv(lambda n: deep(n, 12), lambda n: in_eight(deep(n, 12), 4095))),
    Kind(*_PNG, "colours, 16 bits", opencv(deep_colours, lambda n: in_eight(deep_colours(n), 65535))),
    Kind(*_PNG, "turned by EXIF", turned("PNG")),
    Kind(*_PNG, "of several images", moving("PNG")),
    Kind(*_JPEG, "colours", pillow("JPEG", as_rgb, colours, quality=95, subsampling=0), CLOSE),
    Kind(*_JPEG, "progressive, colours in half size", pillow("JPEG", as_rgb, colours, progressive=True), ROUGH),
    Kind(*_JPEG, "grey", pillow("JPEG", as_grey, grey, quality=95), CLOSE),
    Kind(*_JPEG, "CMYK", pillow("JPEG", as_cmyk, colours, quality=95), ROUGH),
    Kind(*_JPEG, "turned by EXIF", turned("JPEG", quality=95, subsampling=0), CLOSE),
    Kind(*_JPEG, "with a thumbnail", write_thumbnailed, CLOSE),
    Kind(*_JPEG, "with a second image behind the first (MPO)", write_mpo, ROUGH),
    Kind(*_TIFF, "grey, LZW", pillow("TIFF", as_grey, grey, compression="tiff_lzw")),
    Kind(*_TIFF, "colours, deflated", pillow("TIFF", as_rgb, colours, compression="tiff_adobe_deflate")),
    Kind(*_TIFF, "colours, JPEG", pillow("TIFF", as_rgb, colours, compression="jpeg", quality=95), ROUGH),
    Kind(*_TIFF, "1 bit, fax", pillow("TIFF", as_bits, bits_held, compression="group4")),
    Kind(*_TIFF, "palette", pillow("TIFF", indexed, lambda n: rgb_of(indexed(n)))),
    Kind(*_TIFF, "CMYK", pillow("TIFF", as_cmyk, colours), CLOSE),
    Kind(*_TIFF, "with alpha", pillow("TIFF", as_rgba, clear)),
    Kind(*_TIFF, "grey with alpha", pillow("TIFF", as_grey_alpha, lambda n: clear(n, grey))),
    _tif(
        "multiplied by alpha",
        tiff(lambda n: multiplied(n), lambda n: [clear(n)], photometric="rgb", extrasamples=["assocalpha"]),
        CLOSE,
    ),
    _tif(
        "multiplied by alpha, 16 bits",
        tiff(
            lambda n: multiplied(n).astype(np.uint16) * 257,
            lambda n: [clear(n)],
            photometric="rgb",
            extrasamples=["assocalpha"],
        ),
        CLOSE,
    ),
    Kind(*_TIFF, "turned by EXIF", turned("TIFF")),
    Kind(*_TIFF, "several pages", moving("TIFF", timed=False)),
    _tif("grey, 16 bits", tiff(deep, lambda n: [in_eight(deep(n), 65535)])),
    _tif(
        "colours, 16 bits, BigTIFF",
        tiff(
            lambda n: deep_colours(n)[:, :, ::-1],
            lambda n: [in_eight(deep_colours(n), 65535)],
            bigtiff=True,
            photometric="rgb",
        ),
    ),
    _tif("fractions, 32 bits", tiff(lambda n: (grey(n) / 255).astype(np.float32), lambda n: [grey(n)])),
    _tif("big-endian", tiff(deep, lambda n: [in_eight(deep(n), 65535)], byteorder=">")),
    _tif("in tiles", tiff(lambda n: colours(n)[:, :, ::-1], lambda n: [colours(n)], tile=(16, 16), photometric="rgb")),
    _tif(
        "in planes",
        tiff(
            lambda n: np.moveaxis(colours(n)[:, :, ::-1], -1, 0),
            lambda n: [colours(n)],
            planarconfig="separate",
            photometric="rgb",
        ),
    ),
    _tif("0 is white", tiff(lambda n: 255 - grey(n), lambda n: [grey(n)], photometric="miniswhite")),
    _tif("a stack of ImageJ's", tiff(stack, lambda n: list(stack(n)), imagej=True)),
    _tif(
        "an OME stack",
        tiff(stack, lambda n: list(stack(n)), ome=True, photometric="minisblack", metadata={"axes": "TYX"}),
    ),
    _tif("a pyramid", write_pyramid),
    Kind(*_WEBP, "lossless", pillow("WEBP", as_rgb, colours, lossless=True)),
    Kind(*_WEBP, "lossy", pillow("WEBP", as_rgb, colours, quality=95), ROUGH),
    Kind(*_WEBP, "with alpha", pillow("WEBP", as_rgba, clear, lossless=True, exact=True)),
    Kind(*_WEBP, "turned by EXIF", turned("WEBP", lossless=True)),
    Kind(*_WEBP, "of several images", moving("WEBP", lossless=True)),
    Kind(*_AVIF, "colours", pillow("AVIF", as_rgb, colours, quality=95), ROUGH),
    Kind(*_AVIF, "turned", turned("AVIF", quality=95), ROUGH),
    Kind(*_AVIF, "of several images", moving("AVIF", quality=95), ROUGH),
    Kind(*_GIF, "one image", pillow("GIF", indexed, lambda n: rgb_of(indexed(n)))),
    Kind(*_GIF, "with a clear colour", write_clear_gif),
    Kind(*_GIF, "of several images", write_gif),
    Kind(*_HEIC, "one image", heif(), ROUGH, needs="pillow_heif"),
    Kind(*_HEIC, "in tiles, turned", write_tiled, ROUGH, needs="pillow_heif"),
    Kind(*_HEIC, "several images", heif(count=3), ROUGH, needs="pillow_heif"),
    Kind(*_JP2, "colours", pillow("JPEG2000", as_rgb, colours)),
    Kind("JPEG 2000", "j2k", "without a container", pillow("JPEG2000", as_grey, grey, no_jp2=True)),
    Kind(*_JP2, "grey, 16 bits", opencv(deep, lambda n: in_eight(deep(n), 65535)), CLOSE),
    Kind(*_BMP, "colours", pillow("BMP", as_rgb, colours)),
    Kind(*_BMP, "palette", pillow("BMP", indexed, lambda n: rgb_of(indexed(n)))),
    Kind(*_BMP, "grey", opencv(grey, grey)),
    Kind("Netpbm", "ppm", "colours", opencv(colours, colours)),
    Kind("Netpbm", "pgm", "grey", pillow("PPM", as_grey, grey)),
    Kind("Netpbm", "pgm", "grey, 16 bits", opencv(deep, lambda n: in_eight(deep(n), 65535))),
    Kind("Netpbm", "pgm", "grey, white is 100", write_low, CLOSE),
    Kind("Netpbm", "pbm", "1 bit", pillow("PPM", as_bits, bits_held)),
    Kind("Targa", "tga", "colours, as a video of one image", pillow("TGA", as_rgb, colours)),
    Kind(
        "Radiance",
        "hdr",
        "colours, as a video of one image",
        opencv(lambda n: (colours(n) / 255).astype(np.float32), colours),
        CLOSE,
    ),
    _tif(
        "five channels",
        tiff(lambda n: np.dstack([grey(n)] * 5), lambda n: [], planarconfig="contig", photometric="minisblack"),
        refused=NOT_READ,
    ),
    _tif("fractions of 16 bits", tiff(lambda n: (grey(n) / 255).astype(np.float16), lambda n: []), refused=NOT_READ),
    Kind(*_PNG, "cut off", cut(pillow("PNG", as_rgb, colours)), refused="is truncated"),
    Kind(*_JPEG, "cut off", cut(pillow("JPEG", as_rgb, colours)), refused="is truncated"),
    Kind(*_WEBP, "cut off", cut(pillow("WEBP", as_rgb, colours)), refused=NOT_READ),
    Kind(*_GIF, "cut off", cut(pillow("GIF", indexed, colours)), refused="cannot be read: it is damaged"),
    Kind(*_AVIF, "cut off", cut(pillow("AVIF", as_rgb, colours)), refused="cannot be read: it is damaged"),
    Kind(*_JP2, "cut off", cut(pillow("JPEG2000", as_rgb, colours)), refused=NOT_READ),
    Kind(*_HEIC, "cut off", cut(heif()), refused="cannot be read: it is damaged", needs="pillow_heif"),
)

# SPDX-License-Identifier: Apache-2.0
"""Kinds of files that hold sequences: how PyAV, rosbags and mcap write each, and what is to come out; see `source_kinds.py`."""

import base64
import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
import pytest

import bags
from source_kinds import CLOSE, EXACT, ROUGH, SIZES, Held, Kind, Pixels, alpha_of, colours, deep, grey, in_eight, lit

COUNT = 5
RATE = 20


def even(number: int, shift: int = 0) -> Pixels:
    """(H, W, 3) BGR, with even sides."""
    return np.ascontiguousarray(colours(number, shift)[: 2 * (len(colours(number)) // 2)])


def video(
    codec: str,
    form: str,
    make: Callable[[int, int], Pixels] = even,
    held: Callable[[int, int], Pixels] = even,
    given: str = "bgr24",
    times: Sequence[int] = range(COUNT),
    *,
    tagged: tuple[int, int] | None = None,
    container: str | None = None,
    **options: str,
) -> Any:
    """Writes with PyAV.

    Args:
        codec, form: of the stream, its format of pixels.
        make: of a file's and an image's number, the array that is encoded.
        held: what comes out.
        given: format of that array.
        times: 1 / RATE s.
        tagged: colours and range of values that the stream tells of, as FFmpeg numbers them.
        container: its format, where the suffix does not tell.
        **options: of the codec.
    """

    def write(path: Path, number: int) -> Held:
        if codec not in av.codecs_available:
            pytest.skip(f"this build of PyAV has no {codec}")
        with av.open(str(path), "w", format=container) as file:
            stream = file.add_stream(codec, rate=RATE, options=options)
            stream.time_base = Fraction(1, RATE)
            first = av.VideoFrame.from_ndarray(make(number, 0), format=given)
            stream.width, stream.height, stream.pix_fmt = first.width, first.height, form
            if tagged is not None:
                stream.codec_context.colorspace, stream.codec_context.color_range = tagged
            for k, time in enumerate(times):
                frame = av.VideoFrame.from_ndarray(make(number, 7 * k), format=given)
                if tagged is not None:
                    frame = frame.reformat(format=form, dst_colorspace=tagged[0], dst_color_range=tagged[1])
                    frame.colorspace, frame.color_range = tagged
                frame.pts, frame.time_base = time, Fraction(1, RATE)
                file.mux(stream.encode(frame))
            file.mux(stream.encode(None))
        return Held([held(number, 7 * k) for k in range(len(times))], [time / RATE for time in times])

    return write


def large(number: int, shift: int = 0) -> Pixels:
    """For encoders that write beyond their memory where images are small."""
    return colours(number, shift, (256, 320 + 64 * number))


def grey_of(number: int, shift: int = 0) -> Pixels:
    return np.ascontiguousarray(even(number, shift)[:, :, 2])


def in_colours(number: int, shift: int = 0) -> Pixels:
    """Of decoders that know no grey."""
    return np.repeat(grey_of(number, shift)[:, :, None], 3, axis=2)


def with_alpha(number: int, shift: int = 0) -> Pixels:
    return np.dstack([even(number, shift), alpha_of(number)])


def on_black(number: int, shift: int = 0) -> Pixels:
    return lit(even(number, shift), alpha_of(number))


def deep_bgr(number: int, shift: int = 0) -> Pixels:
    return even(number, shift).astype(np.uint16) * 257


def turned_video(path: Path, number: int) -> Held:
    """An MP4 whose header turns it by a quarter, as phones write it."""
    held = video("libx264", "yuv420p", crf="8")(path, number)
    data = path.read_bytes()
    four, one = (1 << 16).to_bytes(4, "big"), (1 << 30).to_bytes(4, "big")
    less = (2**32 - (1 << 16)).to_bytes(4, "big")
    identity = b"".join((four, bytes(12), four, bytes(12), one))
    quarter = b"".join((bytes(4), four, bytes(4), less, bytes(16), one))
    at = data.index(identity, data.index(b"tkhd"))
    path.write_bytes(data[:at] + quarter + data[at + len(identity) :])
    return Held([np.ascontiguousarray(np.rot90(image, -1)) for image in held.images], held.times)


def write_sound(path: Path, number: int) -> Held:
    with av.open(str(path), "w") as file:
        stream = file.add_stream("pcm_s16le" if path.suffix == ".wav" else "aac", rate=8000)
        frame = av.AudioFrame.from_ndarray(
            np.zeros((1, 1024), np.int16 if path.suffix == ".wav" else np.float32),
            format="s16" if path.suffix == ".wav" else "fltp",
            layout="mono",
        )
        frame.sample_rate = 8000
        file.mux(stream.encode(frame))
        file.mux(stream.encode(None))
    return Held([])


def write_text(path: Path, number: int) -> Held:
    path.write_text("no picture\n" * (number + 40))
    return Held([])


_MP4, _MKV, _AVI, _MOV, _WEBM = (
    ("MP4", "mp4"),
    ("Matroska", "mkv"),
    ("AVI", "avi"),
    ("QuickTime", "mov"),
    ("WebM", "webm"),
)
_BY_AV = (
    Kind(*_MP4, "H.264", video("libx264", "yuv420p", crf="8"), ROUGH),
    Kind(*_MP4, "H.264, colours of BT.709", video("libx264", "yuv420p", tagged=(1, 1), crf="8"), ROUGH),
    Kind(*_MP4, "H.264, all 256 levels", video("libx264", "yuvj420p", tagged=(5, 2), crf="8"), ROUGH),
    Kind(*_MP4, "H.264, 10 bits", video("libx264", "yuv420p10le", crf="8"), ROUGH),
    Kind(*_MP4, "H.264, grey", video("libx264", "gray", grey_of, in_colours, "gray", tagged=(2, 2), crf="4"), ROUGH),
    Kind(*_MP4, "H.264, uneven times", video("libx264", "yuv420p", times=(0, 1, 4, 5, 11), crf="8"), ROUGH),
    Kind(*_MP4, "H.264, turned by its header", turned_video, ROUGH),
    Kind(*_MP4, "H.265", video("libx265", "yuv420p", large, large, crf="8"), ROUGH),
    Kind(*_MP4, "AV1", video("libsvtav1", "yuv420p", large, large, crf="10"), ROUGH),
    Kind(*_MP4, "MPEG-4", video("mpeg4", "yuv420p", qmin="1", qmax="2"), ROUGH),
    Kind(*_MKV, "FFV1, colours", video("ffv1", "bgr0"), EXACT),
    Kind(*_MKV, "FFV1, grey", video("ffv1", "gray", grey_of, grey_of, "gray"), EXACT),
    Kind(
        *_MKV,
        "FFV1, grey of 10 bits",
        video("ffv1", "gray10le", lambda n, s: deep(n, 10, s), lambda n, s: in_eight(deep(n, 10, s), 1023), "gray10le"),
        CLOSE,
    ),
    Kind(
        *_MKV,
        "FFV1, grey of 12 bits",
        video("ffv1", "gray12le", lambda n, s: deep(n, 12, s), lambda n, s: in_eight(deep(n, 12, s), 4095), "gray12le"),
        CLOSE,
    ),
    Kind(
        *_MKV,
        "FFV1, grey of 12 in 16 bits",
        video("ffv1", "gray16le", lambda n, s: deep(n, 12, s), lambda n, s: in_eight(deep(n, 12, s), 4095), "gray16le"),
    ),
    Kind(
        *_MKV,
        "FFV1, colours of 16 bits",
        video("ffv1", "gbrp16le", deep_bgr, lambda n, s: in_eight(deep_bgr(n, s), 65535), "bgr48le"),
        CLOSE,
    ),
    Kind(*_MKV, "FFV1, with alpha", video("ffv1", "bgra", with_alpha, on_black, "bgra"), EXACT),
    Kind(*_WEBM, "VP8", video("libvpx", "yuv420p", crf="4", b="4M"), ROUGH),
    Kind(*_WEBM, "VP9", video("libvpx-vp9", "yuv420p", crf="4", b="4M"), ROUGH),
    Kind(*_MOV, "ProRes", video("prores_ks", "yuv422p10le"), ROUGH),
    Kind(*_MOV, "PNG", video("png", "rgb24"), EXACT),
    Kind(*_MOV, "Animation, with alpha", video("qtrle", "argb", with_alpha, on_black, "bgra"), EXACT),
    Kind(*_AVI, "Motion JPEG", video("mjpeg", "yuvj420p", qmin="1", qmax="1"), ROUGH),
    Kind(*_AVI, "raw", video("rawvideo", "bgr24"), EXACT),
    Kind(*_AVI, "raw, grey", video("rawvideo", "gray", grey_of, grey_of, "gray"), EXACT),
    Kind(*_AVI, "HuffYUV", video("huffyuv", "rgb24"), EXACT),
    Kind("MPEG-TS", "ts", "MPEG-2", video("mpeg2video", "yuv420p", qmin="1", qmax="2"), ROUGH),
    Kind("Flash", "flv", "H.264", video("libx264", "yuv420p", crf="8"), ROUGH),
    Kind("Windows Media", "wmv", "WMV 2", video("wmv2", "yuv420p", qmin="1", qmax="2"), ROUGH),
    Kind("YUV4MPEG", "y4m", "raw", video("rawvideo", "yuv420p", container="yuv4mpegpipe"), ROUGH),
    Kind("MP4", "m4a", "sound alone", write_sound, refused="is no video that can be read: it has no video stream"),
    Kind("WAV", "wav", "sound", write_sound, refused="is no video that can be read: it has no video stream"),
    Kind("text", "txt", "words", write_text, refused="is no video that can be read: it is text"),
)
VIDEOS = tuple(kind._replace(needs="av") for kind in _BY_AV)


def bag(kind: str, encoding: str, make: Callable[[int, int], Pixels], held: Callable[[int, int], Pixels]) -> Any:
    """Writes with rosbags."""

    def write(path: Path, number: int) -> Held:
        folder = path.with_suffix("")
        folder.mkdir()
        made = bags.write_bag(folder, kind, {"/image": (encoding, [make(number, 7 * k) for k in range(COUNT)])})
        made.rename(path)
        return Held([held(number, 7 * k) for k in range(COUNT)], [0.033333333 * k for k in range(COUNT)])

    return write


def mosaic(number: int, shift: int = 0) -> Pixels:
    """Of one colour: what lies between a mosaic's pixels is a guess elsewhere."""
    values = np.empty(even(number).shape[:2], np.uint8)
    values[::2, ::2], values[::2, 1::2], values[1::2, ::2], values[1::2, 1::2] = 200, 110, 110, 40
    return values


def of_mosaic(number: int, shift: int = 0) -> Pixels:
    return np.full((*even(number).shape[:2], 3), (40, 110, 200), np.uint8)


def grey_message(number: int, shift: int = 0) -> Pixels:
    return grey(number, shift)


def swapped(number: int, shift: int = 0) -> Pixels:
    return np.ascontiguousarray(colours(number, shift)[:, :, ::-1])


def deep_message(number: int, shift: int = 0) -> Pixels:
    return deep(number, 12, shift)


def deep_held(number: int, shift: int = 0) -> Pixels:
    return in_eight(deep(number, 12, shift), 4095)


def foxglove(name: str, make: Callable[[int], Iterable[dict[str, Any]]], held: Callable[[int, int], Pixels]) -> Any:
    """Writes JSON with mcap, in the messages that Foxglove defines; `make` gives their fields."""

    def write(path: Path, number: int) -> Held:
        from mcap.writer import Writer

        with path.open("wb") as file:
            writer = Writer(file)
            writer.start()
            schema = writer.register_schema(f"foxglove.{name}", "jsonschema", b"{}")
            channel = writer.register_channel("/image", "json", schema)
            for k, fields in enumerate(make(number)):
                at, stamp = bags.BEGIN + k * 50_000_000, divmod(bags.BEGIN + k * 50_000_000, 10**9)
                data = base64.b64encode(fields.pop("data")).decode()
                told = {"timestamp": {"sec": stamp[0], "nsec": stamp[1]}, "frame_id": "camera", "data": data, **fields}
                writer.add_message(channel, at, json.dumps(told).encode(), at)
            writer.finish()
        return Held([held(number, 7 * k) for k in range(COUNT)], [0.05 * k for k in range(COUNT)])

    return write


def raw_fields(number: int) -> Iterator[dict[str, Any]]:
    for k in range(COUNT):
        image = colours(number, 7 * k)
        height, width = image.shape[:2]
        yield {"width": width, "height": height, "encoding": "bgr8", "step": 3 * width, "data": image.tobytes()}


def webp_fields(number: int) -> Iterator[dict[str, Any]]:
    for k in range(COUNT):
        coded = cv2.imencode(".webp", colours(number, 7 * k), [cv2.IMWRITE_WEBP_QUALITY, 101])[1]  # lossless
        yield {"format": "webp", "data": coded.tobytes()}


def video_fields(number: int) -> Iterator[dict[str, Any]]:
    encoder = av.CodecContext.create("libx264", "w")
    encoder.height, encoder.width = even(number).shape[:2]
    encoder.pix_fmt, encoder.framerate = "yuv420p", Fraction(RATE)
    encoder.options = {"crf": "8", "tune": "zerolatency"}
    frames = [av.VideoFrame.from_ndarray(even(number, 7 * k), format="bgr24") for k in range(COUNT)]
    for packet in (packet for frame in (*frames, None) for packet in encoder.encode(frame)):
        yield {"format": "h264", "data": bytes(packet)}


_ROS1, _ROS2, _MCAP = ("ROS 1 bag", "bag"), ("ROS 2 bag", "ros2"), ("MCAP", "mcap")
_MESSAGES = tuple(
    Kind(*form, f"`{encoding}`", bag(kind, encoding, make, held), within, needs="rosbags")
    for form, kind in ((_ROS1, "ros1.bag"), (_ROS2, "ros2"), (_MCAP, "plain.mcap"))
    for encoding, make, held, within in (
        ("bgr8", colours, colours, EXACT),
        ("rgb8", swapped, colours, EXACT),
        ("mono8", grey_message, grey_message, EXACT),
        ("mono16", deep_message, deep_held, CLOSE),
        ("bayer_rggb8", mosaic, of_mosaic, CLOSE),
        ("png", colours, colours, EXACT),
        ("jpeg", colours, colours, ROUGH),
    )
)
BAGS = (
    *_MESSAGES,
    Kind(*_MCAP, "`foxglove.RawImage`", foxglove("RawImage", raw_fields, colours), needs="mcap"),
    Kind(*_MCAP, "`foxglove.CompressedImage`, WebP", foxglove("CompressedImage", webp_fields, colours), needs="mcap"),
    Kind(*_MCAP, "`foxglove.CompressedVideo`", foxglove("CompressedVideo", video_fields, even), ROUGH, needs="mcap"),
    Kind(
        *_MCAP,
        "`64FC1`",
        bag("plain.mcap", "64FC1", lambda n, s: np.zeros((*SIZES[n], 8), np.uint8), colours),
        refused='images of encoding "64FC1" are not read',
        needs="rosbags",
    ),
)

# SPDX-License-Identifier: Apache-2.0
"""Raw pixels: what cameras pack comes out as it went in, and grey levels follow the light by one fixed factor."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from grasptrack import SourceError
from grasptrack.io.pixels import genicam_format, raw_image, ros_format, to_image


def packed_low_first(values: list[int], bits: int) -> bytes:
    """Values one after another in a stream of bits, by the definition of GenICam's formats with p."""
    joined = sum(value << (i * bits) for i, value in enumerate(values))
    return joined.to_bytes(-(-len(values) * bits // 8), "little")


def packed_gige(values: list[int], bits: int) -> bytes:
    """Two values in three bytes, by the definition of GigE Vision's formats with Packed."""
    out = bytearray()
    low = bits - 8
    for first, second in zip(values[::2], [*values[1::2], 0], strict=False):
        mask = (1 << low) - 1
        out += bytes([first >> low, first & mask | (second & mask) << 4, second >> low])
    return bytes(out)


@given(st.sampled_from([10, 12, 14]), st.integers(1, 9), st.integers(1, 7), st.data())
def test_packed_values_come_out_as_they_went_in(bits: int, width: int, height: int, data: st.DataObject) -> None:
    values = data.draw(st.lists(st.integers(0, 2**bits - 1), min_size=width * height, max_size=width * height))
    form = genicam_format(f"Mono{bits}p")
    found = raw_image(np.frombuffer(packed_low_first(values, bits), np.uint8), width, height, form)
    np.testing.assert_array_equal(found, np.reshape(values, (height, width)))


@given(st.sampled_from([10, 12]), st.integers(1, 9), st.integers(1, 7), st.data())
def test_values_packed_as_gige_does_come_out_as_they_went_in(
    bits: int, width: int, height: int, data: st.DataObject
) -> None:
    values = data.draw(st.lists(st.integers(0, 2**bits - 1), min_size=width * height, max_size=width * height))
    form = genicam_format(f"Mono{bits}Packed")
    found = raw_image(np.frombuffer(packed_gige(values, bits), np.uint8), width, height, form)
    np.testing.assert_array_equal(found, np.reshape(values, (height, width)))


@given(st.sampled_from([10, 12, 14, 16]), hnp.arrays(np.uint16, (3, 5), elements=st.integers(0, 1023)))
def test_the_scale_is_that_of_the_format_whatever_the_image_holds(bits: int, values: np.ndarray) -> None:
    form = genicam_format(f"Mono{bits}")
    raw = raw_image(values.view(np.uint8).ravel(), 5, 3, form)
    exact = values * (255.0 / (2**bits - 1))
    assert np.abs(to_image(raw, form).astype(float) - exact).max() <= 0.5 + 1e-4


@pytest.mark.parametrize("pattern", ["RG", "GR", "GB", "BG"])
@pytest.mark.parametrize("bits", [8, 10, 12, 16])
def test_a_mosaic_of_one_colour_is_that_colour(pattern: str, bits: int) -> None:
    full = {"R": 0.8, "G": 0.4, "B": 0.1}
    tile = pattern + {"RG": "GB", "GR": "BG", "GB": "RG", "BG": "GR"}[pattern]
    mosaic = np.empty((12, 16), np.uint16)
    for k, letter in enumerate(tile):
        mosaic[k // 2 :: 2, k % 2 :: 2] = round(full[letter] * (2**bits - 1))
    form = genicam_format(f"Bayer{pattern}{bits}")
    data = mosaic.astype(form.value_type).view(np.uint8).ravel()
    found = to_image(raw_image(data, 16, 12, form), form)
    expected = [255 * full[letter] for letter in "BGR"]
    assert np.abs(found[2:-2, 2:-2].astype(float) - expected).max() <= 1.0


@given(hnp.arrays(np.uint16, (4, 6)), st.integers(0, 5), st.booleans())
def test_rows_may_be_padded_and_bytes_swapped(values: np.ndarray, gap: int, big: bool) -> None:
    stored = values.byteswap() if big else values
    rows = np.zeros((4, 12 + gap), np.uint8)
    rows[:, :12] = stored.view(np.uint8)
    found = raw_image(rows.ravel(), 6, 4, ros_format("mono16"), 12 + gap, big_endian=big)
    np.testing.assert_array_equal(found, values)
    shorter = rows.ravel()[: rows.size - gap]  # the last row ends with its pixels
    np.testing.assert_array_equal(raw_image(shorter, 6, 4, ros_format("mono16"), 12 + gap, big_endian=big), values)


def test_colours_of_every_order_are_the_same_image() -> None:
    bgr = np.random.default_rng(0).integers(0, 256, (4, 6, 3), dtype=np.uint8)
    alpha = np.full((4, 6, 1), 255, np.uint8)
    for encoding, values in {
        "bgr8": bgr,
        "rgb8": bgr[:, :, ::-1],
        "bgra8": np.concatenate([bgr, alpha], axis=2),
        "rgba8": np.concatenate([bgr[:, :, ::-1], alpha], axis=2),
    }.items():
        form = ros_format(encoding)
        found = to_image(raw_image(np.ascontiguousarray(values).ravel(), 6, 4, form), form)
        np.testing.assert_array_equal(found, bgr)


@pytest.mark.parametrize("name", ["Mono8", "Mono12", "Mono12p", "Mono10Packed", "RGB8"])
def test_too_few_bytes_are_refused(name: str) -> None:
    with pytest.raises(SourceError, match="an image of 8x4 px needs"):
        raw_image(np.zeros(20, np.uint8), 8, 4, genicam_format(name))


@pytest.mark.parametrize("name", ["Confidence8", "Coord3D_ABC32f", "Mono9", "BayerXX8", ""])
def test_formats_that_are_no_pixels_of_an_image_are_refused(name: str) -> None:
    with pytest.raises(SourceError, match="PixelFormat=Mono8"):
        genicam_format(name)
    with pytest.raises(SourceError, match="are not read"):
        ros_format(name or "32FC1")

# SPDX-License-Identifier: Apache-2.0
"""Objects that differ from their ground by colour, or are darker here and lighter there: followed, never mistaken."""

from functools import partial

import cv2
import numpy as np
import pytest

from grasptrack.geometry.contours import Contour
from grasptrack.images import PLAIN
from grasptrack.segmentation.candidate import best_color_projection
from grasptrack_bench.simulation import SHAPES, Shape, TextureMap
from stages import HEIGHT, WIDTH, Colour, Run, bar, mirrored, photo, pose, twin

BRACKET, PLATE = (SHAPES[n]() for n in ("bracket", "notched-plate"))
MIRRORED = mirrored(BRACKET)
GREY: Colour = (150.0, 150.0, 150.0)
RED: Colour = (70.0, 60.0, 150.0)
WHITE: Colour = (245.0, 245.0, 245.0)
DARK: Colour = (60.0, 55.0, 50.0)
BLUE: Colour = (240.0, 132.0, 72.0)
"""Of very nearly GREY's lightness to a camera without colours."""


def paint(first: Colour, second: Colour, second_at: np.ndarray) -> TextureMap:
    picture = np.where(second_at[..., None], np.array(second), np.array(first)).astype(np.uint8)
    return TextureMap(cv2.GaussianBlur(picture, (0, 0), 0.8), 4.0)


y, x = np.mgrid[:512, :512] - 255.5
GROUND = paint(GREY, GREY, x > 0)
SURFACES = {
    "colour": paint(BLUE, BLUE, x > 0),
    "halves": paint(WHITE, DARK, x * np.cos(0.4) + y * np.sin(0.4) > 0),
    "print": paint(RED, WHITE, np.hypot(x, y) < 30),
}


painted = partial(photo, ground=GROUND, colour=True)


def moved(k: int) -> np.ndarray:
    return pose(150.0 + 2 * k, 118.0 + k, 2.0 * k, 70.0, 0.8 * k)


@pytest.mark.sampled(3)
@pytest.mark.parametrize(
    ("strategy", "light"), [("auto", 0.5), ("auto", 0.7), ("auto", (0.75, 1.0, 1.2)), ("rrp", 0.5)]
)
@pytest.mark.parametrize("surface", SURFACES)
def test_a_sudden_change_of_light_is_followed(surface: str, light: float | Colour, strategy: str) -> None:
    run = Run(strategy=strategy)
    for k in range(8):
        image = painted([(BRACKET, moved(k))], surface=SURFACES[surface], light=light if k >= 4 else 1.0, seed=k)
        run.see(image, moved(k))
    run.check(7)
    assert run.results[0].view is not None


@pytest.mark.parametrize("surface", ["halves", "print"])
def test_light_that_changes_slowly_is_followed(surface: str) -> None:
    run = Run()
    for k in range(12):
        run.see(painted([(BRACKET, moved(k))], surface=SURFACES[surface], light=1.0 - 0.04 * k, seed=k), moved(k))
    run.check(11)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("strategy", ["auto", "rrp"])
@pytest.mark.parametrize("surface", SURFACES)
@pytest.mark.parametrize(
    "stranger",
    [MIRRORED, twin(BRACKET, 0.08, 0.8), twin(BRACKET, 0.08, -0.8), None],
    ids=["mirrored", "tab", "notch", "gone"],
)
def test_an_exchanged_object_is_not_the_object(
    stranger: Shape | None, surface: str, strategy: str, request: pytest.FixtureRequest
) -> None:
    if request.node.callspec.id in ("mirrored-print-auto", "tab-print-auto", "tab-print-rrp"):
        reason = "wrong: the object's own print on another outline is taken for the object, partly covered"
        # a mirror image is refused with 0.00105, a twentieth beyond the risk, which the last digits may decide
        request.applymarker(pytest.mark.xfail(strict=stranger is not MIRRORED, reason=reason))
    run = Run(strategy=strategy)
    for k in range(7):
        shape = BRACKET if k < 4 else stranger
        image = painted([] if shape is None else [(shape, moved(k))], surface=SURFACES[surface], seed=k)
        run.see(image, moved(k) if k < 4 else None)
    assert run.right == [0, 1, 2, 3]
    run.check()


@pytest.mark.sampled(1)
@pytest.mark.parametrize("surface", SURFACES)
def test_a_cover_is_never_taken_for_the_object(surface: str) -> None:
    run = Run()
    for k in range(16):
        bars = ((bar(30.0 + 16 * (k - 4), 40.0), (120.0, 128.0, 131.0)),) if k >= 4 else ()
        run.see(painted([(BRACKET, moved(k))], surface=SURFACES[surface], bars=bars, seed=k), moved(k))
    run.check(8)


@pytest.mark.parametrize("surface", SURFACES)
def test_an_equal_elsewhere_is_not_the_covered_object(surface: str) -> None:
    run = Run()
    for k in range(8):
        where = pose(100.0 + k, 90.0, 2.0 * k, 55.0)
        parts, bars = [(BRACKET, where)], None
        if k >= 4:
            parts.append((BRACKET, pose(250.0, 160.0, 20.0, 55.0)))
            bars = ((bar(105.0, 90.0, 0.0), (90.0, 90.0, 180.0)),)
        run.see(painted(parts, surface=SURFACES[surface], bars=bars or (), seed=k), where if k < 4 else None)
    assert run.right == [0, 1, 2, 3]
    run.check()


@pytest.mark.parametrize("surface", SURFACES)
def test_what_was_moved_is_found_again(surface: str) -> None:
    run = Run()
    for k in range(8):
        where = pose(100.0 + k, 90.0, 2.0 * k, 55.0) if k < 4 else pose(215.0 + k, 150.0, 30.0, 55.0)
        run.see(painted([] if k == 4 else [(BRACKET, where)], surface=SURFACES[surface], seed=k), where)
    run.check(7)


def test_a_mixture_that_shows_one_part_very_well_and_another_not_at_all_is_not_taken() -> None:
    rng = np.random.default_rng(1)
    grain = cv2.GaussianBlur(rng.standard_normal((HEIGHT, WIDTH)), (0, 0), 1.5)
    image = np.clip(150.0 + 12.0 * grain / grain.std(), 0, 255)[..., None].repeat(3, axis=2)
    image[60:180, 80:200], image[60:180, 200:260] = RED, WHITE
    corners = np.array([[79.5, 59.5], [259.5, 59.5], [259.5, 179.5], [79.5, 179.5]])
    sides = zip(corners, np.roll(corners, -1, axis=0), strict=True)
    outline = Contour(np.concatenate([np.linspace(a, b, 150, endpoint=False) for a, b in sides]))
    image = image.astype(np.uint8)
    assert best_color_projection(image, outline) is PLAIN
    image[60:180, 200:260] = RED
    assert best_color_projection(image, outline) is not PLAIN

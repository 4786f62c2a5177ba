# SPDX-License-Identifier: Apache-2.0
"""Wide edges and noise: what the core measures of them in the first view, and what it learns of focus later."""

import math

import numpy as np
import pytest

from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography, similarity_transform
from grasptrack.segmentation.outline_detector import OutlineDetector
from grasptrack.tracking.follower import Follower
from grasptrack.tracking.numbers import NUMBERS
from grasptrack.tracking.selection import make_target
from grasptrack.tracking.target import Target, build_pyramid
from grasptrack_bench.simulation import SHAPES, Conditions, Scene, similarity_path
from grasptrack_bench.simulation.coverage import subdivide_polygon
from scenery import L_PLATE, drawn

CONTACTS = np.array([[-20.0, 25.0], [-70.0, 25.0]])
TURN = 0.3
STEP = 8.0
"""px from image to image."""


def placed(points: np.ndarray, centre: tuple[float, float] = (160.0, 120.0), angle: float = TURN) -> np.ndarray:
    """(n, 2) px of points of the plate, as `drawn` places them."""
    return apply_homography(similarity_transform(1.0, angle, (0.0, 0.0), centre), points)


def outline(centre: tuple[float, float] = (160.0, 120.0)) -> View:
    return View(Contour(subdivide_polygon(placed(L_PLATE, centre), 1.0)))


def target(centre: tuple[float, float] = (160.0, 120.0), **look: float) -> Target:
    image = drawn(L_PLATE, centres=(centre,), angle=TURN, **look)  # type: ignore[arg-type]
    return make_target(build_pyramid(image), outline(centre), placed(CONTACTS, centre), NUMBERS)


@pytest.mark.parametrize("shift", [0.0, 0.25, 0.5, 0.75])
def test_noise_is_that_of_the_pixels_wherever_the_object_lies(shift: float) -> None:
    """It was measured between them, where interpolation takes most of it: noise passed for a surface."""
    made = target((160.0 + shift, 120.0 + shift), noise=8.0)
    assert made.noise == pytest.approx(8.0, rel=0.15) and made.counts == (0, 0, 0)


@pytest.mark.parametrize("noise", [1.5, 6.0])
@pytest.mark.parametrize("blur", [0.8, 2.0, 4.0, 6.0])
def test_edges_are_found_by_a_filter_as_wide_as_they_are(blur: float, noise: float) -> None:
    made = target(blur=blur, noise=noise)
    assert made.edge_width == pytest.approx(math.hypot(blur, 0.5), rel=0.15, abs=0.15)  # the filter ends before it
    assert made.edge_share > 0.97


@pytest.mark.parametrize("blur", [0.8, 2.0, 4.0, 6.0])
def test_the_blur_of_the_outline_is_no_surface(blur: float) -> None:
    """Patches in it drew a pose away from its edges: they look the same wherever they lie on the slope."""
    assert target(blur=blur, noise=0.5).counts == (0, 0, 0)


@pytest.mark.parametrize("last", [3.0, 5.0])
def test_focus_that_goes_and_comes_is_learned(last: float) -> None:
    course = [*np.linspace(0.8, last, 8), last, last, *np.linspace(last, 0.8, 8)]
    follower = Follower(drawn(L_PLATE, noise=3.0), outline(), placed(CONTACTS))
    for k, blur in enumerate(course):
        centre, angle = (160.0 + 1.5 * k, 120.0 + k), TURN + 0.01 * k
        image = drawn(L_PLATE, centres=(centre,), angle=angle, blur=float(blur), noise=3.0, seed=k + 1)
        decision = follower.update(image)
        assert decision.is_accepted, (k, blur, decision.code)
        assert decision.estimate is not None
        assert np.abs(decision.estimate.contacts - placed(CONTACTS, centre, angle)).max() < 1.0
        if 8 <= k < 10:
            assert follower.state.edge_width == pytest.approx(last, rel=0.25)
    assert follower.state.edge_width < 1.5


@pytest.mark.sampled(1)
@pytest.mark.parametrize("exposure", [0.0, 0.3, 0.6, 1.0])
def test_how_long_the_shutter_is_open_is_learnt_from_what_moves(exposure: float) -> None:
    """Half of the blur over the way from image to image: an edge filter is wide for a long exposure alone."""

    def at(x: float) -> tuple[float, float]:
        return (100.0 + x, 120.0)

    def exposed(k: int) -> np.ndarray:
        offsets = exposure * np.linspace(-0.5, 0.5, 13)
        images = [drawn(L_PLATE, centres=(at(STEP * (k + s)),), angle=TURN, noise=0.0).astype(float) for s in offsets]
        noise = np.random.default_rng(k).normal(0.0, 1.0, images[0].shape)
        return np.clip(np.rint(np.mean(images, axis=0) + noise), 0.0, 255.0).astype(np.uint8)

    first = drawn(L_PLATE, centres=(at(0.0),), angle=TURN, noise=1.0)
    followed = Follower(first, outline(at(0.0)), placed(CONTACTS, at(0.0)))
    told = [followed.update(exposed(k)) for k in range(1, 16)]
    assert [d.is_accepted for d in told] == [True] * len(told)
    assert followed.state.blur_share == pytest.approx(0.5 * exposure, abs=0.08)


def test_levels_are_those_of_an_outline_of_the_image_at_hand() -> None:
    """Outlines are known by their ids, and Python gives the id of one that is gone to another."""
    scene = Scene(SHAPES["bracket"](), similarity_path(3, seed=1), conditions=Conditions(noise=1.0), seed=1)
    observer = OutlineDetector()
    observer.set_image(scene[0].image)
    candidate = observer.find_objects(FirstImage())[0]
    observer.choose_object(candidate)
    lighter = np.clip(scene[1].image.astype(int) + 20, 0, 255).astype(np.uint8)
    (view, *_) = next(observer.views_anywhere(observer.set_image(lighter), candidate.view.outer.area, 0))
    before = observer._inside, observer._outside
    observer.set_image(scene[2].image)
    observer.learn_levels(view)
    assert (observer._inside, observer._outside) == before
    (view, *_) = next(observer.views_anywhere(observer.set_image(lighter), candidate.view.outer.area, 0))
    observer.learn_levels(view)
    assert observer._inside > before[0] + 2.0 and observer._outside > before[1] + 2.0

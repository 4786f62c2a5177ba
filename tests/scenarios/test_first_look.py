# SPDX-License-Identifier: Apache-2.0
"""The first look: objects of several colours, or as bright as their ground, outlines that a glare interrupts."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack import GraspTracker
from grasptrack.errors import InputError, ObservationError
from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import Contour
from grasptrack.geometry.homographies import apply_homography
from grasptrack.images import PLAIN, Channel, to_grey
from grasptrack.segmentation.candidate import best_color_projection
from grasptrack.segmentation.closed_edges import (
    ClosedEdgeSegmenter,
    NormalizedGradient,
    enclosed_silhouettes,
    lab_planes,
    link_edges,
)
from grasptrack.segmentation.first_look import find_candidates, find_objects
from grasptrack.segmentation.proposals import SilhouetteScorer
from grasptrack.segmentation.silhouettes import trace_silhouettes
from grasptrack_bench.simulation import SHAPES
from outlines import dense, segment_object
from stages import HEIGHT, WIDTH, Run, photo, pose
from test_segmentation import distances

BRACKET, GASKET, PLATE = (SHAPES[n]() for n in ("bracket", "gasket", "notched-plate"))
GROUND = (128, 128, 128)
SAME_GREY = (60, 128, 154)
"""BGR with the lightness of GROUND, near enough."""


def coverage(polygons: list[np.ndarray]) -> np.ndarray:
    """(H, W) share of each pixel within the first polygon and none of the others."""
    big = np.zeros((8 * HEIGHT, 8 * WIDTH), np.uint8)
    for i, polygon in enumerate(polygons):
        at = np.rint(((polygon + 0.5) * 8 - 0.5) * 256).astype(np.int32)
        cv2.fillPoly(big, [at], (0 if i else 255,), cv2.LINE_8, 8)
    return cv2.resize(big, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(np.float64) / 255.0


def painted(shape, H, colours, noise=1.5, ground=GROUND, seed=0):  # type: ignore[no-untyped-def]
    """BGR image of a part whose left and right halves have different colours."""
    cover = coverage([apply_homography(H, p) for p in shape.polygons])[:, :, None]
    left = (np.arange(WIDTH) < apply_homography(H, np.zeros((1, 2)))[0, 0])[None, :, None]
    surface = np.where(left, np.array(colours[0], float), np.array(colours[1], float))
    image = cover * surface + (1 - cover) * np.array(ground, float)
    image = cv2.GaussianBlur(image, (0, 0), 0.8) + noise * np.random.default_rng(seed).standard_normal(image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


def off(view, shape, H):  # type: ignore[no-untyped-def]
    """px, rms of the outer contour from the truth."""
    return float(np.sqrt(np.mean(distances(view.outer.points, apply_homography(H, shape.outer)) ** 2)))


@pytest.mark.parametrize("shape", [BRACKET, GASKET, PLATE], ids=lambda s: s.name)
def test_an_object_darker_and_lighter_than_its_ground(shape) -> None:  # type: ignore[no-untyped-def]
    H = pose(158.0, 121.0, 24.0, scale=110.0)
    image = painted(shape, H, [(40, 40, 40), (215, 215, 215)])
    found = find_objects(image)
    assert found[0].polarity == 0
    assert found[0].recipe >= 0
    assert off(found[0].view, shape, H) < 0.35
    assert len(found) == 1
    assert len(found[0].view.contours) == len(shape.polygons)


def test_an_object_of_its_grounds_grey_is_seen_by_its_colour() -> None:
    H = pose(158.0, 121.0, 24.0)
    image = painted(BRACKET, H, [SAME_GREY, SAME_GREY])
    assert abs(float(to_grey(image)[120, 150]) - float(to_grey(image)[5, 5])) < 8.0
    best = find_candidates(image)[0]
    assert best.channel.weights is not None
    assert best.polarity != 0
    assert off(best.view, BRACKET, H) < 0.25


def test_the_mixture_of_colours_keeps_the_image_in_range() -> None:
    image = np.random.default_rng(1).integers(0, 256, (40, 50, 3), dtype=np.uint8)
    for weights in ((0.5, -0.2, 0.3), (-0.6, 0.4, 0.0), (0.1, 0.6, 0.3)):
        mixed = Channel(weights).to_grey(image).astype(float)
        plain = image.astype(float) @ np.array(weights) - 255.0 * sum(min(w, 0.0) for w in weights)
        assert np.abs(mixed - plain).max() <= 0.51
    assert np.array_equal(PLAIN.to_grey(image), to_grey(image))
    assert (
        best_color_projection(image[:, :, 0], Contour(np.array([[10, 10], [30, 10], [30, 30], [10, 30]] * 2, float)))
        is PLAIN
    )


def test_a_glare_that_hides_part_of_the_outline_is_bridged() -> None:
    H = pose(160.0, 120.0, 10.0, scale=110.0)
    image = painted(PLATE, H, [(60, 60, 60), (60, 60, 60)], ground=(200, 200, 200))
    side = apply_homography(H, PLATE.outer)
    middle = side[np.argmax(side[:, 0])]
    rows, columns = np.mgrid[:HEIGHT, :WIDTH]
    glare = 200.0 * np.exp(-(((columns - middle[0]) / 25.0) ** 2 + ((rows - middle[1]) / 12.0) ** 2))
    lit = np.clip(image + np.minimum(glare, 140.0)[:, :, None], 0, 200).astype(np.uint8)
    best = find_candidates(lit)[0]
    truth = Contour(dense(apply_homography(H, PLATE.outer))).area
    assert 0.9 < best.view.outer.area / truth < 1.1


@given(st.floats(0.4, 1.6), st.integers(0, 1000))
def test_grain_is_the_unit_of_strength(gain: float, seed: int) -> None:
    """Twice the noise makes edges half as strong: what counts is how far they stand out."""
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((120, 160)) * 6.0
    field = NormalizedGradient(lab_planes(np.clip(128 + gain * noise, 0, 255).astype(np.uint8)), 1.0)
    assert np.median(field.gradient_magnitude) < 1.0
    assert field.thin_edges(6.0).sum() == 0
    shown = np.clip(128 + gain * noise, 0, 255)
    shown[:, 80:] += 90.0
    edges = NormalizedGradient(lab_planes(np.clip(shown, 0, 255).astype(np.uint8)), 1.0).thin_edges(4.0)
    assert ((edges[10:-10] > 0).sum(axis=1) >= 1).mean() > 0.9
    assert np.abs(np.nonzero(edges[10:-10])[1] - 79.5).max() <= 4


def test_a_grey_image_has_the_edges_of_its_coloured_copy() -> None:
    grey = photo([(BRACKET, pose())])
    np.testing.assert_array_equal(
        lab_planes(grey)[:, :, 0], lab_planes(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR))[:, :, 0]
    )


def test_broken_edges_enclose_once_they_are_linked() -> None:
    edges = np.zeros((200, 300), np.uint8)
    cv2.rectangle(edges, (60, 50), (240, 150), (255,), 1)
    edges[50, 120:150] = edges[150, 140:175] = 0
    assert (
        enclosed_silhouettes(edges.copy(), 1, 100.0, 20.0) == []
        or enclosed_silhouettes(edges.copy(), 1, 100.0, 20.0)[0].area < 5000
    )
    (shape,) = enclosed_silhouettes(link_edges(edges, 60.0), 1, 100.0, 20.0)
    assert shape.area == pytest.approx(180 * 100, rel=0.03)


def test_terms_of_a_rating_tell_what_is_wrong() -> None:
    image = painted(PLATE, pose(), [(50, 50, 50), (50, 50, 50)])
    scenery = ClosedEdgeSegmenter(lab_planes(image))
    rater = SilhouetteScorer(scenery.fields[0], 1, (HEIGHT, WIDTH))
    (shape,) = trace_silhouettes(np.where(to_grey(image) < 90, np.uint8(255), np.uint8(0)), 100.0, holes=False)
    good = rater.rate_silhouette(shape)
    assert all(0.0 <= term <= 1.0 for term in good)
    assert good.closed > 0.99 and good.complete == 1.0 and good.exact == 1.0
    assert good.score == pytest.approx(float(np.prod(good)))
    astray = shape._replace(outer=shape.outer + np.array([14, 9], np.int32))
    assert rater.rate_silhouette(astray).closed < 0.4
    assert rater.rate_silhouette(shape, bridge=16.0).exact == pytest.approx(0.8)
    border = shape._replace(outer=shape.outer - shape.outer.min(axis=0))
    assert rater.rate_silhouette(border).complete < 0.3


def test_several_objects_each_once_and_the_meant_one_first() -> None:
    places = [(70.0, 70.0), (245.0, 65.0), (80.0, 180.0), (240.0, 175.0)]
    image = photo([(BRACKET, pose(x, y, 20.0 * i, scale=48.0)) for i, (x, y) in enumerate(places)])
    found = find_objects(image)
    assert len(found) == 4
    assert [c.probability for c in found] == sorted((c.probability for c in found), reverse=True)
    for x, y in places:
        first = find_objects(image, FirstImage.of((x - 8.0, y)))
        assert np.abs(first[0].view.outer.points.mean(axis=0) - (x, y)).max() < 20.0
        assert len(first) == 4
        boxed = find_objects(image, FirstImage(box=(x - 45.0, y - 45.0, 90.0, 90.0)))
        assert np.abs(boxed[0].view.outer.points.mean(axis=0) - (x, y)).max() < 20.0
    with pytest.raises(ObservationError, match="in the box"):
        segment_object(image, box=(140.0, 100.0, 30.0, 30.0))


def test_print_is_no_hole_and_a_hole_is_none_of_print() -> None:
    H = pose(160.0, 120.0, 0.0, scale=110.0)
    image = painted(PLATE, H, [(40, 40, 40), (215, 215, 215)])
    x, y = np.rint(apply_homography(H, np.zeros((1, 2)))[0]).astype(int).tolist()
    for colour, holes in (((30, 30, 200), 0), (GROUND, 1)):
        shown = image.copy()
        cv2.circle(shown, (x + 30, y + 10), 12, colour, cv2.FILLED, cv2.LINE_AA)
        shown = cv2.GaussianBlur(shown, (0, 0), 0.7)
        assert len(segment_object(shown).contours) == 1 + holes, colour


class ByColour:
    """A user's own segmentation."""

    def segment(self, image: np.ndarray) -> np.ndarray:
        return np.abs(image.astype(int) - GROUND).max(axis=2) > 25


def test_your_own_segmentation_by_one_method() -> None:
    frames = [painted(BRACKET, pose(150.0 + 3 * k, 120.0, 2.0 * k), [SAME_GREY, (40, 40, 40)]) for k in range(4)]
    asked, told = GraspTracker(segmenter=ByColour()), GraspTracker()
    for frame in frames:
        a, b = asked.update(frame), told.update(frame, mask=ByColour().segment(frame))
        assert a.status == b.status == "tracked"
        np.testing.assert_array_equal(a.contacts, b.contacts)


def test_objects_of_a_mask() -> None:
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    cv2.rectangle(mask, (30, 40), (120, 100), (255,), cv2.FILLED)
    cv2.circle(mask, (230, 150), 40, (255,), cv2.FILLED)
    found = find_objects(np.zeros((HEIGHT, WIDTH, 3), np.uint8), mask=mask)
    assert sorted(c.view.outer.area for c in found) == pytest.approx([np.pi * 40.5**2, 91.0 * 61.0], rel=0.04)


def with_shadow(shape, H, colour, depth, blur, by, seed=0):  # type: ignore[no-untyped-def]
    """BGR image of a part that casts a shadow on a light table."""
    cover = coverage([apply_homography(H, p) for p in shape.polygons])[:, :, None]
    cast = coverage([apply_homography(H, p) + by for p in shape.polygons])
    ground = np.array([190.0, 195.0, 200.0]) * (1 - (1 - depth) * cv2.GaussianBlur(cast, (0, 0), blur))[:, :, None]
    image = cv2.GaussianBlur(cover * np.array(colour, float) + (1 - cover) * ground, (0, 0), 0.8)
    image += 2.0 * np.random.default_rng(seed).standard_normal(image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


@pytest.mark.sampled(3)
@pytest.mark.parametrize("colour", [(235, 235, 235), (40, 60, 160), (150, 140, 60)], ids=["white", "red", "teal"])
@pytest.mark.parametrize(("depth", "blur"), [(0.45, 1.5), (0.65, 1.5), (0.45, 4.0)])
def test_a_shadow_is_no_part_of_its_object(colour, depth: float, blur: float) -> None:  # type: ignore[no-untyped-def]
    H = pose(158.0, 121.0, 24.0, scale=80.0)
    for shape in (BRACKET, GASKET):
        view = segment_object(with_shadow(shape, H, colour, depth, blur, (8.0, 6.0)))
        assert view.outer.area == pytest.approx(Contour(dense(apply_homography(H, shape.outer))).area, rel=0.06)


def test_no_part_of_a_two_coloured_object_is_taken_for_a_shadow() -> None:
    for colours in ([(40, 40, 40), (80, 80, 80)], [(90, 90, 90), (215, 215, 215)], [(40, 40, 40), (215, 215, 215)]):
        for shape in (BRACKET, GASKET, PLATE):
            H = pose(158.0, 121.0, 24.0, scale=100.0)
            area = Contour(dense(apply_homography(H, shape.outer))).area
            assert segment_object(painted(shape, H, colours)).outer.area == pytest.approx(area, rel=0.05)


def test_an_object_with_a_shadow_is_followed_without_it() -> None:
    run = Run()
    for k in range(8):
        H = pose(150.0 + 3 * k, 118.0, 2.0 * k, scale=80.0 + 0.5 * k)
        run.see(with_shadow(BRACKET, H, (150, 140, 60), 0.45, 1.5, (8.0, 6.0), seed=k), H)
    run.check(6)


def test_a_box_says_which_object_is_followed() -> None:
    frames = [
        photo([(BRACKET, pose(75.0 + k, 120.0, scale=48.0)), (BRACKET, pose(240.0 + k, 120.0, 30.0, scale=48.0))])
        for k in range(3)
    ]
    tracker = GraspTracker(box=(190.0, 70.0, 100.0, 100.0))
    for k, frame in enumerate(frames):
        result = tracker.update(frame)
        assert result.status == "tracked"
        assert abs(result.contacts[:, 0].mean() - 240.0 - k) < 30.0
    with pytest.raises(InputError, match="give one of them"):
        GraspTracker(box=(0.0, 0.0, 9.0, 9.0), object_at=(3.0, 3.0))


def test_a_slit_makes_no_outline_better() -> None:
    """A threshold within an object's own greys may cut into it; the longer outline must not win by its length."""
    image = np.full((HEIGHT, WIDTH), 45, np.uint8)
    cv2.circle(image, (160, 120), 60, (200,), cv2.FILLED)
    cv2.rectangle(image, (130, 118), (219, 121), (175,), cv2.FILLED)
    image = cv2.GaussianBlur(image, (0, 0), 1.0)
    rater = SilhouetteScorer(ClosedEdgeSegmenter(lab_planes(image)).fields[0], 1, (HEIGHT, WIDTH))
    (whole,) = trace_silhouettes(np.where(image > 120, np.uint8(255), np.uint8(0)), 100.0, holes=False)
    (slit,) = trace_silhouettes(np.where(image > 180, np.uint8(255), np.uint8(0)), 100.0, holes=False)
    assert len(slit.outer) > 1.3 * len(whole.outer)
    assert rater.rate_silhouette(slit).score < rater.rate_silhouette(whole).score
    assert segment_object(image).outer.area == pytest.approx(np.pi * 60.5**2, rel=0.02)

# SPDX-License-Identifier: Apache-2.0
"""The peers follow what is easy, lose what is not there, crash on nothing, and are what their libraries make of them."""

import sys
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from grasptrack import GraspTracker
from grasptrack.geometry.contours import Contour
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.force_closure import analyze
from grasptrack.images import to_grey
from grasptrack.kernels import resample
from grasptrack.tracking.result import TrackResult
from grasptrack.typing import Floats
from grasptrack_bench.baselines import PEERS, available_baselines, missing_baselines
from grasptrack_bench.baselines.base import region_of
from grasptrack_bench.baselines.direct import MARGIN, homography_of, template_triangles, why_not
from grasptrack_bench.method import Method, MethodStart
from grasptrack_bench.metrics.errors import contact_distances
from grasptrack_bench.simulation import SHAPES, Conditions, Pinhole, Scene, SceneFrame, similarity_path

SIZE = (400, 300)
BOUNDS = {
    "ecc": 0.1, "klt": 1.5, "sift": 6.0, "otsu": 0.6, "visp": 0.1, "paper-rrp": 2.5, "paper-grasp-line": 2.0,
    "paper-homography": 6.0,
}  # fmt: skip
"""px, the largest error on the easy sequence: about twice what was seen."""
HERE = sorted(available_baselines())
FIRST_OF_ALL = ("ecc", "klt", "sift")
"""Those that compare grey levels, and so know an image with nothing in it."""


@lru_cache
def easy(colour: bool = False) -> tuple[SceneFrame, ...]:
    """Eight frames of a bracket that moves by a gentle similarity."""
    path = similarity_path(8, distance=4.2, reach=0.1, zoom=0.05, turn=0.25, seed=2)
    lens = Conditions(blur=0.7, noise=1.5)
    return tuple(Scene(SHAPES["bracket"](), path, camera=Pinhole(*SIZE), conditions=lens, colour=colour, seed=2))


def start(outline: bool = True) -> MethodStart:
    """A grasp on the bracket, and its outline or nothing of it."""
    first = easy()[0]
    return MethodStart(grasp().copy(), first.outline if outline else (), SIZE)


@lru_cache
def grasp() -> NDArray[np.float64]:
    contacts = GraspTracker(strategy="homography").update(easy()[0].image).contacts
    assert contacts is not None
    return contacts


def run(method: Method, images: list[NDArray[np.uint8]]) -> list[TrackResult]:
    return [method.update(image, i / 30.0) for i, image in enumerate(images)]


def images(colour: bool = False) -> list[NDArray[np.uint8]]:
    return [frame.image for frame in easy(colour)]


def check(result: TrackResult, index: int) -> None:
    """What every method owes."""
    assert isinstance(result, TrackResult) and result.frame == index
    assert result.status in ("tracked", "lost")
    assert bool(result.reason) == (result.status == "lost") == (result.contacts is None)
    if result.contacts is not None:
        assert result.contacts.shape == (2, 2) and np.isfinite(result.contacts).all()
        assert np.isnan(result.confidence) or 0.0 <= result.confidence <= 1.0 + 1e-6


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", HERE)
def test_each_follows_an_easy_sequence(name: str) -> None:
    given_ = start()
    for index, (result, frame) in enumerate(zip(run(PEERS[name](given_), images()), easy(), strict=True)):
        check(result, index)
        assert result.contacts is not None, result.reason
        assert contact_distances(result.contacts, frame.carry(given_.contacts)).max() < BOUNDS[name]
        assert result.strategy == name


@pytest.mark.parametrize("name", HERE)
def test_the_first_image_is_where_the_grasp_is(name: str) -> None:
    first = PEERS[name](start()).update(images()[0], None)
    np.testing.assert_array_equal(first.contacts, start().contacts)
    np.testing.assert_array_equal(first.homography, np.eye(3))


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", HERE)
def test_without_an_outline_and_in_colour_it_follows_as_well(name: str) -> None:
    given_ = start(outline=False)
    last = run(PEERS[name](given_), images(colour=True))[-1]
    assert last.contacts is not None, last.reason
    assert contact_distances(last.contacts, easy()[-1].carry(given_.contacts)).max() < 2.0 * BOUNDS[name]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", HERE)
def test_the_digits_do_not_depend_on_what_else_runs(name: str) -> None:
    alone = run(PEERS[name](start()), images())
    mixed = PEERS[name](start())
    other = PEERS["sift" if name != "sift" else "klt"](start())
    for one, image in zip(alone, images(), strict=True):
        np.random.default_rng().normal()
        cv2.setRNGSeed(7)
        other.update(image[::-1].copy(), None)
        again = mixed.update(image, one.time)
        np.testing.assert_array_equal(again.contacts, one.contacts)
        np.testing.assert_array_equal(again.confidence, one.confidence)


@pytest.mark.parametrize("name", sorted(PEERS))
@pytest.mark.parametrize("level", [0, 128, 255])
def test_nothing_begins_on_a_blank_image(name: str, level: int) -> None:
    blank = np.full((SIZE[1], SIZE[0]), level, np.uint8)
    results = run(PEERS[name](MethodStart(start().contacts, (), SIZE)), [blank, images()[0]])
    for index, result in enumerate(results):
        check(result, index)
    if name in (*FIRST_OF_ALL, "visp") or name.startswith("paper-"):
        assert [r.status for r in results] == ["lost", "lost"]


@pytest.mark.parametrize("name", [n for n in HERE if n != "visp"])
def test_the_part_is_lost_when_nothing_is_left_to_see(name: str) -> None:
    peer, seen = PEERS[name](start()), images()
    blank = np.full_like(seen[0], 128)
    results = run(peer, [*seen[:3], blank, blank])
    assert [r.status for r in results[:3]] == ["tracked"] * 3
    assert [r.status for r in results[3:]] == ["lost"] * 2


@pytest.mark.parametrize("name", [*FIRST_OF_ALL, "paper-homography"])
def test_it_is_found_again_after_a_blank_image(name: str) -> None:
    seen = images()
    last = run(PEERS[name](start()), [*seen[:3], np.full_like(seen[0], 128), seen[3]])[-1]
    assert last.contacts is not None, last.reason
    assert contact_distances(last.contacts, easy()[3].carry(start().contacts)).max() < 2.0 * BOUNDS[name]


@pytest.mark.sampled(2)
@settings(max_examples=5)
@given(seed=st.integers(0, 2**31), kind=st.sampled_from(["noise", "blocks", "smaller", "colour", "tiny"]))
@pytest.mark.parametrize("name", sorted(PEERS))
def test_no_image_makes_it_crash(name: str, seed: int, kind: str) -> None:
    rng = np.random.default_rng(seed)
    shape = {"smaller": (97, 131), "tiny": (8, 9), "colour": (300, 400, 3)}.get(kind, (300, 400))
    strange = rng.integers(0, 256, shape, dtype=np.uint8)
    if kind == "blocks":
        strange = np.kron(rng.integers(0, 256, (3, 4), dtype=np.uint8), np.ones((100, 100), np.uint8))
    for index, result in enumerate(run(PEERS[name](start()), [images()[0], strange, images()[1]])):
        check(result, index)
    for index, result in enumerate(run(PEERS[name](start()), [strange, strange])):
        check(result, index)


@pytest.mark.parametrize("name", [n for n in HERE if n.startswith("paper-")])
def test_the_papers_methods_refuse_what_does_not_close_in_the_image(name: str) -> None:
    """Fig. 3: the transferred grasp is analysed; two contacts at one corner press past each other."""
    outer = easy()[0].outline[0]
    corner = MethodStart(np.array([outer[0], outer[len(outer) // 5]]), easy()[0].outline, SIZE)
    contour = Contour(resample(np.ascontiguousarray(outer), 300, 0.0))
    assert not analyze(Grasp(corner.contacts), contour).stable
    results = run(PEERS[name](corner), images())
    assert results[0].status == "tracked"
    assert all(r.status == "lost" and "does not close in this image" in r.reason for r in results[1:])


def test_sift_is_that_of_opencv() -> None:
    one, other = to_grey(images()[0]), to_grey(images()[4])
    near = cv2.dilate(
        cv2.fillPoly(np.zeros_like(one), [np.rint(16 * p).astype(np.int32) for p in start().outline], 255, shift=4),
        cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (17, 17)),
    )
    sift = cv2.SIFT.create()
    (k1, d1), (k2, d2) = sift.detectAndCompute(one, near), sift.detectAndCompute(other, None)
    good = [a for a, b in cv2.BFMatcher().knnMatch(d1, d2, k=2) if a.distance < 0.75 * b.distance]
    a = np.float32([k1[m.queryIdx].pt for m in good])
    b = np.float32([k2[m.trainIdx].pt for m in good])
    H, inliers = cv2.findHomography(a, b, cv2.USAC_MAGSAC, 2.0, maxIters=2000, confidence=0.999)
    found = run(PEERS["sift"](start()), [one, other])[1]
    np.testing.assert_array_equal(found.contacts, apply_homography(H, start().contacts))
    assert found.confidence == inliers.mean()


def test_ecc_ends_where_opencv_finds_no_better_warp() -> None:
    one, *_, other = seen = [to_grey(image) for image in images()[:4]]
    found = run(PEERS["ecc"](start()), seen)[-1]
    assert found.homography is not None
    region = region_of(start(), one)
    x, y, w, h = region.box(MARGIN)
    to_box = np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])
    mask = cv2.warpPerspective(region.grown(MARGIN), found.homography, SIZE)
    warp = np.asarray(found.homography @ to_box, np.float32)
    criteria = (cv2.TERM_CRITERIA_COUNT, 100, -1.0)
    template = one[y : y + h, x : x + w].copy()
    best, refined = cv2.findTransformECC(template, other, warp, cv2.MOTION_HOMOGRAPHY, criteria, mask, 5)
    again = apply_homography(refined @ np.linalg.inv(to_box), start().contacts)
    assert np.abs(again - found.contacts).max() < 0.05
    assert abs(found.confidence - best) < 1e-3


def test_otsu_is_at_the_centroid_that_opencv_finds() -> None:
    peer = PEERS["otsu"](start())
    one, other = run(peer, images()[:2])
    assert other.homography is not None and one.homography is not None
    centres = []
    for image in images()[:2]:
        smooth = cv2.GaussianBlur(to_grey(image), (5, 5), 0)
        _, binary = cv2.threshold(smooth, 0, 255, cv2.THRESH_BINARY_INV + cv2.THRESH_OTSU)
        chains, _ = cv2.findContours(binary, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        m = cv2.moments(max(chains, key=cv2.contourArea))
        centres.append([m["m10"] / m["m00"], m["m01"] / m["m00"]])
    np.testing.assert_allclose(apply_homography(other.homography, centres[:1]), centres[1:], atol=1e-9)


def test_what_is_missing_says_why() -> None:
    assert set(available_baselines()) | set(missing_baselines()) == set(PEERS) and not set(available_baselines()) & set(
        missing_baselines()
    )
    for name, reason in missing_baselines().items():
        assert reason in run(PEERS[name](start()), images()[:2])[1].reason


CORE = """
import numpy as np
class ImageGray:
    def __init__(self, np_array):
        assert np_array.dtype == np.uint8 and np_array.ndim == 2
        self.array = np_array.copy()
class ImagePoint:
    def __init__(self, i, j):
        self.i, self.j = float(i), float(j)
class ColVector:
    def __init__(self, np_array):
        assert np_array.ndim == 1
        self.array = np_array.copy()
    def numpy(self):
        return self.array
"""
TT = """
import cv2
import numpy as np
from visp.core import ColVector
LOG = []
class TemplateTrackerWarpHomography:
    pass
class TemplateTrackerZNCCInverseCompositional:
    def __init__(self, warp):
        assert isinstance(warp, TemplateTrackerWarpHomography)
        self.p = np.zeros(8)
    def setSampling(self, i, j): assert i >= 1 and j >= 1
    def setLambda(self, l): assert l > 0
    def setIterationMax(self, n): assert n > 0
    def setPyramidal(self, nlevels, level_to_stop): assert 0 <= level_to_stop < nlevels
    def initFromPoints(self, image, points, delaunay):
        assert not delaunay and len(points) % 3 == 0
        (x0, y0), (x1, y1) = ([f(p.j for p in points), f(p.i for p in points)] for f in (min, max))
        self.box = [int(max(0, v)) for v in (x0, y0, x1, y1)]
        x0, y0, x1, y1 = self.box
        self.template = image.array[y0:y1, x0:x1].copy()
    def getDiverge(self): return self.diverged
    def getp(self): return ColVector(self.p)
    def setp(self, p):
        LOG.append(p.array.copy())
        self.p = p.array.copy()
    def track(self, image):
        self.diverged = image.array.max() == 0
        if image.array.min() == image.array.max():
            if self.diverged:
                self.p = np.full(8, np.nan)
                return
            raise RuntimeError("no more point in the tracked area")
        p = self.p
        H = np.array([[1 + p[0], p[3], p[6]], [p[1], 1 + p[4], p[7]], [p[2], p[5], 1]])
        move = np.array([[1, 0, self.box[0]], [0, 1, self.box[1]], [0, 0, 1.0]])
        _, warp = cv2.findTransformECC(self.template, image.array, np.float32(H @ move), cv2.MOTION_HOMOGRAPHY)
        H = warp @ np.linalg.inv(move)
        H = H / H[2, 2]
        self.p = np.array([H[0, 0] - 1, H[1, 0], H[2, 0], H[0, 1], H[1, 1] - 1, H[2, 1], H[0, 2], H[1, 2]])
"""


@pytest.fixture
def visp(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    folder = tmp_path / "visp"
    folder.mkdir()
    for name, text in (("__init__", ""), ("core", CORE), ("tt", TT)):
        (folder / f"{name}.py").write_text(text)
    for name in [n for n in sys.modules if n.split(".")[0] == "visp"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(tmp_path)
    yield folder
    for name in [n for n in sys.modules if n.split(".")[0] == "visp"]:
        del sys.modules[name]


def test_it_is_available_with_visp_and_follows(visp: Path) -> None:
    assert why_not() == "" and missing_baselines() == {} and "visp" in available_baselines()
    for result, frame in zip(run(PEERS["visp"](start()), images()), easy(), strict=True):
        assert result.contacts is not None, result.reason
        assert contact_distances(result.contacts, frame.carry(start().contacts)).max() < 0.5


@pytest.mark.parametrize(
    ("level", "reason"), [(0, "ViSP's tracker diverged"), (90, "no more point in the tracked area")]
)
def test_after_a_loss_it_goes_on_from_its_last_answer(visp: Path, level: int, reason: str) -> None:
    seen = images()
    results = run(PEERS["visp"](start()), [*seen[:3], np.full_like(seen[0], level), seen[3]])
    assert [r.status for r in results] == ["tracked"] * 3 + ["lost", "tracked"]
    assert results[3].reason == reason
    (again,) = sys.modules["visp.tt"].LOG
    np.testing.assert_allclose(homography_of(again), results[2].homography)


def test_a_build_without_the_template_tracker_is_told(visp: Path) -> None:
    (visp / "tt.py").write_text("")
    assert "without the module tt" in why_not()


def test_a_build_that_does_not_load_is_told(visp: Path) -> None:
    (visp / "tt.py").unlink()
    assert "cannot be loaded" in why_not()


def test_without_visp_every_frame_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("grasptrack_bench.baselines.direct.find_spec", lambda name: None)
    assert "visp" not in available_baselines()
    for result in run(PEERS["visp"](start()), images()[:2]):
        assert result.status == "lost" and "ViSP" in result.reason and "not installed" in result.reason


def cross(a: Floats, b: Floats) -> Floats:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def test_triangles_cover_the_part() -> None:
    corners = template_triangles(region_of(start(), to_grey(images()[0]))).reshape(-1, 3, 2)
    inside = np.zeros(len(start().outline[0]), bool)
    for a, b, c in corners:
        sides = [cross(q - p, start().outline[0] - p) for p, q in ((a, b), (b, c), (c, a))]
        inside |= np.all([s >= 0 for s in sides], axis=0) | np.all([s <= 0 for s in sides], axis=0)
    assert inside.all()

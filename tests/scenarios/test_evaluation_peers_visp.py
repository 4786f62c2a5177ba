# SPDX-License-Identifier: Apache-2.0
"""The adapter of ViSP's template tracker, against a module with the names, orders and errors that ViSP documents.

Where ViSP itself is installed, `test_evaluation_peers.py` runs it.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from grasptrack.images import to_grey
from grasptrack.typing import Floats
from grasptrack_bench.baselines import PEERS, available_baselines, missing_baselines
from grasptrack_bench.baselines.base import region_of
from grasptrack_bench.baselines.direct import homography_of, template_triangles, why_not
from grasptrack_bench.metrics.errors import contact_distances
from test_evaluation_peers import easy, images, run, start

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

# SPDX-License-Identifier: Apache-2.0
"""What a person or a net says of the first image, and what becomes of it."""

import hashlib
import http.server
import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import grasptrack as gt
from grasptrack.cli.main import main
from grasptrack.errors import InputError, ObservationError
from grasptrack.first_image import FirstImage
from grasptrack.nets import models
from grasptrack.nets.salient import SalientNet
from grasptrack.segmentation.candidate import distinct_candidates
from grasptrack.segmentation.choice import Signs, choice_probabilities, load_numbers
from grasptrack.segmentation.segmenters import Region
from tiny_onnx import register_models, write_brightness_net

PLATE = np.array([[200, 150], [450, 170], [440, 240], [310, 250], [290, 340], [190, 320]])


def bench(*shapes: np.ndarray, level: int = 40) -> np.ndarray:
    image = np.full((480, 640), 210, np.uint8)
    for shape in shapes:
        cv2.fillPoly(image, [shape], (level,), cv2.LINE_AA)
    return cv2.GaussianBlur(image, (0, 0), 0.8)


def area_of(points: np.ndarray) -> float:
    return float(cv2.contourArea(points.astype(np.float32)))


def square(x: int, y: int, half: int) -> np.ndarray:
    return np.array([[x - half, y - half], [x + half, y - half], [x + half, y + half], [x - half, y + half]])


# --- pixels, boxes, outlines ---------------------------------------------------------------------


def test_pixels_on_and_beside_the_object_choose_it() -> None:
    left, right = square(160, 240, 60), square(470, 240, 60)
    image = bench(left, right)
    for at, other in (((160, 240), (470, 240)), ((470, 240), (160, 240))):
        for told in ({"object_at": at}, {"not_at": other}, {"object_at": [at, (at[0] + 40, at[1] - 40)]}):
            first = gt.first_look(image, **told)[0]
            assert np.abs(first.view.outer.points.mean(axis=0) - at).max() < 2.0, told
    with pytest.raises(ObservationError, match="160,240 and 470,240"):
        gt.first_look(image, [(160, 240), (470, 240)])


@pytest.mark.parametrize("off", [0.0, 3.0, 6.0])
def test_a_rough_outline_is_moved_onto_the_edges(off: float) -> None:
    image, angle = bench(PLATE), 1.1
    polygon = PLATE + off * np.array([np.cos(angle), np.sin(angle)])
    (found,) = gt.first_look(image, outline=polygon)
    assert found.sure
    assert found.view.outer.area == pytest.approx(area_of(PLATE), rel=0.03)


def test_print_at_the_border_takes_no_bite_out_of_an_outline_that_was_drawn() -> None:
    """What is like the table beside it, 18 px deep, is a notch to who has no word of a person's."""
    plate, label = square(320, 240, 110), np.array([[210, 210], [228, 210], [228, 218], [210, 218]])
    image = cv2.fillPoly(bench(plate), [label], (190,))
    (found,) = gt.first_look(cv2.GaussianBlur(image, (0, 0), 0.8), outline=plate)
    away = [abs(cv2.pointPolygonTest(plate, at, True)) for at in found.view.outer.points.tolist()]
    assert max(away) < 3.0


def test_a_rough_outline_is_kept_where_there_is_no_edge() -> None:
    """Two thirds of it lie on nothing: drawn is drawn."""
    rng = np.random.default_rng(2)
    image = np.clip(rng.normal(120.0, 3.0, (480, 640)), 0, 255).astype(np.uint8)
    polygon = square(320, 240, 90)
    (found,) = gt.first_look(image, outline=polygon)
    assert found.view.outer.area == pytest.approx(area_of(polygon), rel=0.12)


def test_an_outline_longer_than_any_object_has_is_taken() -> None:
    """A scribble of a finger over the whole image: 40,000 px of edges to look for."""
    scribble = np.random.default_rng(3).uniform((100, 60), (540, 420), (2000, 2))
    (found,) = gt.first_look(bench(PLATE), outline=scribble)
    assert found.view.outer.area > 0.5 * 440 * 360


def test_the_tracker_takes_a_drawn_object_and_follows_it() -> None:
    tracker = gt.GraspTracker(outline=PLATE + 4)
    statuses = [tracker.update(bench(PLATE + 3 * i)).status for i in range(4)]
    assert statuses == ["tracked"] * 4
    assert len(tracker.candidates) == 1


@pytest.mark.parametrize(
    ("told", "said"),
    [
        ({"object_at": (900, 3)}, "outside the image"),
        ({"object_at": "here"}, "object_at must be an array of numbers"),
        ({"object_at": (np.nan, 3)}, "in px"),
        ({"not_at": (3, -9)}, "not_at"),
        ({"box": (1, 2, 0, 5)}, "above 0"),
        ({"box": (700, 2, 20, 5)}, "outside the image"),
        ({"box": (1, 2, 3)}, "left, top, width"),
        ({"outline": [(1, 2), (3, 4)]}, "three corners"),
        ({"outline": [(1, 2), (3, 4), (5, 6)]}, "no area"),
        ({"outline": square(900, 900, 40)}, "outside the image"),
        ({"sure": 1.5}, "0 or more and below 1"),
        ({"segmenter": "u2nep"}, "choose from"),
        ({"segmenter": "onnx:nowhere.onnx"}, "no model file"),
        ({"segmenter": 7}, "segmenter has"),
    ],
)
def test_a_hint_that_is_none_is_told(told: dict[str, object], said: str) -> None:
    with pytest.raises(InputError, match=said) as caught:
        gt.first_look(bench(PLATE), **told)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)


# --- candidates and their probabilities ----------------------------------------------------------


def test_nested_regions_stay_and_probabilities_fall() -> None:
    image = bench(square(320, 240, 150), level=235)
    cv2.fillPoly(image, [square(320, 240, 70)], (90,), cv2.LINE_AA)
    found = gt.first_look(image)
    told = [c.probability for c in found]
    assert told == sorted(told, reverse=True) and 0.0 < sum(told) <= 1.0
    areas = sorted(c.view.outer.area for c in distinct_candidates(found))
    assert any(a == pytest.approx(140.0**2, rel=0.05) for a in areas)
    assert any(a == pytest.approx(300.0**2, rel=0.05) for a in areas)
    inner = gt.first_look(image, (320, 240), not_at=(200, 240))[0]
    assert inner.view.outer.area == pytest.approx(140.0**2, rel=0.05)


@given(
    st.lists(st.floats(-12.0, 0.0), min_size=1, max_size=30),
    st.floats(0.0, 20.0),
    st.floats(0.0, 1.0),
    st.tuples(*[st.floats(0.1, 0.9)] * 6),
    st.booleans(),
    st.booleans(),
)
def test_probabilities_are_such(
    worth: list[float], lead: float, rating: float, shares: tuple[float, ...], mapped: bool, at_contacts: bool
) -> None:
    falling, (returned, thin, neck, cut, toned, around) = np.array(sorted(worth, reverse=True)), shares
    signs, numbers = Signs(rating, lead, returned, thin, neck, cut, toned, around), load_numbers(mapped, at_contacts)
    told = choice_probabilities(falling, signs, numbers)
    assert (told >= 0.0).all() and told.sum() <= 1.0 + 1e-9
    assert (np.diff(told) <= 1e-12).all()
    for better in (
        {"lead": lead + 1.0},
        {"returned": returned + 0.1},
        {"thin": thin - 0.1},
        {"neck": neck + 0.1},
        {"cut": cut - 0.1},
        {"toned": toned - 0.1},
        {"around": around - 0.1},
    ):
        assert choice_probabilities(falling, signs._replace(**better), numbers)[0] >= told[0]


def test_candidates_are_shown_and_one_is_taken(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    photo = tmp_path / "two.png"
    cv2.imwrite(str(photo), bench(square(160, 240, 60), square(470, 240, 58)))
    out = tmp_path / "out"
    words = ["track", str(photo), "--no-video", "--output", str(out)]
    assert main([*words, "--sure", "0.999"]) == 0
    assert "--choose N" in capsys.readouterr().out.replace("\n", " ")
    assert cv2.imread(str(out / "candidates.png")).shape == (480, 640, 3)
    places = []
    for number in ("1", "2"):
        assert main([*words, "--quiet", "--choose", number]) == 0
        row = (out / "grasps.csv").read_text().splitlines()[1].split(",")
        places.append(float(row[5]) > 315)
    assert places[0] != places[1]
    assert not (out / "candidates.png").exists()  # a person has chosen
    assert main([*words, "--choose", "3", "--outline", "100,180 220,180 220,300 100,300"]) == 2
    assert "candidate" in capsys.readouterr().err


# --- segmenters ----------------------------------------------------------------------------------


class Map:
    """Proposes what it was given, softly."""

    def __init__(self, mask: np.ndarray) -> None:
        self.mask, self.hints = mask, list[FirstImage]()

    def regions(self, image: np.ndarray, hints: FirstImage) -> list[Region]:
        self.hints.append(hints)
        return [Region(cv2.GaussianBlur(self.mask.astype(np.float32), (0, 0), 6.0))]


def test_a_segmenters_map_decides_between_equals_and_its_outline_is_made_exact() -> None:
    left, right = square(160, 240, 60), square(470, 240, 60)
    image = bench(left, right)
    for shape, x in ((left, 160.0), (right, 470.0)):
        mask = np.zeros(image.shape, np.uint8)
        cv2.fillPoly(mask, [shape + 2], (1,))
        segmenter = Map(mask)
        first = gt.first_look(image, segmenter=segmenter)[0]
        assert np.abs(first.view.outer.points.mean(axis=0) - (x, 240.0)).max() < 0.3
        assert first.view.outer.area == pytest.approx(121.0**2, rel=0.01)  # both border pixels are painted
        assert segmenter.hints == [FirstImage()]


def test_a_function_is_the_only_candidate() -> None:
    image = bench(square(160, 240, 60), square(470, 240, 60))
    found = gt.first_look(image, segmenter=lambda seen: (seen < 100) & (np.arange(640) > 320))
    assert len(found) == 1 and found[0].probability == 1.0
    assert np.abs(found[0].view.outer.points.mean(axis=0) - (470.0, 240.0)).max() < 1.0
    with pytest.raises(InputError, match="mask"):
        gt.first_look(image, segmenter=lambda seen: seen[:100] < 100)


def test_a_net_runs_through_opencv_and_a_bad_file_is_told(tmp_path: Path) -> None:
    net, bad = tmp_path / "bright.onnx", tmp_path / "bad.onnx"
    write_brightness_net(net, 64)
    bad.write_bytes(b"no model at all" * 40)
    image = np.full((480, 640), 30, np.uint8)
    cv2.fillPoly(image, [PLATE], (220,), cv2.LINE_AA)
    made = SalientNet(net, 64)
    shown = made.saliency_map(image)
    assert shown.shape == image.shape and shown[260, 250] > 0.8 > 0.3 > shown[20, 20]
    first = gt.first_look(image, segmenter=made)[0]
    assert first.view.outer.area == pytest.approx(area_of(PLATE), rel=0.03)
    with pytest.raises(InputError, match="cannot be read as an ONNX model"):
        gt.first_look(image, segmenter=f"onnx:{bad}")


# --- models --------------------------------------------------------------------------------------


class Silent(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: object) -> None:
        pass


@pytest.fixture
def served(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A folder served on this machine, from which the model "tiny" comes."""
    folder = tmp_path / "served"
    folder.mkdir()
    write_brightness_net(folder / "tiny.onnx", 64)
    right = hashlib.sha256((folder / "tiny.onnx").read_bytes()).hexdigest()
    handler = partial(Silent, directory=str(folder))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        url = f"http://127.0.0.1:{server.server_port}/"
        made = [
            models.NetModel(
                name, "brightness", "Apache-2.0", (models.ModelFile(0.001, url + file, f"sha256:{hashed}"),), 64
            )
            for name, file, hashed in (
                ("tiny", "tiny.onnx", right),
                ("other", "tiny.onnx", 64 * "0"),
                ("gone", "gone.onnx", right),
            )
        ]
        register_models(monkeypatch, made)
        monkeypatch.setenv("GRASPTRACK_MODELS", str(tmp_path / "models"))
        yield url
        server.shutdown()


def test_a_model_is_fetched_when_asked_and_only_the_right_one_is_kept(
    served: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(InputError, match="grasptrack models get tiny"):
        gt.first_look(bench(PLATE), segmenter="tiny")
    assert main(["models"]) == 0
    assert "no    sha256" in capsys.readouterr().out
    assert main(["models", "get", "tiny"]) == 0
    assert f"{served}tiny.onnx" in capsys.readouterr().out
    assert gt.first_look(bench(PLATE), segmenter="tiny")
    for name, said in (("other", "not model"), ("gone", "cannot be fetched"), ("none", "unknown model")):
        assert main(["models", "get", name]) == 2
        told = capsys.readouterr().err
        assert said in told and len(told.strip().splitlines()) == 1
    assert sorted(p.name for p in (tmp_path / "models").iterdir()) == ["tiny.onnx"]

# SPDX-License-Identifier: Apache-2.0
"""Nets that are asked by clicks, by stand-ins of a few nodes with the names and shapes of public exports."""

import hashlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

import grasptrack as gt
from grasptrack.cli.main import main
from grasptrack.errors import InputError
from grasptrack.first_image import FirstImage
from grasptrack.nets import models
from grasptrack.nets.promptable import PromptableNet
from grasptrack.segmentation.candidate_search import CandidateSearch
from grasptrack.segmentation.choice import load_numbers, measure_worth
from grasptrack.segmentation.segmenters import Region
from tiny_onnx import SCORES, register_models, write_decoder, write_encoder, write_pair

pytest.importorskip("onnxruntime", reason="the extra `segment` is not installed")

FORMS = ("sam", "fixed", "edge", "sam2")
RED, PINK, GREEN, TABLE = (60, 60, 180), (75, 75, 195), (60, 150, 60), (200, 205, 210)
LEFT, RIGHT = (100, 120, 130, 200), (330, 150, 90, 140)


def painted(height: int, width: int, *boxes: tuple[tuple[int, int, int, int], tuple[int, int, int]]) -> Any:
    image = np.full((height, width, 3), TABLE, np.uint8)
    for (x, y, w, h), colour in boxes:
        image[y : y + h, x : x + w] = colour
    return cv2.GaussianBlur(image, (0, 0), 0.8)


def scene(height: int = 480, width: int = 640) -> Any:
    return painted(height, width, (LEFT, RED), (RIGHT, GREEN))


@pytest.fixture(scope="module", params=FORMS)
def net(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> PromptableNet:
    return PromptableNet(*write_pair(tmp_path_factory.mktemp(request.param), request.param))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_pair(tmp_path_factory.mktemp("pair"), "sam")[0].parent


def box_of(region: Region) -> tuple[int, ...]:
    """Of the pixels that more likely belong to it than not."""
    return tuple(cv2.boundingRect((region.mask > 0.5).astype(np.uint8)))


def is_near(one: tuple[int, ...], other: tuple[int, ...]) -> bool:
    """Whether boxes differ by at most two cells of the stand-in's embedding, one on either side."""
    return max(abs(a - b) for a, b in zip(one, other, strict=True)) <= 8


def best(net: PromptableNet, image: Any, **said: Any) -> Region:
    return net.regions(image, FirstImage.of(**said).within(image.shape))[0]


# --- what is answered ----------------------------------------------------------------------------


@pytest.mark.sampled(3)
@pytest.mark.parametrize("size", [(480, 640), (600, 450), (720, 1280)])
def test_a_click_or_a_box_says_which_object_is_meant(net: PromptableNet, size: tuple[int, int]) -> None:
    image = scene(*size)
    for x, y, w, h in (LEFT, RIGHT):
        clicked = best(net, image, object_at=(x + w // 2, y + h // 2))
        assert is_near(box_of(clicked), (x, y, w, h)), box_of(clicked)
        assert clicked.probability == pytest.approx(SCORES[1]) and clicked.mask.shape == size
        boxed = best(net, image, box=(x - 9, y - 9, w + 18, h + 18))
        assert is_near(box_of(boxed), (x, y, w, h)), box_of(boxed)
        drawn = best(net, image, outline=[(x - 9, y - 9), (x + w + 9, y), (x + w, y + h + 9)])
        assert is_near(box_of(drawn), (x, y, w, h)), box_of(drawn)


def test_a_box_keeps_what_lies_outside_it_away(net: PromptableNet) -> None:
    image = painted(480, 640, ((100, 120, 130, 200), RED), ((330, 150, 90, 140), RED))
    assert is_near(box_of(best(net, image, object_at=(150, 200))), (100, 120, 320, 200))
    assert is_near(box_of(best(net, image, box=(90, 110, 150, 220))), (100, 120, 130, 200))
    assert is_near(box_of(best(net, image, box=(90, 110, 150, 220), object_at=(150, 200))), (100, 120, 130, 200))


def test_a_pixel_beside_the_object_takes_away_what_it_is_on(net: PromptableNet) -> None:
    image = painted(480, 640, ((100, 120, 130, 200), RED), ((230, 120, 100, 200), PINK))
    assert is_near(box_of(best(net, image, object_at=(150, 200))), (100, 120, 230, 200))
    assert is_near(box_of(best(net, image, object_at=(150, 200), not_at=(280, 200))), (100, 120, 130, 200))
    two = [(150, 200), (280, 200)]
    assert is_near(box_of(best(net, image, object_at=two, not_at=(500, 400))), (100, 120, 230, 200))


@pytest.mark.sampled(1)
def test_where_nothing_is_said_a_grid_is_asked_and_each_region_is_there_once(net: PromptableNet) -> None:
    image = scene()
    found = net.regions(image, FirstImage())
    assert any(is_near(box_of(r), LEFT) for r in found) and any(is_near(box_of(r), RIGHT) for r in found)
    inside = [r.mask > 0.5 for r in found]
    for k, one in enumerate(inside):
        for other in inside[:k]:
            assert np.count_nonzero(one & other) < 0.85 * np.count_nonzero(one | other)
    assert [r.probability for r in found] == sorted((r.probability for r in found), reverse=True)
    hidden = np.full(image.shape[:2], 255, np.uint8)
    assert not net.regions(image, FirstImage(hidden=hidden))


def test_grey_images_are_taken_too(net: PromptableNet) -> None:
    grey = cv2.cvtColor(scene(), cv2.COLOR_BGR2GRAY)
    assert is_near(box_of(best(net, grey, object_at=(160, 200))), LEFT)


@pytest.mark.sampled(1)
def test_the_encoder_runs_once_for_all_that_is_said_of_an_image(
    net: PromptableNet, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = {"encoder": 0, "decoder": 0}

    def counted(name: str, run: Callable[..., Any]) -> Callable[..., Any]:
        def ask(*given: Any) -> Any:
            asked[name] += 1
            return run(*given)

        return ask

    monkeypatch.setattr(net._encoder, "run", counted("encoder", net._encoder.run))
    monkeypatch.setattr(net._decoder, "run", counted("decoder", net._decoder.run))
    image = scene(481, 641)
    for at in ((160, 200), (370, 200), (160, 200)):
        best(net, image.copy(), object_at=at)
    assert asked == {"encoder": 1, "decoder": 3}
    image[5, 5] = 0  # the same array, another image
    best(net, image, object_at=(160, 200))
    assert asked == {"encoder": 2, "decoder": 4}


def test_of_four_masks_the_first_answers_several_points_alone(tmp_path: Path) -> None:
    write_encoder(tmp_path / "encoder.onnx", "sam")
    write_decoder(tmp_path / "decoder.onnx", "sam", masks=4)
    four = PromptableNet(tmp_path / "encoder.onnx", tmp_path / "decoder.onnx")
    assert best(four, scene(), object_at=(160, 200)).probability == pytest.approx(SCORES[1])
    assert best(four, scene(), object_at=[(160, 200), (170, 220)]).probability == pytest.approx(0.99)
    assert best(four, scene(), box=(90, 110, 150, 220)).probability == pytest.approx(0.99)


@pytest.mark.sampled(1)
@pytest.mark.parametrize("form", ["sam", "fixed"])
def test_masks_of_the_image_s_size_are_as_good_as_coarse_ones(tmp_path: Path, form: str) -> None:
    encoder, coarse = write_pair(tmp_path, form)
    fine = tmp_path / "fine.onnx"
    write_decoder(fine, "sam", low=False)
    for size in ((480, 640), (600, 450)):
        masks = [best(PromptableNet(encoder, d), scene(*size), object_at=(160, 200)).mask for d in (coarse, fine)]
        one, other = (mask > 0.5 for mask in masks)
        assert np.count_nonzero(one & other) > 0.98 * np.count_nonzero(one | other)


# --- through the first look ----------------------------------------------------------------------


@pytest.mark.slow
def test_its_regions_pass_through_the_same_localisation(folder: Path) -> None:
    image = scene()
    for x, y, w, h in (LEFT, RIGHT):
        found = gt.first_look(image, (x + w / 2, y + h / 2), segmenter=f"sam:{folder}")
        assert found[0].view.outer.area == pytest.approx(w * h, rel=0.01)
    both = f"sam:{folder / 'tiny.encoder.onnx'},{folder / 'tiny.decoder.onnx'}"
    assert gt.first_look(image, segmenter=both)


def test_a_net_finds_the_object_that_has_no_edge_of_its_own_all_round(folder: Path) -> None:
    """Stripes as strong as its outline cross the object: what the own search finds is a part of it."""
    rng = np.random.default_rng(3)
    image = np.full((480, 640, 3), TABLE, np.uint8)
    image[rng.integers(0, 2, (24, 32)).repeat(20, 0).repeat(20, 1) > 0] = (120, 205, 210)
    image[150:330, 200:420] = RED
    image = cv2.GaussianBlur(image, (0, 0), 0.8)
    first = gt.first_look(image, (300, 240), segmenter=f"sam:{folder}")[0]
    assert first.view.outer.area == pytest.approx(180.0 * 220.0, rel=0.01)


class Given:
    """Regions that were thought out."""

    def __init__(self, *regions: Region) -> None:
        self._regions = regions

    def regions(self, image: Any, hints: FirstImage) -> tuple[Region, ...]:
        return self._regions


def test_alternatives_are_no_votes() -> None:
    """A region that one of three alternatives shows is as good as if the others were not there."""
    image = scene()
    plate, part, table = (np.zeros((480, 640), np.float32) for _ in range(3))
    x, y, w, h = LEFT
    plate[y : y + h, x : x + w] = part[y : y + 60, x : x + 60] = table[:] = 1.0
    one, three = Given(Region(plate, 0.9)), Given(Region(plate, 0.9), Region(part, 0.5), Region(table, 0.4))
    worth = []
    for segmenter in (one, three):
        look = CandidateSearch(image, FirstImage(), segmenter)
        meant = next(p for p in look.compared_proposals() if is_near(p.silhouette.box, LEFT))
        worth.append(measure_worth([meant], look._maps, None, load_numbers(True))[0])
    assert worth[0] == pytest.approx(worth[1])
    votes = Given(*(Region(m, is_vote=True) for m in (plate, part, table)))
    look = CandidateSearch(image, FirstImage(), votes)
    assert len(look._maps) == 1 and look._maps[0].max() == 1.0 and look._maps[0][470, 600] == pytest.approx(1.0 / 3.0)


def test_a_choice_among_alternatives_is_never_surer_than_one_by_votes() -> None:
    image = scene()
    plate = np.zeros((480, 640), np.float32)
    plate[LEFT[1] : LEFT[1] + LEFT[3], LEFT[0] : LEFT[0] + LEFT[2]] = 1.0
    voted, told = (
        gt.first_look(image, (160, 200), segmenter=Given(Region(plate, is_vote=v)))[0].probability
        for v in (True, False)
    )
    assert 0.0 < told <= voted


# --- what can be wrong ---------------------------------------------------------------------------


def test_a_wrong_file_is_told_in_one_line_that_names_what_was_found(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # a line has an end, and the folder's name may be long
    encoder, decoder = write_pair(Path("sam"), "sam")
    encoder2, decoder2 = write_pair(Path("sam2"), "sam2")
    garbage = Path("garbage.onnx")
    garbage.write_bytes(b"no model at all" * 40)
    picture = tmp_path / "scene.png"
    cv2.imwrite(str(picture), scene())
    (tmp_path / "empty").mkdir()
    write_decoder(tmp_path / "sam" / "other_decoder.onnx", "sam")
    for what, said in (
        (f"{encoder},{encoder}", "is no mask decoder of SAM, EdgeSAM or SAM 2: it takes input_image and gives"),
        (f"{decoder},{decoder}", "is no image encoder: it takes image_embeddings (1, 3, 256, 256), point_coords"),
        (f"{encoder},{decoder2}", "gives image_embeddings, but"),
        (f"{encoder2},{decoder}", "encoder and decoder of one export are needed"),
        (f"{encoder},none.onnx", "there is no model file"),
        (f"{garbage},{decoder}", "cannot be read as an ONNX model"),
        ("empty", "its models: none"),
        ("sam", "other_decoder.onnx, tiny.decoder.onnx, tiny.encoder.onnx"),
        ("", "ENCODER.onnx,DECODER.onnx or a folder"),
    ):
        assert main(["inspect", str(picture), "--segmenter", f"sam:{what}"]) == 2
        told = capsys.readouterr().err.strip()
        assert said in told and len(told.splitlines()) == 1, told


def test_a_net_that_does_not_run_is_told_in_one_line(tmp_path: Path) -> None:
    encoder, decoder = write_pair(tmp_path, "edge")
    net = PromptableNet(encoder, decoder)
    net._size = (512, 512)  # as of a file that says nothing of its size, and takes one alone
    with pytest.raises(InputError, match=r"does not run on image \(1, 3, 512, 512\)") as told:
        net.regions(scene(), FirstImage())
    assert len(str(told.value).splitlines()) == 1


def test_masks_and_scores_that_do_not_agree_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    net = PromptableNet(*write_pair(tmp_path, "edge"))
    monkeypatch.setattr(net._decoder, "run", lambda *_: [np.ones((1, 2)), np.ones((1, 3, 256, 256))])
    with pytest.raises(InputError, match=r"gives masks \(1, 3, 256, 256\) and 2 scores"):
        net.regions(scene(), FirstImage.of((160, 200)))


def test_without_onnxruntime_the_extra_is_named(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(InputError, match=r"\[segment\]"):
        gt.first_look(scene(), segmenter=f"sam:{folder}")


# --- by name -------------------------------------------------------------------------------------


def test_a_pair_is_fetched_checked_and_run_by_its_name(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    files = [
        models.ModelFile(0.1, path.as_uri(), f"sha256:{hashlib.sha256(path.read_bytes()).hexdigest()}")
        for path in (folder / "tiny.encoder.onnx", folder / "tiny.decoder.onnx")
    ]
    wrong = files[1]._replace(digest="sha256:" + 64 * "0")
    made = [
        models.NetModel(n, "clicks", "Apache-2.0", (files[0], last), None)
        for n, last in (("ours", files[1]), ("bad", wrong))
    ]
    register_models(monkeypatch, made)
    monkeypatch.setenv("GRASPTRACK_MODELS", str(tmp_path / "kept"))
    with pytest.raises(InputError, match="grasptrack models get ours"):
        gt.first_look(scene(), segmenter="ours")
    assert main(["models", "get", "ours"]) == 0
    assert capsys.readouterr().out.count("sha256 checked") == 2
    assert gt.first_look(scene(), (160, 200), segmenter="ours")[0].view.outer.area == pytest.approx(26000.0, rel=0.01)
    assert main(["models", "get", "bad"]) == 2
    assert "is not model" in capsys.readouterr().err
    assert main(["models"]) == 0
    listed = capsys.readouterr().out.splitlines()
    assert [line.split()[4] for line in listed if line.startswith(("ours", "bad"))] == ["yes", "no"]
    assert sum(files[1].url in line for line in listed) == 2


def test_what_is_listed_can_be_fetched_and_is_named_once() -> None:
    names = [m.name for m in models.MODELS]
    assert len(set(names)) == len(names)
    for model in models.MODELS:
        assert len(model.files) == (2 if model.side is None else 1)
        for file in model.files:
            algorithm, _, value = file.digest.partition(":")
            assert file.url.startswith("https://") and len(value) == hashlib.new(algorithm).digest_size * 2
            assert algorithm == "sha256" or model.name == "u2net"

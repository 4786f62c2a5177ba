# SPDX-License-Identifier: Apache-2.0
"""Pictures and plain values of results: what a notebook shows, and what goes to JSON."""

import json
from typing import Any

import cv2
import numpy as np
import pytest

import grasptrack as gt
from grasptrack.demo import demo_scene
from grasptrack.view.draw import draw_grasps, draw_overlay


@pytest.fixture(scope="module")
def found() -> dict[str, Any]:
    """An image, and all that can be found in it."""
    image = next(iter(demo_scene(frames=4))).image
    candidates = gt.first_look(image)
    outline = candidates[0].view
    grasps = gt.synthesize(outline)
    tracker = gt.GraspTracker()
    lost = gt.TrackResult(3, None, "lost", "the object is not found", reason_code="not-found")
    return {
        "image": image,
        "result": tracker.update(image),
        "lost": lost,
        "candidates": candidates,
        "grasps": grasps,
        "grasp": gt.Grasp(grasps[0].contacts),
        "transfer": gt.transfer(grasps[0], outline, outline.transformed(np.diag([1.1, 1.1, 1.0])), "grasp-line"),
        "outline": outline,
        "contour": outline.outer,
        "analysis": gt.analyze(grasps[0], outline),
        "suitability": gt.inspect(image, runs=1),
    }


DRAWN = ["result", "lost", "candidates", "grasps", "grasp", "transfer", "outline", "contour", "suitability"]


@pytest.mark.sampled(1)
@pytest.mark.parametrize("kind", DRAWN)
def test_all_that_is_found_can_be_drawn_on_its_image_and_without(found: dict[str, Any], kind: str) -> None:
    image = found["image"].copy()
    drawn = gt.draw(image, found[kind])
    assert drawn.dtype == np.uint8 and drawn.ndim == 3 and drawn.shape[2] == 3
    assert np.array_equal(image, found["image"]), "the image itself is left as it is"
    shown = cv2.imdecode(np.frombuffer(drawn._repr_png_(), np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(shown, drawn)
    if kind not in ("suitability", "lost"):
        plain = gt.draw(image, [found["grasp"]] if kind == "candidates" else found["candidates"][0])
        assert plain.shape != drawn.shape or (plain != drawn).any()
    assert gt.draw(None, found[kind]).size


@pytest.mark.parametrize("kind", ["result", "lost", "outline", "contour"])
def test_results_show_themselves(found: dict[str, Any], kind: str) -> None:
    assert found[kind]._repr_png_().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    "kind", ["result", "lost", "grasp", "transfer", "outline", "contour", "analysis", "suitability"]
)
def test_presentation_are_json_by_the_names_of_the_attributes(found: dict[str, Any], kind: str) -> None:
    told = found[kind].to_dict()
    assert json.loads(json.dumps(told, allow_nan=False)) == told
    for name, value in told.items():
        own = getattr(found[kind], name)
        if isinstance(own, np.ndarray):
            np.testing.assert_array_equal(np.array(value, dtype=float), own)
        elif isinstance(own, (str, int)):
            assert value == own


def test_representations_are_short(found: dict[str, Any]) -> None:
    listed = [*(found[k] for k in (*DRAWN, "analysis") if k not in ("grasps", "candidates")), found["grasps"][0]]
    for value in [*listed, found["candidates"][0], gt.GraspTracker(), gt.Hand(), gt.Limits()]:
        assert len(repr(value)) < 240 and "\n" not in repr(value), repr(value)


@pytest.mark.parametrize("wrong", [None, "text", 3, [1, 2]])
def test_what_cannot_be_drawn_is_told(found: dict[str, Any], wrong: Any) -> None:
    with pytest.raises(gt.InputError, match="what can be drawn"):
        gt.draw(found["image"], wrong)


def test_an_image_that_is_none_is_told(found: dict[str, Any]) -> None:
    with pytest.raises(gt.InputError, match="an image is an array"):
        gt.draw(np.zeros(5), found["result"])


def test_a_lost_object_leaves_its_last_outline_dashed(found: dict[str, Any]) -> None:
    plain = draw_overlay(found["image"], found["lost"])
    dashed = draw_overlay(found["image"], found["lost"], last=found["outline"])
    located = draw_overlay(found["image"], found["result"])
    np.testing.assert_array_equal(draw_overlay(found["image"], found["result"], last=found["outline"]), located)
    solid = draw_grasps(found["image"], [], found["outline"])
    height = found["image"].shape[0]
    changed = (dashed[:height] != plain[:height]).any(axis=2).mean()
    whole = (solid != plain[:height]).any(axis=2).mean()
    assert 0.3 * whole < changed < 0.9 * whole

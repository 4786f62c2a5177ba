# SPDX-License-Identifier: Apache-2.0
"""What goes to the page, strict JSON and each image once, and what comes from it: commands as they were said, else one line."""

import json
import math
import struct
from dataclasses import fields, is_dataclass, replace
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack import InputError, TrackResult
from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import Contour, View
from grasptrack.grasp.force_closure import GraspAnalysis
from grasptrack.io.base import Frame
from grasptrack.io.images import encode_jpeg
from grasptrack.io.publishing import may_close
from grasptrack.live import frames
from grasptrack.live.commands import (
    COMMANDS,
    FARTHEST,
    LARGEST,
    Box,
    Choose,
    Contacts,
    Fingers,
    Fingertips,
    Friction,
    Hover,
    Outline,
    Pause,
    Pick,
    Rechoose,
    Record,
    Restart,
    Start,
    Wire,
    command_of,
    parse_message,
)
from grasptrack.live.frames import UNITS_PER_PX, Painter, moment_to_json
from grasptrack.live.inbox import Arrival
from grasptrack.live.state import KEPT, CurvePoint, Curves, Shown, headline_of
from grasptrack.tracking.messages import SENTENCES
from grasptrack.tracking.numbers import NUMBERS

ANY = st.one_of(st.floats(-1e300, 1e300), st.sampled_from([math.nan, math.inf, -math.inf, 0.0]))
"""What is finite here is so in degrees and per cent too."""
CORNERS = np.array([[10, 10], [25, 10], [40.123, 10], [40, 25], [40, 40], [25, 40.0049], [10, 40], [10, 25]])


def result_of(**values: Any) -> TrackResult:
    normals = np.array([[1.0, 0.0], [-1.0, 0.0]])
    margin = values.pop("margin", 0.2)
    analysis = GraspAnalysis(True, margin, 0.1, 15.0, 0.0, np.zeros(2), normals, 0.5, "image", "")
    contacts = np.array([[10.0, 25.1234], [40.0, 25.0]])
    given: dict[str, Any] = {
        "contacts": contacts,
        "seen": np.ones(2),
        "analysis": analysis,
        "view": View(Contour(CORNERS)),
        "covariance": np.stack([0.25 * np.eye(2)] * 2),
    }
    return TrackResult(**{"frame": 0, "time": None, "status": "tracked", "reason": "", **given, **values})


def shown_of(image: int = 1, number: int = 1, **more: Any) -> Shown:
    picture = np.full((48, 64, 3), 10 * image, np.uint8)
    arrival = Arrival(Frame(image - 1, 0.5, picture, f"frame {image}"), 1.0, 1)
    return Shown(number=number, phase="tracking", image=image, arrival=arrival, **more)


@given(ANY, ANY, ANY, ANY, ANY)
def test_any_figures_make_strict_json(
    margin: float, chance: float, latency: float, distance: float, sigma: float
) -> None:
    result = result_of(
        margin=margin, chance=chance, latency_ms=latency, distance=distance, covariance=np.full((2, 2, 2), sigma)
    )

    def refuse(name: str) -> None:
        raise AssertionError(f"{name} is no JSON")

    content = json.loads(moment_to_json(shown_of(result=result)), parse_constant=refuse)
    figures = {key: value for key, _, value, _ in content["figures"]}
    told = {"margin": margin, "chance": chance, "latency": latency, "distance": distance}
    assert {key for key in told if key in figures} == {key for key, value in told.items() if math.isfinite(value)}
    assert not any(word in value for value in figures.values() for word in ("nan", "inf"))


def test_lines_are_exact_to_a_hundredth_and_contacts_to_a_thousandth() -> None:
    content = json.loads(moment_to_json(shown_of(result=result_of(), meant=FirstImage(object_at=((1.5, 2.25),)))))
    (outline,) = content["result"]["outlines"]
    assert all(isinstance(value, int) for value in outline)
    assert np.abs(np.reshape(outline, (-1, 2)) / UNITS_PER_PX - CORNERS).max() <= 0.5 / UNITS_PER_PX + 1e-9
    assert content["result"]["contacts"] == [[10.0, 25.123], [40.0, 25.0]]
    assert ["contacts", "Contacts", "± 0.71 px"] in [each[:3] for each in content["figures"]]
    assert content["meant"]["on"] == [[1.5, 2.25]] and content["size"] == [64, 48]


@pytest.mark.parametrize(
    ("values", "key", "value"),
    [
        ({"margin": math.radians(7.63), "margin_sd": math.radians(1.24)}, "margin", "7.6 ± 1.2°"),
        ({"distance": 330.12, "distance_sd": 99.9}, "distance", "330 ± 100 mm"),
        ({"distance": 0.3301, "distance_sd": 0.0042}, "distance", "0.330 ± 0.004 mm"),
        ({"chance": 1.0}, "chance", "> 99.9 %"),
        ({"chance": 0.996}, "chance", "99.6 %"),
        ({"confidence": 1.0 - NUMBERS.untested}, "confidence", "≥ 0.999"),
        ({"confidence": 0.99871}, "confidence", "0.9987"),
        ({"confidence": 0.99871, "status": "lost", "contacts": None}, "guess", "0.9987"),
        ({"confidence": 1.0}, "confidence", None),
    ],
)
def test_figures_have_units_and_are_never_certain(values: dict[str, Any], key: str, value: str | None) -> None:
    content = json.loads(moment_to_json(shown_of(result=result_of(**values), unit="mm")))
    assert {each[0]: each[2] for each in content["figures"]}.get(key) == value
    assert all(tip for *_, tip in content["figures"])


LOST = {"status": "lost", "contacts": None, "reason": "not here", "reason_code": "not-found"}


@pytest.mark.parametrize(
    ("values", "more", "word", "part"),
    [
        ({}, {}, "OK TO CLOSE", "stable"),
        ({}, {"paused": True}, "TRACKED", "paused"),
        ({}, {"phase": "ended"}, "TRACKED", "last image"),
        ({"notice": "tilt-open"}, {}, "NOT SURE YET", SENTENCES["tilt-open"]),
        ({"notice": "contact-unseen"}, {}, "NOT SURE YET", "unseen"),
        ({"notice": "not-flat"}, {}, "TRACKED", "Do not close"),
        ({"object_sure": False}, {}, "NOT SURE YET", "which object"),
        ({"object_sure": False, "notice": "tilt-open"}, {}, "NOT SURE YET", SENTENCES["tilt-open"]),
        ({"repeated": True}, {}, "NOT SURE YET", "same image"),
        ({"last_seen": np.array([3, 2]), "frame": 3}, {}, "NOT SURE YET", "where a finger closes"),
        ({"last_seen": np.array([3, 3]), "frame": 3}, {}, "OK TO CLOSE", "stable"),
        ({"status": "unstable", "reason": "the fingers slip", "reason_code": "slips"}, {}, "NOT SURE YET", "slip"),
        ({"status": "unstable", "reason": "no", "reason_code": "not-closing"}, {}, "TRACKED", "Do not close: no"),
        (LOST, {}, "LOST", "not here"),
        (LOST, {"paused": True}, "LOST", "not here"),
    ],
)
def test_only_what_is_sure_now_is_ok_to_close(
    values: dict[str, Any], more: dict[str, Any], word: str, part: str
) -> None:
    found = headline_of(replace(shown_of(result=result_of(**values)), **more))
    assert found.word == word and part in found.why
    assert (found.tone == "tracked") == (word == "OK TO CLOSE")
    assert may_close(result_of(**values)) == (word == "OK TO CLOSE" or bool(more and values is not LOST))
    code = values.get("reason_code") or values.get("notice")
    assert "--" not in found.remedy and (not code or bool(found.remedy))


def test_a_lost_object_leaves_its_last_place() -> None:
    last, lost = result_of(), replace(result_of(**LOST), frame=8)
    content = json.loads(moment_to_json(shown_of(result=lost, last=last)))
    assert content["ghost"]["contacts"] == [[10.0, 25.123], [40.0, 25.0]] and len(content["ghost"]["outlines"]) == 1
    assert ["last", "Last located", "8 images ago"] in [each[:3] for each in content["figures"]]
    assert json.loads(moment_to_json(shown_of(result=last, last=last)))["ghost"] is None


def test_an_image_is_encoded_once_and_sent_once(monkeypatch: pytest.MonkeyPatch) -> None:
    encoded: list[int] = []

    def counted(image: np.ndarray) -> bytes:
        encoded.append(int(image[0, 0, 0]))
        return encode_jpeg(image)

    monkeypatch.setattr(frames, "encode_jpeg", counted)
    painter = Painter()
    first = painter.message_for(shown_of(1, 1), 0)
    again = painter.message_for(shown_of(1, 1), 0)
    known = painter.message_for(shown_of(1, 2), 1)
    other = painter.message_for(shown_of(2, 3), 1)
    assert first == again and encoded == [10, 20]
    lengths = [struct.unpack(">I", message[:4])[0] for message in (first, known, other)]
    assert len(known) == 4 + lengths[1]
    picture = cv2.imdecode(np.frombuffer(other[4 + lengths[2] :], np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (48, 64, 3) and abs(int(picture[0, 0, 0]) - 20) <= 2


@given(added=st.lists(st.tuples(ANY, ANY, ANY), max_size=3 * KEPT), asked=st.lists(st.integers(0, 40), max_size=20))
def test_pages_that_ask_now_and_then_miss_no_point_of_the_last(
    added: list[tuple[float, float, float]], asked: list[int]
) -> None:
    curves, seen, count, expected = Curves(), [], 0, []
    for k, (margin, confidence, latency) in enumerate(added):
        curves.add(result_of(margin=margin, confidence=confidence, latency_ms=latency))
        values = (math.degrees(margin) if math.isfinite(margin) else margin, confidence, latency)
        expected.append((*(v if math.isfinite(v) else None for v in values), "tracked"))
        if k in asked:
            count, new = curves.points_since(count)
            assert count == k + 1
            seen += new
    count, new = curves.points_since(count)
    seen += new
    assert count == len(added) and seen[-KEPT:] == expected[-KEPT:] == curves.points_since(0)[1]
    assert curves.points_since(count) == (count, [])


def test_each_page_is_sent_the_points_that_it_lacks() -> None:
    painter, point = Painter(), CurvePoint(None, 1.0, 2.5, "lost")
    for points in ([], [point], [point, point]):
        message = painter.message_for(shown_of(1, 1), 1, points)
        content = json.loads(message[4 : 4 + struct.unpack(">I", message[:4])[0]])
        assert content["curves"] == [[None, 1.0, 2.5, "lost"]] * len(points) and content["image"] == 1


@pytest.mark.parametrize("image", [np.zeros((0, 5), np.uint8), np.zeros((4, 4, 7), np.uint8), np.zeros((4, 4), "U1")])
def test_what_has_no_jpeg_is_refused(image: np.ndarray) -> None:
    with pytest.raises(InputError):
        encode_jpeg(image)
    with pytest.raises(InputError, match="1 to 100"):
        encode_jpeg(np.zeros((4, 4), np.uint8), 0)


NUMBER = st.floats(-FARTHEST, FARTHEST, allow_nan=False)
POINT = st.tuples(NUMBER, NUMBER)
IMAGE = st.integers(0, 2**53 - 1)
POSITIVE = st.floats(1e-3, 100.0)
GOOD = st.one_of(
    st.builds(Pick, IMAGE, NUMBER, NUMBER, st.booleans()),
    st.builds(Box, IMAGE, NUMBER, NUMBER, NUMBER, NUMBER),
    st.builds(Contacts, IMAGE, st.lists(POINT, min_size=2, max_size=8).map(tuple)),
    st.builds(Outline, IMAGE, st.lists(POINT, min_size=3, max_size=40).map(tuple)),
    st.builds(Choose, st.integers(1, 3)),
    st.builds(Pause, st.booleans()),
    st.builds(Friction, POSITIVE),
    st.builds(Fingers, st.integers(2, 3)),
    st.builds(Wire, IMAGE, st.sampled_from(["add", "hover", "close", "move", "back", "clear"]), NUMBER, NUMBER, IMAGE),
    st.builds(Hover, IMAGE, NUMBER, NUMBER),
    st.builds(Fingertips, st.lists(POINT, min_size=2, max_size=8).map(tuple), POSITIVE, NUMBER, st.booleans()),
    st.builds(Record, st.booleans()),
    st.sampled_from([Start(), Restart(), Rechoose()]),
)
JSON = st.recursive(
    st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=20)),
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=8), inner, max_size=4)),
    max_leaves=12,
)


def as_message(command: Any) -> dict[str, Any]:
    assert is_dataclass(command)
    values = {field.name: getattr(command, field.name) for field in fields(command)}
    return {"do": type(command).__name__.lower(), **values}


@given(GOOD)
def test_a_command_comes_through_as_it_was_said(command: Any) -> None:
    assert command_of(parse_message(json.dumps(as_message(command)))) == command


@given(st.sampled_from(sorted(COMMANDS)), st.dictionaries(st.text(max_size=8), JSON, max_size=4), st.data())
def test_anything_else_is_refused_in_one_line(name: str, extra: dict[str, Any], data: st.DataObject) -> None:
    own = {field.name: data.draw(JSON) for field in fields(COMMANDS[name]) if data.draw(st.booleans())}
    try:
        command = command_of({**extra, **own, "do": name})
    except InputError as error:
        assert "\n" not in str(error) and len(str(error)) < 400
    else:
        for field in fields(command):
            value = getattr(command, field.name)
            assert not isinstance(value, float) or (math.isfinite(value) and abs(value) <= FARTHEST)


@given(st.one_of(st.text(max_size=60), st.binary(max_size=60)))
def test_what_is_no_json_object_is_refused(text: str | bytes) -> None:
    try:
        content = parse_message(text)
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert isinstance(content, dict)


@pytest.mark.parametrize(
    ("message", "told"),
    [
        ("[" * 30_000, "JSON object"),
        ('{"do": "pick", "x": ' + "9" * 5000 + "}", "JSON object"),
        (" " * (LARGEST + 1), "at most"),
        ('{"do": "dance"}', "unknown command"),
        ('{"do": ["pick"]}', "unknown command"),
        ('{"do": "pick", "image": 1, "x": 1}', "lacks y"),
        ('{"do": "pick", "image": 1, "x": 1e999, "y": 1}', "number"),
        ('{"do": "pick", "image": 1, "x": NaN, "y": 1}', "number"),
        ('{"do": "pick", "image": -1, "x": 1, "y": 1}', "whole number"),
        ('{"do": "pick", "image": true, "x": 1, "y": 1}', "whole number"),
        ('{"do": "start", "x": 1}', "has no"),
        ('{"do": "friction", "value": 0}', "positive"),
        ('{"do": "fingers", "count": 4}', "2 or 3"),
        ('{"do": "choose", "number": 0}', "numbered from 1"),
        ('{"do": "contacts", "image": 1, "points": [[1, 2]]}', "2 to 8"),
        ('{"do": "outline", "image": 1, "points": [[1, 2], [3]]}', "points"),
        ('{"do": "wire", "image": 1, "step": "jump"}', "one of add"),
    ],
)
def test_each_refusal_says_what_is_wrong(message: str, told: str) -> None:
    with pytest.raises(InputError, match=told):
        command_of(parse_message(message))

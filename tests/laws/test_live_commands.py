# SPDX-License-Identifier: Apache-2.0
"""Messages of the page: what is a command comes through as it was said, and everything else is refused in one line."""

import json
import math
from dataclasses import fields, is_dataclass
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack import InputError
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
    st.builds(Wire, IMAGE, st.sampled_from(["start", "hover", "add", "close", "move", "clear"]), NUMBER, NUMBER, IMAGE),
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
        ('{"do": "choose", "number": 0}', "1 to 3"),
        ('{"do": "contacts", "image": 1, "points": [[1, 2]]}', "2 to 8"),
        ('{"do": "outline", "image": 1, "points": [[1, 2], [3]]}', "points"),
        ('{"do": "wire", "image": 1, "step": "jump"}', "one of start"),
    ],
)
def test_each_refusal_says_what_is_wrong(message: str, told: str) -> None:
    with pytest.raises(InputError, match=told):
        command_of(parse_message(message))

# SPDX-License-Identifier: Apache-2.0
"""As much YAML as calibrations are written in: maps by indentation, lists of numbers and words, tags, comments.

OpenCV's own reader takes what OpenCV writes and stops at a comment, or at a list with dashes as ROS 2 prints it.
"""

from __future__ import annotations

import re
from typing import Any

from grasptrack.errors import InputError

_KEY = re.compile(r"""("[^"]*"|'[^']*'|[^\s\[\]{}"',:#-][^:#\[\]{}]*?)\s*:(?:\s+|$)(.*)$""")
_COMMENT = re.compile(r"""("[^"]*"|'[^']*')|(?:^|\s)#.*$""")
_Lines = list[tuple[int, int, str]]
"""Number, indentation and text of each line."""
_TOKEN = re.compile(r"""\[|\]|,|"[^"]*"|'[^']*'|[^\[\],]+""")


def read_yaml(text: str) -> Any:
    """The first document as dictionaries, lists, numbers and words; an empty value is None.

    Raises:
        InputError: what is not YAML of this kind; the message has the line.
    """
    lines: _Lines = []
    for number, line in enumerate(text.splitlines(), 1):
        bare = _COMMENT.sub(lambda m: m[1] or "", line).rstrip()
        if bare.startswith(("---", "...")) and lines:
            break
        if bare.strip() and not bare.startswith(("%", "---", "...")):
            lines.append((number, len(bare) - len(bare.lstrip(" ")), bare.strip()))
    if not lines:
        return None
    try:
        found, rest = _parse_block(lines, 0, lines[0][1])
    except RecursionError:
        raise InputError("line 1 begins what is nested too deeply") from None
    if rest < len(lines):
        raise InputError(f"line {lines[rest][0]} is no YAML that can be read")
    return found


def _parse_block(lines: _Lines, at: int, indent: int) -> tuple[Any, int]:
    """What is written at one indentation, and the line after it."""
    if _is_list_item(lines[at][2]):
        items = []
        while at < len(lines) and lines[at][1] == indent and _is_list_item(lines[at][2]):
            value, at = _parse_value(lines, at, lines[at][2][1:].strip())
            items.append(value)
        return items, at
    found: dict[str, Any] = {}
    while at < len(lines) and lines[at][1] == indent:
        key = _KEY.match(lines[at][2])
        if key is None:
            break
        rest = re.sub(r"^!\S*\s*", "", key[2])
        if rest:
            value, at = _parse_value(lines, at, rest)
        else:
            value, at = None, at + 1
            if at < len(lines) and (lines[at][1] > indent or (lines[at][1] == indent and _is_list_item(lines[at][2]))):
                value, at = _parse_block(lines, at, lines[at][1])
        found[key[1].strip("\"'")] = value
    return found, at


def _is_list_item(line: str) -> bool:
    return line == "-" or line.startswith("- ")


def _parse_value(lines: _Lines, at: int, rest: str) -> tuple[Any, int]:
    """A number, a word, or a list in brackets, which may go on over lines; and the line after it."""
    number, at = lines[at][0], at + 1
    if not rest.startswith("["):
        return _parse_scalar(rest), at
    while rest.count("[") > rest.count("]") and at < len(lines):
        rest, at = f"{rest} {lines[at][2]}", at + 1
    stack: list[list[Any]] = [[]]
    for token in (t.strip() for t in _TOKEN.findall(rest)):
        if token == "[":
            stack.append([])
        elif token == "]" and len(stack) > 1:
            stack[-2].append(stack.pop())
        elif token and token != ",":
            stack[-1].append(_parse_scalar(token))
    if len(stack) != 1 or len(stack[0]) != 1:
        raise InputError(f"line {number} has a list that does not end")
    return stack[0][0], at


def _parse_scalar(text: str) -> Any:
    if not text:
        return None
    if text[0] in "\"'":
        return text.strip(text[0])
    word = text.lower().lstrip("+-")
    if word in (".nan", ".inf"):
        return float(text.lower().replace(".", ""))
    try:
        return float(text)
    except ValueError:
        return None if text in ("~", "null") else text

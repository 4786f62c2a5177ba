# SPDX-License-Identifier: Apache-2.0
"""Help of all verbs: one order, one form of defaults, units and values."""

import re
from collections.abc import Iterator
from functools import cache
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest

from grasptrack.cli import help_groups
from grasptrack.cli.main import main
from program import whole_program

PROGRAM: Any = whole_program()
UNITS = {
    "MS": "in ms",
    "S": "in s",
    "VX,VY": "in px/s",
    "FPS": "in frames/s",
    "PX_PER_MM": "in px per mm",
    "MP": "in 10^6 px",
}
WORDS = {"MU": "coefficient", "P": "robability", "R": "Ratio", "FRAME": "Index, from 0,"}
TEXTS = {"NAME", "A,B", "DIR", "FILE", "ADDRESS", "HOST", "NAME=VALUE"}
PIXELS = {"X,Y", "X,Y,W,H", '"X,Y X,Y ..."'}
COUNTS = r"(Number of|Seed of|Candidate to take|Record images as JPEG of this quality)"


def verbs() -> dict[str, Any]:
    """All that do something, by name."""
    found: dict[str, Any] = {}

    def add(command: Any, name: str) -> None:
        below = getattr(command, "commands", None)
        if below is None or command.invoke_without_command:
            found[name] = command
        for word, sub in (below or {}).items():
            add(sub, f"{name} {word}".strip())

    add(PROGRAM, "")
    return found


VERBS = verbs()


def options(verb: str) -> list[Any]:
    return [p for p in VERBS[verb].params if p.param_type_name == "option"]


def long_name(option: Any) -> str:
    return str(max(option.opts, key=len))


def every_option() -> Iterator[Any]:
    for verb in VERBS:
        for option in options(verb):
            yield pytest.param(verb, option, id=f"{verb} {long_name(option)}")


@cache
def shown(verb: str) -> dict[str, tuple[str, str]]:
    """Heading and text of each option in the help, in its order."""
    import contextlib
    import io

    with contextlib.redirect_stdout(io.StringIO()) as out:
        assert main([*verb.split(), "--help"]) == 0
    found: dict[str, tuple[str, str]] = {}
    heading, name = "", ""
    for line in out.getvalue().splitlines():
        if re.match(r"\S.*:$", line):
            heading, name = line[:-1], ""
        elif match := re.match(r"  (?:-\w, )?(--[a-z-]+)(?: (?! )(?:\".*?\"|\S+))?(?:  +(.*))?$", line):
            name = match[1]
            found[name] = heading, match[2] or ""
        elif name and line.startswith("     "):
            found[name] = heading, found[name][1] + line
    return found


def unspaced(text: str) -> str:
    """Without the blanks, which may be ends of lines."""
    return "".join(text.split())


def default_of(option: Any) -> str | None:
    """What its help says of its default."""
    if isinstance(option.show_default, str):
        return option.show_default
    return None if option.default is None or option.default is False else str(option.default)


def test_every_verb_and_option_has_its_group() -> None:
    below = PROGRAM.commands.values()
    assert {verb.rich_help_panel for verb in below} == set(help_groups.VERB_GROUPS)
    used = {option.rich_help_panel for verb in VERBS for option in options(verb)}
    assert used == set(help_groups.OPTION_GROUPS)


@pytest.mark.parametrize("verb", [v for v in VERBS if options(v)])
def test_options_are_shown_in_the_order_of_groups(verb: str) -> None:
    told = shown(verb)
    assert {name: heading for name, (heading, _) in told.items() if name != "--help"} == {
        long_name(option): option.rich_help_panel for option in options(verb)
    }
    ranks = [help_groups.OPTION_GROUPS.index(h) for n, (h, _) in told.items() if n != "--help"]
    assert ranks == sorted(ranks)
    assert list(told)[-1] == "--help"


def test_an_option_is_in_one_place_and_form_in_all_verbs() -> None:
    before: set[tuple[str, str]] = set()
    forms: dict[str, set[Any]] = {}
    for verb in VERBS:
        order = [name for name in shown(verb) if name != "--help"]
        before |= set(combinations(order, 2))
        for option in options(verb):
            forms.setdefault(long_name(option), set()).add((option.metavar, option.rich_help_panel))
    assert {(a, b) for a, b in before if (b, a) in before} == set()
    # `compare` writes a page, `teach` a file; masks of `evaluate scenes` are those of photos that make parts; `live` starts at
    # once, and its name is that of the page.
    two = {"--output", "--masks", "--start", "--name"}
    assert {name for name, found in forms.items() if len(found) > 1} <= two


def test_the_program_lists_verbs_in_groups(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--help"]) == 0
    out = capsys.readouterr().out
    at = [out.index(f"\n{group}:\n") for group in help_groups.VERB_GROUPS]
    assert at == sorted(at) and "Commands:" not in out
    assert max(map(len, out.split("Options:")[1].splitlines())) <= 80, "a short help that a narrow terminal breaks"


@pytest.mark.parametrize(("verb", "option"), list(every_option()))
def test_the_form_of_an_option(verb: str, option: Any) -> None:
    text = option.help
    assert text[0].isupper() and text.endswith("."), "a sentence"
    assert "[" not in text, "a default or a range is the parser's to tell"
    told, said = unspaced(shown(verb)[long_name(option)][1]), unspaced(text)
    assert told.startswith(said)
    brackets = told[len(said) :]
    assert re.fullmatch(r"(\[[^][]+\])?", brackets), "one pair at the most"
    default = default_of(option)
    assert brackets.startswith(f"[default:{unspaced(default)}") if default is not None else "default" not in brackets
    assert "x>" not in brackets and "x<" not in brackets, "a range is told in words"


@pytest.mark.parametrize(("verb", "option"), list(every_option()))
def test_a_value_names_its_unit(verb: str, option: Any) -> None:
    if option.is_flag:
        return
    text, metavar, panel = option.help, option.metavar, option.rich_help_panel
    assert metavar in {*UNITS, *WORDS, *TEXTS, *PIXELS, "N", "L"}
    if metavar == "N":
        assert re.match(COUNTS, text)
    if metavar in UNITS:
        assert UNITS[metavar] in text
    if metavar in WORDS:
        assert WORDS[metavar] in text
    if metavar in PIXELS:
        assert "in px" in text
    if metavar == "L":
        assert panel == help_groups.HAND or "in mm, cm, m or in" in text


def test_what_verbs_write_goes_to_one_folder() -> None:
    given = {v: {long_name(o): o.default for o in options(v)}.get("--output") for v in VERBS}
    writers = {verb: output for verb, output in given.items() if output is not None}
    assert writers == {verb: Path("grasptrack-out") / verb.replace(" ", "-") for verb in writers}
    assert set(given) - set(writers) == {"compare", "cameras", "doctor", "models", "models get", "teach"}

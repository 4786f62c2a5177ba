# SPDX-License-Identifier: Apache-2.0
"""The pages and tables of docs/ that say what the code says, written from it.

    python tests/helpers/written_pages.py    writes docs/cli.md, docs/api.md, docs/tables/*.md, three tables, and a schema

`cli.md` is the help of every verb, `api.md` the first sentence of every public name, `published.schema.json` a line that
`--publish` sends, `tables/scenes.md` the disturbances and the peers, `tables/numbers.md` the core's free numbers; tables of
reasons, of columns, of formats and of studies stand between their marks in `troubleshooting.md`, `files.md`, `sources.md` and
`evaluation.md`.
`tests/scenarios/test_docs.py` compares all of them.
"""

import ast
import inspect
import itertools
import json
import re
import struct
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import typer

import grasptrack
from grasptrack.io.bridges.modbus import ORDER_REGISTERS, STATE_REGISTERS
from grasptrack.io.columns import COLUMNS, IN_JSON, result_schema
from grasptrack.io.peers import REGISTERS
from grasptrack.io.publishing import DOES_NOT_FIT, FIXED_STATUS, MAY_CLOSE, SILENT, VERSION, fixed_line
from grasptrack.presentation import REMEDIES
from grasptrack.tracking.messages import SENTENCES
from grasptrack.tracking.numbers import OWN
from grasptrack_bench.baselines import PEERS
from grasptrack_bench.simulation.disturbances import DISTURBANCES
from program import whole_program
from sequence_kinds import BAGS, VIDEOS
from source_kinds import CLOSE, EXACT, ROUGH, STILLS

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
COMMAND = "tests/helpers/written_pages.py"
WRITTEN = f"<!-- Written by {COMMAND}: change the code, then run it. -->"

VERBS = (
    "track", "live", "demo", "synthesize", "inspect", "transfer", "teach", "find", "parts", "servo", "pick",
    "evaluate scenes", "evaluate real", "evaluate pot", "compare", "cameras", "models", "models get", "doctor",
)  # fmt: skip
CLI_HEAD = f"""# Command line

{WRITTEN}

What `grasptrack VERB --help` says, verb by verb. An option means the same in every verb. The files that verbs write, and
the exit status, are in [Files](files.md); what can stand for SOURCE is in [Sources](sources.md).

| value | meaning |
|---|---|
| N, FRAME | a whole number |
| P | a probability, 0 to 1 |
| MU | a coefficient of friction |
| X,Y | a place in px: to the right and down, from the centre of the first pixel |
| L | a length with its unit: `120px` (or `120`), `40mm`, `4cm`, `0.04m`, `1.6in`, or `30%` of the root of the object's area |
| MS, FPS, PX_PER_MM, MP | a number, in ms, frames/s, px per mm, 10^6 px |
| NAME; A,B | one of the names that are listed; several of them |
| DIR, FILE | a folder, a file |
"""
API_HEAD = f"""# API reference

{WRITTEN}

Every public name of `grasptrack`. On [the site](../CONTRIBUTING.md#set-up) each name leads to its whole docstring, here to
its source. Shapes stand in parentheses, px are those of your images, angles are in rad unless a name says otherwise
([conventions](conventions.md)). All else in the package is internal and may change. `grasptrack.__version__` is the version.
"""
PACKAGES = {
    "tracking": "A tracker gets images one by one and answers each with a `TrackResult`. After "
    '`result.status == "tracked"`, or `result.contacts is not None`, type checkers know that contacts, analysis and outline '
    "are there.",
    "io": "Images from any source, with their times.",
    "view": "Results as pictures.",
    "segmentation": "What the first image shows, and tools to say which object is meant.",
    "trackability": "How well an object can be tracked, before the run.",
    "grasp": "Single steps without images: outlines in, grasps and margins out. An array of points (N, 2) is an outline, too.",
    "transfer": "A grasp of one outline, found on another by a strategy of the paper.",
    "geometry": "Outlines, views and cameras.",
    "servo": "From results to twists of the hand: [how it works](servo.md).",
    "errors": "All are a `GraspTrackError`; what a user can correct is an `InputError`.",
}
"""Sections of the API page, in their order: the packages that have public names, and what they are for."""
ALIASES = {"Status": "The words that `TrackResult.status` can be.", "StrategyName": "The names of the strategies."}
"""Public names without a docstring of their own: types that are spelled out."""
NUMBERS_HEAD = f"""# The core's numbers

{WRITTEN}

Those of `src/grasptrack/tracking/numbers.json`. Work px are px of the first view, reduced for large objects."""
SCENES_HEAD = f"""# Scenes and peers

{WRITTEN}

What `grasptrack evaluate scenes` can do to a scene, and which methods it can compare.
[How they are measured](../evaluation.md)."""
OWN_WORDS = {
    "no-object": "the first look found nothing that looks like an object",
    "off-outline": "the strategy's contacts are not on the outline",
    "not-closing": "with this friction the contacts do not hold the object: force closure is lost",
}
"""Meanings of codes whose sentence is that of the step that refused."""
WITHIN = re.compile(rf"(<!-- \w+, by {COMMAND} -->\n).*?(<!-- end -->)", re.DOTALL)
"""A table in a page that is written by hand."""


# --- the command line ----------------------------------------------------------------------------


class _Sections:
    """Stands for click's formatter, and keeps what is written under each heading."""

    width = 80

    def __init__(self) -> None:
        self.rows: dict[str, list[tuple[str, str]]] = {}
        self._heading = ""

    @contextmanager
    def section(self, name: str) -> Iterator[None]:
        self._heading = name
        yield

    def write_dl(self, rows: list[tuple[str, str]], **_: Any) -> None:
        self.rows.setdefault(self._heading, []).extend(rows)


def command_line_page() -> str:
    """docs/cli.md."""
    program = whole_program()
    verbs = ", ".join(f"[{verb}](#grasptrack-{verb.replace(' ', '-')})" for verb in VERBS)
    parts = [CLI_HEAD, f"Verbs: {verbs}. `grasptrack --version` names version, backend and build."]
    for verb in VERBS:
        command = program
        for name in verb.split():
            command = command.commands[name]
        parts.append(_section_of(verb, command))
    return "\n\n".join(part.strip() for part in parts) + "\n"


def _section_of(verb: str, command: Any) -> str:
    context = typer.Context(command, info_name=f"grasptrack {verb}")
    sections = _Sections()
    command.format_options(context, sections)
    arguments = [p.metavar or p.name.upper() for p in command.params if p.param_type_name == "argument"]
    options = ["[options]"] if any(p.param_type_name == "option" for p in command.params) else []
    prose, _, examples = inspect.cleandoc(command.help or "").partition("\b\nExamples:\n")
    parts = [f"## grasptrack {verb}", f"```sh\n{' '.join(['grasptrack', verb, *arguments, *options])}\n```"]
    parts += [_with_options_marked(" ".join(paragraph.split())) for paragraph in prose.strip().split("\n\n")]
    rows = []
    for heading, listed in sections.rows.items():
        kept = [(name.split(" <")[0], text) for name, text in listed if "--help" not in name and heading != "Commands"]
        named = heading not in ("Arguments", "Options", "Support")
        rows += [f"| **{heading}** | |"] if kept and named else []
        rows += [f"| `{name.strip()}` | {_with_options_marked(text)} |" for name, text in kept]
    if rows:
        parts.append("\n".join(["| option | meaning |", "|---|---|", *rows]))
    if examples:
        parts.append("```sh\n" + inspect.cleandoc(examples) + "\n```")
    return "\n\n".join(parts)


def _with_options_marked(text: str) -> str:
    """Plain text of the help as Markdown: options and files as code, nothing emphasised by chance."""
    return re.sub(r"(?<![\w`-])(--[a-z][a-z-]*|[\w*/]*\*[\w.*/]*|SOURCE:\S+)", r"`\1`", text).replace("|", "\\|")


# --- the API -------------------------------------------------------------------------------------


def api_page() -> str:
    """docs/api.md."""
    homes = {name: _home_of(name) for name in grasptrack.__all__ if name != "__version__"}
    by_package: dict[str, list[str]] = {package: [] for package in PACKAGES}
    for name, home in homes.items():
        by_package[home.split(".")[0].replace("typing", "tracking")].append(name)
    parts = [API_HEAD]
    for package, names in by_package.items():
        lines = [f"## grasptrack.{package}", "", PACKAGES[package], ""]
        for name in sorted(names, key=lambda n: (homes[n] != f"{package}.tracker", n[0].islower(), n)):
            lines.append(f"- [`{name}`](../src/grasptrack/{_file_of(homes[name])}): {_first_sentence(name)}")
        parts.append("\n".join(lines))
    return "\n\n".join(part.strip() for part in parts) + "\n"


def _home_of(name: str) -> str:
    """The module, below grasptrack, in which a public name is written."""
    return str(getattr(_public(name), "__module__", "grasptrack.typing")).removeprefix("grasptrack.")


def _public(name: str) -> object:
    found = getattr(grasptrack, name)
    return vars(found)[name] if inspect.ismodule(found) else found  # `transfer` is a package, too


def _file_of(module: str) -> str:
    path = module.replace(".", "/")
    return f"{path}/__init__.py" if (ROOT / "src" / "grasptrack" / path).is_dir() else f"{path}.py"


def _first_sentence(name: str) -> str:
    text = ALIASES.get(name) or (inspect.getdoc(_public(name)) or "").split("\n\n")[0]
    return " ".join(text.split()).replace("*", "\\*")


# --- tables --------------------------------------------------------------------------------------


def scenes_table() -> str:
    """docs/tables/scenes.md."""
    rows = [f"| `{d.name}` | {d.group} | {d.about} |" for d in DISTURBANCES.values()]
    peers = [f"| `{name}` | {_first_line(peer)} |" for name, peer in PEERS.items()]
    disturbances = "\n".join(["| name | group | what happens |", "|---|---|---|", *rows])
    listed = "\n".join(["| name | what it is |", "|---|---|", *peers])
    return f"{SCENES_HEAD}\n\n## Disturbances\n\n{disturbances}\n\n## Peers\n\n{listed}\n"


def numbers_table() -> str:
    """docs/tables/numbers.md."""
    rows = ["| number | value | unit | meaning | fitted |", "|---|---|---|---|---|"]
    for name, entry in json.loads(OWN.read_text(encoding="utf-8")).items():
        between = f"{entry['from']:g} to {entry['to']:g}, " if "from" in entry else ""
        fitted = f"{between}`{entry['by']}`" if "by" in entry else ""
        row = f"| `{name}` | {entry['value']:g} | {entry['unit']} | {entry['meaning']} | {fitted} |"
        rows.append(row.replace("|  |", "| |"))
    return "\n".join([NUMBERS_HEAD, "", *rows, ""])


def _first_line(peer: object) -> str:
    return " ".join((inspect.getdoc(peer) or "").split("\n\n")[0].split()).replace("|", "\\|")


def fill_reasons(page: str) -> str:
    """The page on troubleshooting with its table of reasons written anew."""
    rows = ["| code | what it means | what to try | picture |", "|---|---|---|---|"]
    for code, sentence in SENTENCES.items():
        shown = (DOCS / "images" / "reasons" / f"{code}.webp").exists()
        picture = f"![{code}](images/reasons/{code}.webp)" if shown else ""
        rows.append(
            f"| `{code}` | {sentence or OWN_WORDS[code]} | {REMEDIES[code]} | {picture} |".replace("|  |", "| |")
        )
    return _fill(page, rows)


def fill_columns(page: str) -> str:
    """The page on files with its table of columns written anew."""
    rows = ["| column | key in JSON | unit | empty when |", "|---|---|---|---|"]
    for column in COLUMNS:
        names = [f"`{name}`" for name in column.cell_names(1)]
        cells = f"{names[0]} to {names[-1]}" if len(names) > 3 else ", ".join(names)
        more = ", ..." if "{i}" in column.cells else ""
        rows.append(f"| {cells}{more} | `{column.name}` | {column.unit} | {column.absent} |".replace("|  |", "| |"))
    listed = ", ".join(f"`{name}`" for name in IN_JSON)
    rows += [
        "",
        f"Keys of a line of JSON, in their order: {listed}; on demand `outline`.",
        "",
        *_fixed_columns(),
        *_register_rows(),
    ]
    return _fill(page, rows)


def _register_rows() -> list[str]:
    """What a client of `--publish modbus://` reads where."""
    cells = (
        (0, 1, f"version, {VERSION}"),
        (1, 1, "status, as in a fixed line"),
        (2, 1, "number of contacts"),
        (3, 1, "`sequence`, modulo 65536"),
        (4, 2, "`age_ms`, 32 bits; all ones before the first image"),
        (6, 2, "`confidence`, float of 32 bits, never rounded up"),
        (8, 2, "standard deviation of the least certain contact, px, float; infinite if not known"),
        (10, 12, "x, y of contacts 1 to 3, px, floats"),
    )
    assert sum(count for _, count, _ in cells) == REGISTERS
    rows = _register_table("holding and input registers of `--publish modbus://`, high word first", cells)
    arm = (("write", "orders to", ORDER_REGISTERS), ("read", "the state of", STATE_REGISTERS))
    for setting, what, registers in arm:
        sizes = [struct.calcsize(f">{form}") // 2 for form, _ in registers]
        places = zip(itertools.accumulate([0, *sizes[:-1]]), sizes, (text for _, text in registers), strict=True)
        rows += _register_table(
            f"from `{setting}` on, {what} an arm at `modbus:`: holding registers, high word first", places
        )
    return rows


def _register_table(head: str, cells: Iterable[tuple[int, int, str]]) -> list[str]:
    rows = ["", f"| register | {head} |", "|---|---|"]
    return rows + [f"| {a}{f' to {a + count - 1}' if count > 1 else ''} | {text} |" for a, count, text in cells]


def _fixed_columns() -> list[str]:
    """What a line of `--publish` with `?format=fixed` has where."""
    line = fixed_line({**dict.fromkeys(IN_JSON), "status": SILENT, "may_close": False, "sequence": 1, "age_ms": None})
    numbers = {MAY_CLOSE: "tracked, and `may_close`", DOES_NOT_FIT: "contacts that do not fit"}
    numbers |= {number: f"`{status}`" for status, number in FIXED_STATUS.items()}
    meanings = [
        f"version, {VERSION}",
        "status: " + ", ".join(f"{number} {numbers[number]}" for number in sorted(numbers)),
        "number of contacts",
        "`sequence`, its last four digits",
        "`age_ms`, 999999 before the first image",
        "`confidence`, never rounded up",
        *(f"{axis} of contact {k}, px" for k in (1, 2, 3) for axis in "xy"),
        "standard deviation of the least certain contact, px; 9.99: as much or more, or not known",
    ]
    rows = ["| characters | fixed line of `--publish` |", "|---|---|"]
    for found, meaning in zip(re.finditer(r"[\d.-]+", line), meanings, strict=True):
        first, last = found.start() + 1, found.end()
        rows.append(f"| {first} to {last} | {meaning} |" if last > first else f"| {first} | {meaning} |")
    return [*rows, "", f"As `{line.strip()}`, and a newline."]


def fill_formats(page: str) -> str:
    """The page on sources with its table of formats written anew."""
    kinds = (*STILLS, *VIDEOS, *BAGS)
    rows = ["| format | exact | but for rounding | as compression leaves it |", "|---|---|---|---|"]
    for named in dict.fromkeys((kind.format, kind.suffix) for kind in kinds if not kind.refused):
        read = [kind for kind in kinds if (kind.format, kind.suffix) == named and not kind.refused]
        cells = ["; ".join(k.what for k in read if k.within == within) for within in (EXACT, CLOSE, ROUGH)]
        rows.append(f"| {named[0]}, `{named[1]}` | {' | '.join(cells)} |".replace("|  |", "| |").replace("|  |", "| |"))
    rows += ["", "| refused | with the line |", "|---|---|"]
    rows += [f"| {k.format}, `{k.suffix}`: {k.what} | ... {k.refused} |" for k in kinds if k.refused]
    return _fill(page, rows)


def fill_studies(page: str) -> str:
    """The page on evaluation with its table of studies written anew."""
    rows = ["| NAME | what it tells |", "|---|---|"]
    for path in sorted((ROOT / "research" / "studies").glob("*.py")):
        if path.stem not in ("__init__", "common"):
            told = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
            rows.append(f"| `{path.stem}` | {' '.join(told.partition(chr(10) * 2)[0].split())} |")
    return _fill(page, rows)


def published_schema() -> dict[str, Any]:
    """A line of `--publish` in JSON, as a JSON schema."""
    results = {name: _or_null(kind) for name, kind in result_schema()["properties"].items()}
    for column in COLUMNS:
        if column.unit and column.name in results:
            results[column.name]["description"] = column.unit
    results["status"] = {"enum": [*FIXED_STATUS]}
    number = {"type": ["number", "null"]}
    head = {
        "version": {"const": VERSION},
        "sequence": {"type": "integer", "minimum": 1, "description": "of the line, by one more than of that before"},
        "stamp_s": {**number, "description": "Unix time at which the last image came, s"},
        "age_ms": {**number, "minimum": 0, "description": "from then until the line was sent, ms"},
        "may_close": {"type": "boolean", "description": "tracked, and nothing speaks against closing on the contacts"},
    }
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "A line of grasptrack --publish",
        "type": "object",
        "properties": {name: {**head, **results}[name] for name in (*head, *IN_JSON)},
        "required": [*head, *IN_JSON],
        "additionalProperties": False,
    }


def _or_null(kind: dict[str, Any]) -> dict[str, Any]:
    """A type that may be null, as its items may: a line without a frame has the same fields, and no number is infinite."""
    names = [kind["type"]] if isinstance(kind["type"], str) else kind["type"]
    items = {"items": _or_null(kind["items"])} if "items" in kind else {}
    return {**kind, "type": [*dict.fromkeys([*names, "null"])], **items}


def _fill(page: str, lines: list[str]) -> str:
    text = "\n".join(lines)
    return WITHIN.sub(lambda found: f"{found[1]}\n{text}\n\n{found[2]}", page)


def pages() -> dict[Path, str]:
    """Every written page, by its file."""
    trouble, files, sources = DOCS / "troubleshooting.md", DOCS / "files.md", DOCS / "sources.md"
    evaluation = DOCS / "evaluation.md"
    return {
        DOCS / "cli.md": command_line_page(),
        DOCS / "api.md": api_page(),
        DOCS / "published.schema.json": json.dumps(published_schema(), indent=1) + "\n",
        DOCS / "tables" / "scenes.md": scenes_table(),
        DOCS / "tables" / "numbers.md": numbers_table(),
        trouble: fill_reasons(trouble.read_text(encoding="utf-8")),
        files: fill_columns(files.read_text(encoding="utf-8")),
        sources: fill_formats(sources.read_text(encoding="utf-8")),
        evaluation: fill_studies(evaluation.read_text(encoding="utf-8")),
    }


if __name__ == "__main__":
    for path, text in pages().items():
        path.write_text(text, encoding="utf-8")
        print(path.relative_to(ROOT))

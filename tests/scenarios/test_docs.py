# SPDX-License-Identifier: Apache-2.0
"""The documentation says what is: names that exist, options and columns as they are, imports that go one way."""

import ast
import json
import re
from functools import cache
from importlib import import_module
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

import pytest

import house
import written_pages
from grasptrack.cli.main import main
from grasptrack.io.columns import csv_columns
from program import whole_program
from recordings import plates
from research.paper.dragging import data_of_page

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
ELSEWHERE = ("grasptrack_bench", "research", "reference")
"""Names of modules that are not below `grasptrack`."""
PAGES = (*sorted(str(path.relative_to(DOCS)) for path in DOCS.rglob("*.md")), "../README.md", "../CONTRIBUTING.md")
WORDS = 15_000
"""What people write in README, CONTRIBUTING and docs: what it takes two hours to read."""
PLUG_INS = ("cameras.pylon", "cameras.genicam", "cameras.realsense", "ros2", "recorders")
"""Modules of `io` that nothing imports by name."""
CV2 = {"demo", "images", "io", "nets", "segmentation", "snake", "trackability", "tracking", "undistortion", "view"}
"""Who may see with OpenCV."""


def text(page: str) -> str:
    return (DOCS / page).read_text(encoding="utf-8")


def quoted(page: str) -> list[str]:
    """What stands between backticks in running text and tables, not in blocks of code."""
    prose = re.sub(r"^```.*?^```", "", text(page), flags=re.MULTILINE | re.DOTALL)
    return re.findall(r"`([^`\n]+)`", prose)


def block(page: str, name: str) -> list[str]:
    """Lines of the block of code that is marked by a name."""
    found = re.search(rf"^```{name}\n(.*?)^```", text(page), flags=re.MULTILINE | re.DOTALL)
    assert found, f"{page} has no block {name}"
    return found[1].splitlines()


# --- names ---------------------------------------------------------------------------------------


@cache
def functions_of(module: str) -> set[str]:
    found = list((ROOT / "tests").glob(f"*/{module}.py"))
    tree = ast.parse("".join(path.read_text(encoding="utf-8") for path in found))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def exists(name: str) -> bool:
    """Whether a test (file::function), an object (module:name) or a path of the repository is there."""
    if "::" in name:
        module, function = name.split("::")
        return function in functions_of(module)
    if ":" in name:
        module, path = name.split(":")
        found: object = import_module(module if module.startswith(ELSEWHERE) else f"grasptrack.{module}")
        for part in path.split("."):
            fields = getattr(found, "__annotations__", {})
            if not hasattr(found, part) and part not in fields:
                return False
            found = getattr(found, part, None)
        return True
    return (ROOT / name).exists()


OBJECT = re.compile(r"[a-z_]+(\.[a-z_0-9]+)*:[A-Za-z_][\w.]*")
TEST = re.compile(r"test_\w+::test_\w+")
FILE = re.compile(r"[\w.-]+(/[\w.-]+)+\.(py|md|toml|hpp|cpp|pyi)|([\w-]+/)+")


@pytest.mark.parametrize("page", PAGES)
def test_every_name_in_the_documentation_exists(page: str) -> None:
    names = [n for n in quoted(page) if OBJECT.fullmatch(n) or TEST.fullmatch(n) or FILE.fullmatch(n)]
    assert [n for n in names if not exists(n)] == []


def test_the_paper_map_quotes_nothing_but_names_that_are_checked() -> None:
    names = quoted("paper-map.md")
    assert len(names) > 100
    assert [n for n in names if not (OBJECT.fullmatch(n) or TEST.fullmatch(n) or FILE.fullmatch(n))] == []


def anchors(page: Path) -> set[str]:
    """Of the headings of a page, as GitHub makes them."""
    heads = re.findall(r"^#+ (.*)$", page.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", head.lower()).replace(" ", "-") for head in heads}


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page: str) -> None:
    here = (DOCS / page).resolve()
    broken = []
    for path, anchor in re.findall(r"\]\(([^)#\s]*)(?:#([^)]*))?\)", text(page)):
        target = here.parent / path if path else here
        if not path.startswith("http") and not (target.exists() and (not anchor or anchor in anchors(target))):
            broken.append(f"{path}#{anchor}")
    assert broken == []


# --- what is written from the code ---------------------------------------------------------------


@pytest.mark.parametrize("path", written_pages.pages(), ids=lambda path: path.name)
def test_a_page_says_what_the_code_says(path: Path) -> None:
    written = path.read_text(encoding="utf-8")
    assert written == written_pages.pages()[path], f"{written_pages.COMMAND} writes another {path.name}: run it"


def test_the_outlines_that_a_reader_drags_are_the_built_in_ones() -> None:
    assert text("transfers-data.js") == data_of_page(), "python -m research.paper.dragging writes others: run it"


def test_every_verb_has_its_section() -> None:
    def below(command: object, name: str) -> set[str]:
        verbs = getattr(command, "commands", {})
        own = {name} if name and (not verbs or command.invoke_without_command) else set()  # type: ignore[attr-defined]
        return own.union(*(below(verb, f"{name} {word}".strip()) for word, verb in verbs.items()))

    assert set(written_pages.VERBS) == below(whole_program(), "")


def test_people_have_not_written_more_than_one_can_read() -> None:
    written = {"cli.md", "api.md"}
    count = 0
    for page in (p for p in PAGES if p not in written and not p.startswith("tables/")):
        own = written_pages.WITHIN.sub("", text(page))
        own = re.sub(r"<!-- table .*?<!-- end of table -->", "", own, flags=re.DOTALL)
        own = re.sub(r"<!--.*?-->|[|]|:?---:?", "", own, flags=re.DOTALL)
        count += len(own.split())
    assert count <= WORDS


# --- the site -------------------------------------------------------------------------------------


def test_the_site_leads_to_every_page() -> None:
    site = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    listed = re.findall(r"^ +- .+: ([\w/-]+\.md)$", site, re.MULTILINE)
    assert sorted(listed) == sorted([*PAGES[:-2], "CONTRIBUTING.md", "ros-packages.md"])


def test_a_notebook_is_shown_as_it_was_run_or_without_outputs(tmp_path: Path) -> None:
    spec = spec_from_file_location("site_pages", ROOT / ".ci" / "site_pages.py")
    assert spec and spec.loader
    site_pages = module_from_spec(spec)
    spec.loader.exec_module(site_pages)
    plain, run = tmp_path / "n.ipynb", tmp_path / "run.ipynb"
    cells = [
        {"cell_type": "markdown", "source": ["# Title\n", "[next](m.ipynb)"]},
        {"cell_type": "code", "source": ["1 + 1"], "outputs": []},
    ]
    plain.write_text(json.dumps({"cells": cells}))
    assert site_pages.notebook_page(plain, run)[0].count("Not run here") == 1
    told: list[object] = [
        {"output_type": "stream", "text": ["a\n", "b\n"]},
        {"output_type": "display_data", "data": {"image/png": "iVBORw==\n", "text/plain": ["<Figure>"]}},
        {"output_type": "execute_result", "data": {"text/plain": ["2"]}},
    ]
    run.write_text(json.dumps({"cells": [cells[0], {**cells[1], "outputs": told}]}))
    page, pictures = site_pages.notebook_page(plain, run)
    places = [page.index(part) for part in ("# Title\n[next](m.md)", "1 + 1", "a\nb\n", "](n-1.png)", "\n2\n")]
    assert places == sorted(places) and "Not run" not in page and pictures == {"n-1.png": b"\x89PNG"}
    plain.write_text(json.dumps({"cells": [cells[0], {**cells[1], "source": ["1 + 2"]}]}))
    page, pictures = site_pages.notebook_page(plain, run)
    assert "1 + 2" in page and "Not run here" in page and not pictures


def test_the_reference_has_every_public_name() -> None:
    import grasptrack

    named = re.findall(r"^- \[`(\w+)`\]", text("api.md"), re.MULTILINE)
    assert sorted([*named, "__version__"]) == sorted(grasptrack.__all__)


# --- files ----------------------------------------------------------------------------------------


def section(file: str) -> str:
    """What files.md says of one of them."""
    return text("files.md").split(f"\n## {file}\n")[1].split("\n## ")[0]


def test_columns_and_keys_are_those_that_are_written(tmp_path: Path) -> None:
    assert block("files.md", "csv") == [",".join(csv_columns(2))]
    given = ["track", str(plates(tmp_path / "in", 2)), "--output", str(tmp_path / "out"), "--quiet", "--no-video"]
    assert main(given) == 0
    keys = set(json.loads((tmp_path / "out" / "run.json").read_text()))
    told = set(re.findall(r"^\| `(\w+)` \|", section("run.json"), re.MULTILINE))
    assert told == keys | {"error", "shortfall", "recordings"}


def test_keys_of_grasps_json_are_those_that_are_written(tmp_path: Path) -> None:
    source = plates(tmp_path / "in", 1) / "000.png"
    assert main(["synthesize", str(source), "--output", str(tmp_path / "out"), "--quiet"]) == 0
    written = json.loads((tmp_path / "out" / "grasps.json").read_text())
    one = written["objects"][0]
    told = section("grasps.json")
    for head, keys in (("key", written), ("key of an object", one), ("key of a grasp", one["grasps"][0])):
        table = told.split(f"| {head} |")[1].split("\n\n")[0]
        first = re.findall(r"^\| (`[^|]+`) \|", table, re.MULTILINE)
        assert set(re.findall(r"`(\w+)`", " ".join(first))) == set(keys)


def test_the_evaluation_page_tells_of_what_is_there() -> None:
    from grasptrack_bench.records import EACH, FIXED, LAST

    each = [f"{name}{i}" for i in (1, 2) for name in EACH]
    assert block("evaluation.md", "records") == [",".join([*FIXED, *each, LAST])]


# --- imports -------------------------------------------------------------------------------------


def top(module: str) -> str:
    """The layer's name of a module: its first part below grasptrack."""
    return module.split(".")[0]


def modules() -> dict[str, house.Module]:
    return {name.partition(".")[2]: m for name, m in house.modules().items() if name.split(".")[0] == "grasptrack"}


@cache
def imported(module: house.Module) -> set[str]:
    """Everything that a file imports when it runs, at once or late; what only a type checker reads is left out."""
    names: set[str] = set()

    def visit(node: ast.AST) -> None:
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.dump(child.test):
                for other in child.orelse:
                    visit(other)
                continue
            if isinstance(child, ast.Import):
                names.update(a.name for a in child.names)
            elif isinstance(child, ast.ImportFrom) and child.module:
                assert child.level == 0, f"{module.path}: relative import"
                names.update(f"{child.module}.{a.name}" for a in child.names)
            visit(child)

    visit(module.tree)
    return names


@cache
def graph() -> dict[str, set[str]]:
    """For each module of the package the modules of the package that it imports, names below `grasptrack`."""
    known = modules()
    out: dict[str, set[str]] = {}
    for module, source in known.items():
        below = {n.removeprefix("grasptrack").lstrip(".") for n in imported(source) if n.split(".")[0] == "grasptrack"}
        out[module] = {n if n in known else n.rpartition(".")[0] for n in below if n}
    return out


def layers() -> dict[str, int]:
    """Rank of each top name, from the block in design.md."""
    ranks: dict[str, int] = {}
    for rank, line in enumerate(block("design.md", "layers")):
        for name in line.split("|")[0].split(","):
            assert name.strip() not in ranks
            ranks[name.strip()] = rank
    return ranks


def test_the_design_names_every_module() -> None:
    here = {top(m) for m in modules() if m}
    assert here == set(layers())


def test_imports_go_one_way() -> None:
    rank = layers()
    against = [
        f"{module} imports {other or 'grasptrack'}"
        for module, others in graph().items()
        for other in others
        if module and top(other) != top(module) and not (other and rank[top(other)] < rank[top(module)])
    ]
    assert against == []


@pytest.mark.parametrize(
    ("package", "homes"),
    [
        ("typer", {"cli"}),
        ("rich", {"cli"}),
        ("starlette", {"live"}),
        ("uvicorn", {"live"}),
        ("grasptrack.live", {"live", "cli"}),
        ("av", {"io"}),
        ("matplotlib", {"view"}),
        ("cv2", CV2),
        ("grasptrack.snake", {"snake", "tracking"}),
        ("_grasptrack_native", {"kernels"}),
        *((f"grasptrack.io.{name}", set()) for name in PLUG_INS),
    ],
)
def test_who_may_import_what(package: str, homes: set[str]) -> None:
    users = {
        top(module)
        for module, source in modules().items()
        if any(f"{n}.".startswith(f"{package}.") for n in imported(source))
    }
    assert users <= homes

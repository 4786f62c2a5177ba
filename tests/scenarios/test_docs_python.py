# SPDX-License-Identifier: Apache-2.0
"""Each Python block of README and docs runs as it stands, and it and the examples pass a type checker."""

from __future__ import annotations

import ast
import builtins
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


def blocks() -> dict[str, str]:
    """Each block by page and number."""
    found = {}
    for page in PAGES:
        marked = re.findall(r"^```python\n(.*?)^```", page.read_text(encoding="utf-8"), re.MULTILINE | re.DOTALL)
        found |= {f"{page.stem}_{i}": code for i, code in enumerate(marked, start=1)}
    return found


def complete(code: str) -> str:
    """A block with imports of the names that the page takes as given."""
    nodes = list(ast.walk(ast.parse(code)))
    names = [node for node in nodes if isinstance(node, ast.Name)]
    imported = {
        a.asname or a.name for node in nodes if isinstance(node, ast.Import | ast.ImportFrom) for a in node.names
    }
    made = {n.id for n in names if isinstance(n.ctx, ast.Store)} | imported | set(dir(builtins))
    given = sorted({n.id for n in names if isinstance(n.ctx, ast.Load)} - made - {"gt"})
    first = [] if "import grasptrack as gt" in code else ["import grasptrack as gt"]
    return "\n".join([*first, *([f"from documented_world import {', '.join(given)}"] if given else []), code])


@pytest.mark.parametrize("name", blocks())
def test_each_block_runs(name: str, tmp_path: Path) -> None:
    from documented_world import write_video

    write_video(tmp_path / "video.mp4")
    (tmp_path / "block.py").write_text(complete(blocks()[name]))
    environment = {"PYTHONPATH": str(ROOT / "tests" / "helpers"), "PATH": "/usr/bin:/bin"}
    run = [sys.executable, "block.py"]
    done = subprocess.run(run, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout, "a block that shows nothing"
    assert "lost" not in done.stdout and "failed" not in done.stdout


@pytest.mark.slow
def test_blocks_and_examples_pass_pyright(tmp_path: Path) -> None:
    pytest.importorskip("basedpyright")
    for name, code in blocks().items():
        (tmp_path / f"{name}.py").write_text(complete(code))
    paths = [str(ROOT / "src"), str(ROOT / "tests" / "helpers"), str(ROOT / "examples")]
    strict = [str(path) for path in (ROOT / "examples").glob("*.py")]
    settings = {
        "typeCheckingMode": "standard",
        "extraPaths": paths,
        "reportMissingModuleSource": False,
        "strict": strict,
    }
    (tmp_path / "pyrightconfig.json").write_text(
        json.dumps({**settings, "include": [str(tmp_path), str(ROOT / "examples")]})
    )
    run = [sys.executable, "-m", "basedpyright", "--project", str(tmp_path), "--level", "error"]
    run += ["--pythonpath", sys.executable]
    done = subprocess.run(run, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout

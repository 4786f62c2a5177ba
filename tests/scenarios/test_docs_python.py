# SPDX-License-Identifier: Apache-2.0
"""Each Python block of README and docs runs as it stands, and it and the examples pass a type checker."""

import ast
import builtins
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


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


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", blocks())
def test_each_block_runs(name: str, tmp_path: Path) -> None:
    from documented_world import write_video

    write_video(tmp_path / "video.mp4")
    (tmp_path / "block.py").write_text(complete(blocks()[name]))
    given = {"PYTHONPATH": str(ROOT / "tests" / "helpers"), "PATH": "/usr/bin:/bin", "OPENBLAS_NUM_THREADS": "1"}
    run = [sys.executable, "block.py"]
    done = subprocess.run(run, cwd=tmp_path, env=given, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout, "a block that shows nothing"
    assert "lost" not in done.stdout and "failed" not in done.stdout


NARROWED = """# pyright: strict, reportUnnecessaryTypeIgnoreComment=true
import numpy as np
from numpy.typing import NDArray
from typing_extensions import assert_type

import grasptrack as gt
from grasptrack.tracking.result import LocatedResult, UnlocatedResult

tracker = gt.GraspTracker(strategy="auto")
gt.GraspTracker(strategy="of-another-package")
result = tracker.update(np.zeros((480, 640), np.uint8))
assert_type(result, LocatedResult | UnlocatedResult)
if result.status == "tracked":
    assert_type(result.contacts, NDArray[np.float64])
    assert_type(result.analysis, gt.GraspAnalysis)
elif result.status == "lost":
    assert_type(result.contacts, None)
if result.located is True:
    assert_type(result.contacts, NDArray[np.float64])
if result.contacts is not None:
    assert_type(result.view, gt.View)
kept: gt.TrackResult = result
status: gt.Status = kept.status
if status == "trakced":  # pyright: ignore[reportUnnecessaryComparison]
    pass
ring = np.zeros((9, 2))
assert_type(gt.synthesize(ring, neighbours=[ring, [[0.0, 1.0]]]), gt.GraspList)
assert_type(gt.transfer(gt.Grasp(ring), ring, [[0.0, 1.0]], "rrp"), gt.Transfer)
assert_type(gt.analyze(gt.Grasp(ring), ring), gt.GraspAnalysis)
gt.synthesize(None)  # pyright: ignore[reportArgumentType]
"""
"""What type checkers learn; where a comment says so, that something is wrong."""


@pytest.mark.slow
def test_blocks_and_examples_pass_pyright(tmp_path: Path) -> None:
    pytest.importorskip("basedpyright")
    for name, code in blocks().items():
        (tmp_path / f"{name}.py").write_text(complete(code))
    paths = [str(ROOT / "src"), str(ROOT / "tests" / "helpers"), str(ROOT / "examples")]
    (tmp_path / "narrowed.py").write_text(NARROWED)
    settings = {"typeCheckingMode": "standard", "extraPaths": paths, "reportMissingModuleSource": False}
    examples = str(ROOT / "examples")
    strict = [str(path) for path in (ROOT / "examples").glob("*.py")]
    config = {**settings, "include": [str(tmp_path), examples], "strict": strict}
    (tmp_path / "pyrightconfig.json").write_text(json.dumps(config))
    run = [sys.executable, "-m", "basedpyright", "--project", str(tmp_path), "--level", "error"]
    run += ["--pythonpath", sys.executable]
    done = subprocess.run(run, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout

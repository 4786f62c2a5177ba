# SPDX-License-Identifier: Apache-2.0
"""`grasptrack doctor` tells what is there, what is missing, and what is wrong."""

import importlib.metadata as metadata
import json
import re
import shlex
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import pytest

import grasptrack
from grasptrack import kernels
from grasptrack.cli import support
from grasptrack.cli.main import main
from grasptrack.errors import bench_hint, install_hint

BESIDE = {"dev", "all", "docs"}


def test_every_extra_is_told_with_what_it_is_for() -> None:
    assert set(support.extra_requirements()) - BESIDE <= set(support.EXTRAS)
    assert [f.name for f in support.examine_extras()] == list(support.EXTRAS)


def test_it_names_versions_and_ends_with_the_status_of_what_is_wrong(capsys: pytest.CaptureFixture[str]) -> None:
    status = main(["doctor"])
    out = capsys.readouterr().out
    assert cv2.__version__ in out and metadata.version("grasptrack") in out and kernels.BACKEND in out
    assert status == (1 if "!!" in out else 0)


def test_what_an_extra_lacks_is_named_with_this_environments_pip(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(support, "version_of", lambda package: "")
    findings = {f.name: f for f in support.examine_extras()}
    assert findings["sim"].mark == "--"
    assert f"{install_hint('sim')} adds mujoco" in findings["sim"].text


COPY = Path(__file__).resolve().parents[2]
GONE = "file:///no/such/copy"


@pytest.mark.parametrize(
    ("noted", "words"),
    [
        (None, ["grasptrack[sim]"]),
        ({"url": COPY.as_uri(), "dir_info": {}}, [f"{COPY}[sim]"]),
        ({"url": COPY.as_uri(), "dir_info": {"editable": True}}, ["-e", f"{COPY}[sim]"]),
        ({"url": GONE, "dir_info": {}}, [".[sim]", "in", "a", "copy", "of", "the", "repository"]),
        ({"url": "file:///a/b.whl", "archive_info": {}}, ["grasptrack[sim] @ file:///a/b.whl"]),
        (
            {"url": "https://example.org/g", "vcs_info": {"vcs": "git", "commit_id": "abc"}},
            ["grasptrack[sim] @ git+https://example.org/g@abc"],
        ),
    ],
)
def test_an_extra_comes_from_where_the_program_came(
    monkeypatch: pytest.MonkeyPatch, noted: dict[str, Any] | None, words: list[str]
) -> None:
    """As PEP 610 notes it; whatever pip is asked for is a requirement by PEP 508, or a folder that is there."""
    told = SimpleNamespace(read_text=lambda name: None if noted is None else json.dumps(noted))
    monkeypatch.setattr(metadata, "distribution", lambda name: told)
    assert shlex.split(install_hint("sim")) == [sys.executable, "-m", "pip", "install", *words]
    folder = str(COPY / "bench") if COPY.as_uri() in str(noted) else "./bench"
    assert folder in shlex.split(bench_hint("sim"))


def test_no_page_names_an_index_that_does_not_have_it() -> None:
    pages = [*COPY.glob("*.md"), *(COPY / "docs").rglob("*.md"), *COPY.glob("ros/*.md"), *COPY.glob("bench/*.md")]
    assert [page for page in pages if re.search(r"install .*\bgrasptrack\[", page.read_text(encoding="utf-8"))] == []


def test_alone_it_says_three_steps_and_what_they_lack(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([]) == 0
    steps = re.findall(r"^  (grasptrack .*?)  ", capsys.readouterr().out, re.MULTILINE)
    assert [step.split()[1] for step in steps] == ["demo", "track", "live"]
    monkeypatch.setattr(support, "version_of", lambda package: "")
    assert main([]) == 0 and install_hint("live") in capsys.readouterr().out


def test_kernels_that_cannot_be_loaded_are_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    found = next(f for f in support.examine_program() if f.name == "grasptrack")
    assert (found.mark, kernels.BUILD in found.text) == ("ok", True)
    monkeypatch.setitem(sys.modules, "_grasptrack_native", None)
    monkeypatch.delitem(sys.modules, "grasptrack.kernels")
    monkeypatch.delattr(grasptrack, "kernels")
    found = next(f for f in support.examine_program() if f.name == "grasptrack")
    assert (found.mark, "C++17" in found.text) == ("!!", True)


def test_two_builds_of_opencv_are_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(support, "version_of", lambda package: "4.10" if package.startswith("opencv-python") else "1")
    found = next(f for f in support.examine_program() if f.name == "OpenCV")
    assert found.mark == "!!" and "uninstall opencv-python-headless opencv-python" in found.text


def test_a_camera_without_permission_is_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Path, "glob", lambda self, pattern: iter([Path("/dev/video7")]))
    monkeypatch.setattr("os.access", lambda path, mode: False)
    first = next(support.examine_cameras())
    assert first.mark == "!!" and first.name == "/dev/video7" and "group video" in first.text

# SPDX-License-Identifier: Apache-2.0
"""`grasptrack doctor` tells what is there, what is missing, and what is wrong."""

import importlib.metadata as metadata
import sys
from pathlib import Path

import cv2
import pytest

import grasptrack
from grasptrack import kernels
from grasptrack.cli import support
from grasptrack.cli.main import main

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
    assert f'{sys.executable} -m pip install "grasptrack[sim]" adds mujoco' in findings["sim"].text


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

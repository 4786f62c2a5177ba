# SPDX-License-Identifier: Apache-2.0
"""Modules under their former names are those of today, and say so."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module

import pytest

from grasptrack._aliases import MOVED


@pytest.mark.parametrize("old", sorted(MOVED))
def test_a_former_name_is_the_module_of_today(old: str) -> None:
    sys.modules.pop(f"grasptrack.{old}", None)
    with pytest.warns(DeprecationWarning, match=f"grasptrack.{MOVED[old]}"):
        module = import_module(f"grasptrack.{old}")
    today = import_module(f"grasptrack.{MOVED[old]}")
    assert module is today and today.__spec__ is not None and today.__spec__.name == today.__name__


def test_objects_under_former_names_are_those_of_today() -> None:
    code = "from grasptrack.contour import Contour; from grasptrack.synthesis.result import GraspList; "
    code += "import grasptrack as gt; assert Contour is gt.Contour and GraspList is gt.GraspList"
    subprocess.run([sys.executable, "-W", "ignore::DeprecationWarning", "-c", code], check=True)


def test_what_never_was_is_not_found() -> None:
    with pytest.raises(ModuleNotFoundError, match=r"grasptrack\.whatever"):
        import_module("grasptrack.whatever")

# SPDX-License-Identifier: Apache-2.0
"""Makes helpers and oracles importable, and the tests that others build upon."""

import importlib
import os
import sys
from pathlib import Path
from types import ModuleType

import pytest

FOLDERS = ("helpers", "oracle", "laws", "scenarios", "slow", "fuzz")
sys.path[:0] = [str(Path(__file__).parent / name) for name in FOLDERS]
sys.path.append(str(Path(__file__).parents[1]))  # of research


@pytest.fixture(scope="session")
def native() -> ModuleType:
    """The compiled kernels; a test that needs them fails where nothing was compiled."""
    if os.environ.get("GRASPTRACK_BACKEND") == "numpy":
        pytest.skip("GRASPTRACK_BACKEND=numpy: no compiled kernels are asked for")
    return importlib.import_module("_grasptrack_native")

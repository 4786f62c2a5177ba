# SPDX-License-Identifier: Apache-2.0
"""Makes the helpers beside the tests importable."""

import importlib
import os
import sys
from pathlib import Path
from types import ModuleType

import pytest

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="session")
def native() -> ModuleType:
    """The compiled kernels; a test that needs them fails where nothing was compiled."""
    if os.environ.get("GRASPTRACK_BACKEND") == "numpy":
        pytest.skip("GRASPTRACK_BACKEND=numpy: no compiled kernels are asked for")
    return importlib.import_module("_grasptrack_native")

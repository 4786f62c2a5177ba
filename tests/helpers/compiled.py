# SPDX-License-Identifier: Apache-2.0
"""The compiled kernels, for tests that hold them to their definitions: these fail where nothing was compiled."""

import os

import pytest

if os.environ.get("GRASPTRACK_BACKEND") == "numpy":
    pytest.skip("GRASPTRACK_BACKEND=numpy: no compiled kernels are asked for", allow_module_level=True)

import _grasptrack_native as native

__all__ = ["native"]

# SPDX-License-Identifier: Apache-2.0
"""MuJoCo, imported where it is first needed."""

from __future__ import annotations

import os
import sys
from typing import Any

from grasptrack.errors import InputError


def import_mujoco() -> Any:
    """MuJoCo, drawing through EGL where the user did not choose otherwise and there is no screen.

    Raises:
        InputError: it is not installed.
    """
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        os.environ.setdefault("MUJOCO_GL", "egl")
    try:
        import mujoco
    except ImportError:
        raise InputError('the physical world needs MuJoCo: pip install "grasptrack[sim]"') from None
    return mujoco

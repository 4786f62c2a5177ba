# SPDX-License-Identifier: Apache-2.0
"""The arithmetic of every frame, compiled: the functions and numbers of `_grasptrack_native`, whose stub says what each is.

`BACKEND` names them in what is written of a run, `BUILD` their ABI and their compiler.
"""

from __future__ import annotations

from typing import Final

from grasptrack.errors import without_kernels

try:  # the functions themselves, not wrappers: a call costs a third of a microsecond
    import _grasptrack_native as _native
    from _grasptrack_native import *  # noqa: F403
except ImportError as error:
    raise without_kernels(str(error)) from None

BACKEND: Final = "native"
BUILD: Final[str] = _native._build

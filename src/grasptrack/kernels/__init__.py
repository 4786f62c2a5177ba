# SPDX-License-Identifier: Apache-2.0
"""The arithmetic of every frame: compiled where it could be compiled, NumPy elsewhere, of the same names.

`BACKEND` is "native" or "numpy"; `BUILD` names the ABI and the compiler of the native one. GRASPTRACK_BACKEND=numpy in the
environment asks for NumPy. What each kernel computes
is said in `grasptrack.kernels.reference`, the `__all__` of whose modules is the one table of their names.
"""

from __future__ import annotations

import os
import warnings
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any, Literal

from grasptrack.errors import own_pip

BACKEND: Literal["native", "numpy"]
BUILD: str

if TYPE_CHECKING:
    from grasptrack.kernels.reference import *  # noqa: F403
else:

    def _load_kernels() -> ModuleType:
        if os.environ.get("GRASPTRACK_BACKEND") != "numpy":
            try:
                return import_module("_grasptrack_native")
            except ImportError as error:
                warnings.warn(
                    f"grasptrack runs without its compiled kernels ({error}): NumPy takes their place, many times slower. "
                    "To compile them install a C++17 compiler, then install grasptrack again from its source "
                    f"({own_pip()} install --force-reinstall --no-binary grasptrack grasptrack, "
                    "or make .venv/.package in a clone). "
                    "GRASPTRACK_BACKEND=numpy asks for NumPy, without this warning.",
                    RuntimeWarning,
                    stacklevel=3,
                )
        return import_module("grasptrack.kernels.reference")

    # The functions themselves, not wrappers: a call costs a third of a microsecond.
    _loaded = _load_kernels()
    BACKEND = "native" if _loaded.__name__ == "_grasptrack_native" else "numpy"
    BUILD = getattr(_loaded, "_build", "")
    _names = getattr(_loaded, "__all__", [name for name in vars(_loaded) if not name.startswith("_")])
    globals().update({name: getattr(_loaded, name) for name in _names})
    __all__ = ["BACKEND", *sorted(_names)]

    def __getattr__(name: str) -> Any:
        hint = "; were the compiled kernels built before it was added?" if BACKEND == "native" else ""
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}{hint}")

# SPDX-License-Identifier: Apache-2.0
"""What was found, as small files that anybody can read, and played again."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from contour_trials import Pair
from grasptrack.kernels import results
from kernel_calls import Call

FOLDER = Path(__file__).parent / "corpus"
LARGEST = 64 * 1024
"""Bytes of a file; what needs more is told by its seed and number alone."""


def write_case(case: Call | Pair, name: str, folder: Path = FOLDER) -> Path | None:
    """Keep a case under a name; None where it is too large, or holds what no file can."""
    kind, fields = ("call", case) if isinstance(case, Call) else ("pair", case)
    try:
        text = json.dumps({"kind": kind, **{key: _encoded(value) for key, value in fields._asdict().items()}})
    except TypeError:
        return None
    if len(text) > LARGEST:
        return None
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.json"
    path.write_text(text + "\n", encoding="utf-8")
    return path


def read_case(path: Path) -> Call | Pair:
    """A case as it was kept."""
    fields = json.loads(path.read_text(encoding="utf-8"))
    kind = fields.pop("kind")
    return (Call if kind == "call" else Pair)(**{key: _decoded(value) for key, value in fields.items()})


def _encoded(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in "fiub":
            raise TypeError(f"no file holds {value.dtype}")
        return {"array": value.ravel().tolist(), "dtype": str(value.dtype), "shape": value.shape}
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return {"record": type(value).__name__, "items": [_encoded(item) for item in value]}
    if isinstance(value, tuple):
        return {"tuple": [_encoded(item) for item in value]}
    if isinstance(value, dict):
        return {"dict": {key: _encoded(item) for key, item in value.items()}}
    if isinstance(value, list):
        return [_encoded(item) for item in value]
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    raise TypeError(f"no file holds {type(value)}")


def _decoded(value: Any) -> Any:
    if isinstance(value, list):
        return [_decoded(item) for item in value]
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return np.array(value["array"], dtype=value["dtype"]).reshape(value["shape"])
    if "record" in value:
        return getattr(results, value["record"])(*_decoded(value["items"]))
    if "tuple" in value:
        return tuple(_decoded(value["tuple"]))
    return {key: _decoded(item) for key, item in value["dict"].items()}

# SPDX-License-Identifier: Apache-2.0
"""What a result depends on besides its task: the code itself. Results of different code are never mixed."""

from __future__ import annotations

import hashlib
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np

import grasptrack


@lru_cache
def code_fingerprint() -> str:
    """Hexadecimal digest of this package's sources, its compiled kernels, and the versions of NumPy and OpenCV."""
    import cv2

    digest = hashlib.sha256(f"{np.__version__} {cv2.__version__}".encode())
    root = Path(grasptrack.__file__).parent
    for path in sorted(root.rglob("*.py")):
        digest.update(str(path.relative_to(root)).encode())
        digest.update(path.read_bytes())
    native = find_spec("_grasptrack_native")
    if native is not None and native.origin is not None:
        digest.update(Path(native.origin).read_bytes())
    return digest.hexdigest()

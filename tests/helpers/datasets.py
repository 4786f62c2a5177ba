# SPDX-License-Identifier: Apache-2.0
"""Where real images and silhouettes are, which are no part of the repository."""

import os
from pathlib import Path

DATA = Path(os.environ.get("GRASPTRACK_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
SILHOUETTES = DATA / "silhouettes"

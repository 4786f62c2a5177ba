# SPDX-License-Identifier: Apache-2.0
"""Makes the helpers, and the tests that others build upon, importable."""

import sys
from pathlib import Path

FOLDERS = ("helpers", "laws", "scenarios", "slow")
sys.path[:0] = [str(Path(__file__).parent / name) for name in FOLDERS]

# SPDX-License-Identifier: Apache-2.0
"""Makes helpers and oracles importable, and the tests that others build upon."""

import sys
from pathlib import Path

FOLDERS = ("helpers", "oracle", "laws", "scenarios", "slow", "fuzz")
sys.path[:0] = [str(Path(__file__).parent / name) for name in FOLDERS]
sys.path.append(str(Path(__file__).parents[1]))  # of research

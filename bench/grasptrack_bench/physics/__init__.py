# SPDX-License-Identifier: Apache-2.0
"""A physical world: a flat part on a table, and a hand that can take it. Needs the extra `sim`."""

from grasptrack_bench.physics.setting import ARMS, SCENARIOS
from grasptrack_bench.physics.world import World

__all__ = ["ARMS", "SCENARIOS", "World"]

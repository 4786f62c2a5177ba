# SPDX-License-Identifier: Apache-2.0
"""What `grasptrack demo` and the examples show: small rendered scenes whose truth is known."""

from grasptrack.demo.run import STRATEGIES, run_demo
from grasptrack.demo.scene import DemoFrame, DemoScene, demo_scene, still_life

__all__ = ["STRATEGIES", "DemoFrame", "DemoScene", "demo_scene", "run_demo", "still_life"]

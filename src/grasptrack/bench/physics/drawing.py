# SPDX-License-Identifier: Apache-2.0
"""Who draws the images of a world."""

from __future__ import annotations

from typing import Literal

from grasptrack.bench.physics.gripper import Gripper
from grasptrack.bench.physics.images import Images
from grasptrack.bench.physics.offscreen import MujocoImages, offscreen_error
from grasptrack.bench.physics.planar import PlanarImages
from grasptrack.bench.physics.setting import Setting
from grasptrack.bench.simulation.appearance import sample_look
from grasptrack.errors import InputError


def images_of(
    kind: Literal["auto", "mujoco", "planar"], setting: Setting, hand: Gripper, name: str, seed: int
) -> Images:
    """Who draws.

    Raises:
        InputError: an unknown kind, or MuJoCo is asked to draw and offscreen OpenGL is missing.
    """
    if kind not in ("auto", "mujoco", "planar"):
        raise InputError(f'unknown images "{kind}"; choose from auto, mujoco, planar', images=kind)
    seen = sample_look(name, seed)
    if kind != "planar":
        why = offscreen_error()
        if not why:
            return MujocoImages(setting, seen, seed)
        if kind == "mujoco":
            raise InputError(f"MuJoCo cannot draw here: {why}; MUJOCO_GL=egl or osmesa chooses how, planar needs none")
    return PlanarImages(setting, hand, seen, seed)

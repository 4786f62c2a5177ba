# SPDX-License-Identifier: Apache-2.0
"""Who draws the images of a world."""

from __future__ import annotations

from typing import Literal

from grasptrack.errors import InputError
from grasptrack.simulation.looks import look
from grasptrack.simulation.physical.gripper import Gripper
from grasptrack.simulation.physical.images import Images
from grasptrack.simulation.physical.offscreen import MujocoImages, offscreen
from grasptrack.simulation.physical.planar import PlanarImages
from grasptrack.simulation.physical.setting import Setting


def images_of(
    kind: Literal["auto", "mujoco", "planar"], setting: Setting, hand: Gripper, name: str, seed: int
) -> Images:
    """Who draws.

    Raises:
        InputError: an unknown kind, or MuJoCo is asked to draw and offscreen OpenGL is missing.
    """
    if kind not in ("auto", "mujoco", "planar"):
        raise InputError(f'unknown images "{kind}"; choose from auto, mujoco, planar', images=kind)
    seen = look(name, seed)
    if kind != "planar":
        why = offscreen()
        if not why:
            return MujocoImages(setting, seen, seed)
        if kind == "mujoco":
            raise InputError(f"MuJoCo cannot draw here: {why}; MUJOCO_GL=egl or osmesa chooses how, planar needs none")
    return PlanarImages(setting, hand, seen, seed)

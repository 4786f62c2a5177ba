# SPDX-License-Identifier: Apache-2.0
"""Images drawn by MuJoCo, where offscreen OpenGL can be had."""

from __future__ import annotations

import warnings
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.bench.physics import frames
from grasptrack.bench.physics.engine import import_mujoco
from grasptrack.bench.physics.images import add_camera_noise, blocked_view, bystander_pose, frame_number, hand_level
from grasptrack.bench.physics.setting import HEIGHT, WIDTH, Setting
from grasptrack.bench.simulation.appearance import Look
from grasptrack.typing import Pixels

if TYPE_CHECKING:
    from grasptrack.bench.physics.world import World


_TEXTURE = "table.png"


@lru_cache(maxsize=1)
def offscreen_error() -> str:
    """Empty where MuJoCo can draw without a window, else why not."""
    mujoco = import_mujoco()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            mujoco.Renderer(mujoco.MjModel.from_xml_string("<mujoco/>"), 8, 8).close()
    except Exception as error:  # whatever a missing driver makes of it
        return " ".join(str(error).split()) or type(error).__name__
    return ""


class MujocoImages:
    """Draws by OpenGL; see `Images`."""

    def __init__(self, setting: Setting, seen: Look, seed: int) -> None:
        self.levels = {"table": seen.table_level, "part": seen.surface_level, "hand": hand_level(seen)}
        self._blocked_seed = seed
        found, data = cv2.imencode(".png", seen.table.coloured.image)
        self.texture = _TEXTURE if found else ""
        self.assets = {_TEXTURE: data.tobytes()} if found else {}
        self._renderer: Any = None
        self._segments: Any = None
        self._model: Any = None

    def bind(self, model: Any) -> None:
        """Learn the model."""
        self._model = model

    def _render_camera(self, world: World, camera: str) -> Pixels:
        if self._renderer is None:
            self._renderer = import_mujoco().Renderer(self._model, HEIGHT, WIDTH)
        self._renderer.update_scene(world.data, camera=camera)
        return np.asarray(self._renderer.render(), dtype=np.uint8)

    def hand(self, world: World) -> Pixels:
        """(480, 640) grey, of the hand's camera."""
        frame = frame_number(world)
        if world.blocked():
            return blocked_view(self._blocked_seed, frame)
        grey = cv2.cvtColor(self._render_camera(world, "hand"), cv2.COLOR_RGB2GRAY)
        soft = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), 0.6)
        return add_camera_noise(np.asarray(soft, dtype=np.float32), self._blocked_seed, frame)

    def bystander(self, world: World) -> Pixels:
        """(480, 640, 3) BGR, of the one who stands beside."""
        at = bystander_pose(world)
        world.data.mocap_pos[0] = at[:3, 3]
        world.data.mocap_quat[0] = frames.rotation_to_quaternion(at[:3, :3] @ frames.DOWN)
        import_mujoco().mj_camlight(self._model, world.data)
        import_mujoco().mj_kinematics(self._model, world.data)
        import_mujoco().mj_camlight(self._model, world.data)
        return np.asarray(cv2.cvtColor(self._render_camera(world, "bystander"), cv2.COLOR_RGB2BGR), dtype=np.uint8)

    def part_mask(self, world: World) -> NDArray[np.bool_]:
        """(480, 640) where MuJoCo draws the part, pixel by pixel; for comparing with the planar images."""
        if self._segments is None:
            self._segments = import_mujoco().Renderer(self._model, HEIGHT, WIDTH)
            self._segments.enable_segmentation_rendering()
        self._segments.update_scene(world.data, camera="hand")
        found = self._segments.render()
        pieces = np.flatnonzero(self._model.geom_bodyid == self._model.body("part").id)
        return np.asarray(np.isin(found[..., 0], pieces) & (found[..., 1] == int(import_mujoco().mjtObj.mjOBJ_GEOM)))

# SPDX-License-Identifier: Apache-2.0
"""Images without OpenGL: table and part are planes under homographies, the hand is boxes. As exact as the outlines."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.bench.physics import frames
from grasptrack.bench.physics.gripper import Gripper
from grasptrack.bench.physics.images import (
    BYSTANDER,
    add_camera_noise,
    blocked_view,
    bystander_pose,
    frame_number,
    hand_level,
)
from grasptrack.bench.physics.setting import HEIGHT, WIDTH, Setting
from grasptrack.bench.simulation.appearance import Look
from grasptrack.bench.simulation.render import Renderer
from grasptrack.bench.simulation.texture import Texture
from grasptrack.typing import Floats, Pixels

if TYPE_CHECKING:
    from grasptrack.bench.physics.world import World

Floats32 = NDArray[np.float32]

BLUR = 0.7
"""px, of lens and pixel together."""
_SUN = np.array([-0.35, -0.45, 0.82])
_ROUND = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
_CIRCLE: Floats = np.column_stack([np.cos(_ROUND), np.sin(_ROUND)])
_FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))


class PlanarImages:
    """Draws by homographies.

    Args:
        setting, hand: what is drawn.
        seen: textures of table and part.
        seed: of the noise.
    """

    def __init__(self, setting: Setting, hand: Gripper, seen: Look, seed: int) -> None:
        self.levels = {"table": seen.table_level, "part": seen.surface_level, "hand": hand_level(seen)}
        self.texture, self.assets = "", dict[str, bytes]()
        self._setting, self._gripper, self._seed = setting, hand, seed
        size = setting.part.size
        table = Texture(seen.table.image, seen.table.extent * size)
        surface = Texture(seen.surface.image, seen.surface.extent * size)
        self._views = [
            Renderer(setting.part.shape, table, surface, width=WIDTH, height=HEIGHT, blur=BLUR, colour=colour)
            for colour in (False, True)
        ]
        self._layer: tuple[float, Floats32, Floats32] | None = None

    def bind(self, model: Any) -> None:
        """Nothing is needed of the model."""

    def hand(self, world: World) -> Pixels:
        """(480, 640) grey, of the hand's camera."""
        frame = frame_number(world)
        if world.blocked():
            return blocked_view(self._seed, frame)
        image = self._render_scene(world, self._views[0], self._setting.camera.matrix, world.camera_pose())
        opening = round(world.opening(), 4)
        if self._layer is None or self._layer[0] != opening:
            boxes = self._gripper.boxes(opening)
            drawn = boxes_seen(
                boxes, frames.invert_pose(self._setting.mount), self._setting.camera.matrix, self.levels["hand"]
            )
            self._layer = (opening, *drawn)
        _, share, light = self._layer
        image *= 1.0 - share
        image += light
        return add_camera_noise(image, self._seed, frame)

    def bystander(self, world: World) -> Pixels:
        """(480, 640, 3) BGR, of the one who stands beside."""
        at = bystander_pose(world)
        image = self._render_scene(world, self._views[1], BYSTANDER.matrix, at)
        to_camera, K, level = frames.invert_pose(at), BYSTANDER.matrix, self.levels["hand"]
        for share, light in (
            rods_seen(world.links(), to_camera, K, level),  # the hand hangs below them
            boxes_seen(self._gripper.boxes(world.opening()), to_camera @ world.pose(), K, level),
        ):
            image *= 1.0 - share[..., None]
            image += light[..., None] * np.array([1.06, 1.0, 0.92], np.float32)
        return np.clip(np.rint(image), 0, 255).astype(np.uint8)

    def _render_scene(self, world: World, view: Renderer, K: Floats, camera_pose: Floats) -> Floats32:
        table = np.eye(4)
        table[:2, 3] = world.belt_travel()
        image = view.ground(frames.plane_to_image(K, camera_pose, table))
        part = world.part_pose()
        upper = frames.plane_to_image(K, camera_pose, part, self._setting.part.thickness)
        view.lay(image, upper, foot=frames.plane_to_image(K, camera_pose, part))
        return image


def boxes_seen(boxes: list[Floats], to_camera: Floats, K: Floats, level: float) -> tuple[Floats32, Floats32]:
    """What boxes cover of an image, and that share times their grey level; both (480, 640). The farther faces are drawn first.

    Args:
        boxes: (8, 3) corners each.
        to_camera: (4, 4) from their frame to the camera's.
        K: (3, 3) of the camera.
        level: mean grey level; faces differ by their direction.
    """
    faces: list[tuple[float, float, Floats]] = []
    for box in boxes:
        corners = box @ to_camera[:3, :3].T + to_camera[:3, 3]
        if corners[:, 2].min() < frames.NEAR:
            continue
        middle = corners.mean(axis=0)
        for face in _FACES:
            quad = corners[list(face)]
            normal = np.cross(quad[1] - quad[0], quad[2] - quad[1])
            normal *= np.sign(normal @ (quad.mean(axis=0) - middle)) / np.linalg.norm(normal)
            if normal @ quad.mean(axis=0) < 0.0:
                lit = 1.0 + 0.25 * float(to_camera[:3, :3].T @ normal @ _SUN)
                pixels = quad @ K.T
                faces.append((float(np.linalg.norm(quad.mean(axis=0))), lit, pixels[:, :2] / pixels[:, 2:]))
    share, light = np.zeros((HEIGHT, WIDTH), np.uint8), np.zeros((HEIGHT, WIDTH), np.uint8)
    for _, lit, quad in sorted(faces, key=lambda f: -f[0]):
        corners = np.rint(quad * 16.0).astype(np.int32)
        cv2.fillConvexPoly(share, corners, 255, cv2.LINE_AA, 4)
        cv2.fillConvexPoly(light, corners, int(min(255.0, max(1.0, level * lit))), cv2.LINE_AA, 4)
    return _blur_layers(share, light)


def rods_seen(
    rods: list[tuple[Floats, Floats, float]], to_camera: Floats, K: Floats, level: float
) -> tuple[Floats32, Floats32]:
    """As `boxes_seen`, of rods with round ends: both ends (3,) and the radius. Lit along the middle, as what is round is."""
    share, light = np.zeros((HEIGHT, WIDTH), np.uint8), np.zeros((HEIGHT, WIDTH), np.uint8)
    seen = [(np.array([a, b]) @ to_camera[:3, :3].T + to_camera[:3, 3], radius) for a, b, radius in rods]
    for ends, radius in sorted(seen, key=lambda rod: -float(rod[0][:, 2].mean())):
        if ends[:, 2].min() < frames.NEAR:
            continue
        pixels = ends @ K.T
        middles, wide = pixels[:, :2] / pixels[:, 2:], K[0, 0] * radius / ends[:, 2]
        for part, lit in ((1.0, 0.75), (0.8, 0.9), (0.5, 1.05), (0.2, 1.15)):
            around = middles[:, None] + part * wide[:, None, None] * _CIRCLE
            hull = cv2.convexHull(np.rint(around.reshape(-1, 2) * 16.0).astype(np.int32))
            cv2.fillConvexPoly(share, hull, 255, cv2.LINE_AA, 4)
            cv2.fillConvexPoly(light, hull, int(min(255.0, max(1.0, level * lit))), cv2.LINE_AA, 4)
    return _blur_layers(share, light)


def _blur_layers(share: Pixels, light: Pixels) -> tuple[Floats32, Floats32]:
    soft = cv2.GaussianBlur(share.astype(np.float32) / np.float32(255.0), (0, 0), BLUR)
    glow = cv2.GaussianBlur(light.astype(np.float32), (0, 0), BLUR)
    return np.asarray(soft, dtype=np.float32), np.asarray(glow, dtype=np.float32)

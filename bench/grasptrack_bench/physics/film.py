# SPDX-License-Identifier: Apache-2.0
"""What a film of the world shows: the hand's view and that of somebody who stands beside, in colour, the latter with shadows.

Drawn apart from the images that the tracker sees, and from a copy of the state, so that filming changes nothing. A colour has
the grey level of what it stands for: the hand's view in grey is the tracker's image, but for its noise.
"""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any, Protocol

import cv2
import numpy as np

from grasptrack.typing import Floats, Floats32, Pixels
from grasptrack_bench.physics import frames
from grasptrack_bench.physics.images import (
    BLUR,
    SUN,
    MujocoImages,
    blocked_view,
    boxes_seen,
    draw_scene,
    frame_number,
    hand_level,
    rods_seen,
)
from grasptrack_bench.physics.model import import_mujoco
from grasptrack_bench.physics.setting import HEIGHT, WIDTH
from grasptrack_bench.simulation.camera import Pinhole
from grasptrack_bench.simulation.render import TO_GREY, Renderer
from grasptrack_bench.simulation.textures import SceneAppearance, TextureMap, sample_look

if TYPE_CHECKING:
    from grasptrack_bench.physics.images import Layer
    from grasptrack_bench.physics.world import World

BYSTANDER = Pinhole(WIDTH, HEIGHT, focal=HEIGHT / 2.0 / np.tan(np.radians(20.0)))
"""40 degrees high."""
NEAR_BY: Floats = np.array([0.35, -0.47, 0.27])
"""m, from what it looks at: near enough that a part which comes up 12 cm crosses a third of the picture."""
LOOKS_AT = 0.07
"""m above the table."""
FAR_OFF, FAR_LOOK = 1.8, 0.2
"""Times as far, and m above the table, where the hand is still high."""
LOW, HIGH = 0.14, 0.40
"""m of the fingertips above the table between which it draws near; it stands still while a part is lifted."""
FAR, RAISED, ELBOW = 2.2, 1.4, 0.2
"""m beside an arm that is still high and above its middle, where no horizon is seen, and how far above that it looks."""
DARKENED = 0.5
"""Share of the light that a shadow takes."""
PENUMBRA = 1.5
"""px."""


def _hue(blue: float, green: float, red: float) -> Floats32:
    """(3,) BGR of grey level 1."""
    colour = np.array([blue, green, red], np.float32)
    return np.asarray(colour / (colour @ TO_GREY), np.float32)


TABLE_HUE, PART_HUE, HAND_HUE = _hue(120.0, 180.0, 215.0), _hue(215.0, 120.0, 40.0), _hue(190.0, 182.0, 172.0)


def colour_of_level(hue: Floats32, level: float) -> Floats32:
    """(3,) BGR of a grey level: of the hue, or as near to it as can be without a channel beyond 255."""
    most = float((hue - 1.0).max())
    share = min(1.0, (255.0 / level - 1.0) / most) if most > 0.0 else 1.0
    return np.asarray(level * (1.0 + share * (hue - 1.0)), np.float32)


def tint_texture(texture: TextureMap, hue: Floats32) -> TextureMap:
    """The same pattern in a hue, its grey levels kept."""
    return TextureMap(np.ascontiguousarray(_colour_table(hue)[texture.grey.image]), texture.extent, texture.middle)


def _colour_table(hue: Floats32) -> Pixels:
    """(256, 3) BGR of every grey level."""
    colours = np.array([colour_of_level(hue, max(float(level), 1.0)) for level in range(256)])
    return np.asarray(np.clip(np.rint(colours), 0, 255), dtype=np.uint8)


class Film(Protocol):
    """Draws the pictures of a film; what is drawn follows from the world's state alone."""

    def hand(self, world: World) -> Pixels:
        """(480, 640, 3) BGR, of the hand's camera."""
        ...

    def bystander(self, world: World) -> Pixels:
        """(480, 640, 3) BGR, of the one who stands beside."""
        ...


def make_film(world: World) -> Film:
    """Who draws it: MuJoCo where it draws the hand's images, too."""
    seen = sample_look(world.shape.name, world.seed)
    return MujocoFilm(world, seen) if isinstance(world.images, MujocoImages) else PlanarFilm(world, seen)


def bystander_pose(world: World) -> Floats:
    """(4, 4) of the bystander's camera: it goes along with the hand and looks below it, nearer the lower the hand is; at an
    arm it begins farther off."""
    hand, rods = world.pose()[:3, 3], world.links()
    below = np.array([*hand[:2], 0.0])
    away = float(np.clip((hand[2] - LOW) / (HIGH - LOW), 0.0, 1.0))
    away *= away * (3.0 - 2.0 * away)
    beside, far, far_look = NEAR_BY, FAR_OFF * NEAR_BY, below + np.array([0.0, 0.0, FAR_LOOK])
    if rods:
        reach = rods[0][1] - below
        across = np.array([-reach[1], reach[0], 0.0]) / max(float(np.hypot(*reach[:2])), 1e-9)
        side = across - 0.5 * reach / np.linalg.norm(reach)  # from the side away from the arm
        beside = np.array([*(np.hypot(*NEAR_BY[:2]) * side[:2] / np.hypot(*side[:2])), NEAR_BY[2]])
        far, far_look = FAR * across + np.array([0.0, 0.0, RAISED]), below + 0.5 * reach + np.array([0.0, 0.0, ELBOW])
    looks_at = (1.0 - away) * (below + np.array([0.0, 0.0, LOOKS_AT])) + away * far_look
    to_eye = (1.0 - away) * beside + away * far
    z = -to_eye / np.linalg.norm(to_eye)
    x = np.cross(z, np.array([0.0, 0.0, 1.0]))
    x = x / np.linalg.norm(x)
    return frames.pose_of(np.column_stack([x, np.cross(z, x), z]), looks_at + to_eye)


class PlanarFilm:
    """Draws by homographies."""

    def __init__(self, world: World, seen: SceneAppearance) -> None:
        size, part = world.setting.part.size, world.setting.part.shape
        table, surface = tint_texture(seen.table, TABLE_HUE), tint_texture(seen.surface, PART_HUE)
        self._view = Renderer(
            part,
            TextureMap(table.image, table.extent * size),
            TextureMap(surface.image, surface.extent * size),
            width=WIDTH,
            height=HEIGHT,
            blur=BLUR,
            colour=True,
        )
        self._level = hand_level(seen)
        self._colour = colour_of_level(HAND_HUE, self._level) / self._level

    def hand(self, world: World) -> Pixels:
        """(480, 640, 3) BGR, of the hand's camera."""
        if world.blocked():
            return _plain(blocked_view(world.seed, frame_number(world)))
        K, at = world.setting.camera.matrix, world.camera_pose()
        image = draw_scene(world, self._view, K, at)
        boxes = world.hand.boxes(world.opening())
        self._lay_over(image, boxes_seen(boxes, frames.inverse_pose(world.setting.mount), K, self._level))
        return _rounded(image)

    def bystander(self, world: World) -> Pixels:
        """(480, 640, 3) BGR, of the one who stands beside."""
        at, K = bystander_pose(world), BYSTANDER.matrix
        to_camera = frames.inverse_pose(at)
        shadow = shadow_on_table(world, K, to_camera)

        def shade(image: Floats32) -> None:
            image *= 1.0 - np.float32(DARKENED) * shadow[..., None]

        image = draw_scene(world, self._view, K, at, shade)
        self._lay_over(image, rods_seen(world.links(), to_camera, K, self._level))  # the hand hangs below them
        boxes = world.hand.boxes(world.opening())
        self._lay_over(image, boxes_seen(boxes, to_camera @ world.pose(), K, self._level))
        return _rounded(image)

    def _lay_over(self, image: Floats32, layer: Layer) -> None:
        image *= 1.0 - layer.share[..., None]
        image += layer.light[..., None] * self._colour


def shadow_on_table(world: World, K: Floats, to_camera: Floats) -> Floats32:
    """(480, 640) 0 to 1: where part, hand and arm keep the light of `images.SUN` from the table."""
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)

    def fall(points: Floats) -> Floats:
        """(N, 2) px where the shadows of points (N, 3) of the world lie; those behind the camera are left out."""
        on_table = points - points[:, 2:] / SUN[2] * SUN
        ahead = on_table @ to_camera[2, :3] + to_camera[2, 3] > frames.NEAR
        return frames.project_points(K, to_camera, on_table[ahead])

    def cover(points: Floats) -> None:
        """The shadow of a convex body with these corners."""
        seen = fall(points)
        if len(seen) >= 3:
            cv2.fillConvexPoly(mask, cv2.convexHull(_fixed(seen)), 255, cv2.LINE_8, 4)

    part, pose = world.setting.part, world.part_pose()
    for piece in part.pieces:
        both = np.vstack([np.column_stack([piece, np.full(len(piece), z)]) for z in (0.0, part.thickness)])
        cover(both @ pose[:3, :3].T + pose[:3, 3])
    hand = world.pose()
    for corners in world.hand.boxes(world.opening()):
        cover(corners @ hand[:3, :3].T + hand[:3, 3])
    around = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    ring = np.column_stack([np.cos(around), np.sin(around), np.zeros(16)])
    for start, end, radius in world.links():
        cover(np.vstack([start + radius * ring, end + radius * ring]))
    soft = cv2.GaussianBlur(mask.astype(np.float32) / np.float32(255.0), (0, 0), PENUMBRA)
    return np.asarray(soft, dtype=np.float32)


def _fixed(points: Floats) -> Any:
    return np.rint(np.clip(points, -1e4, 1e4) * 16.0).astype(np.int32)


class MujocoFilm:
    """Draws by OpenGL, from a copy of the model in colour, with a lamp that goes along and casts shadows."""

    _LAMP = 3.0
    """m that the lamp stands off."""

    def __init__(self, world: World, seen: SceneAppearance) -> None:
        mujoco = import_mujoco()
        self._model = copy.deepcopy(world.model)
        self._data = mujoco.MjData(self._model)
        self._seed = world.seed
        self._model.vis.quality.shadowsize = 4096
        self._model.light_cutoff[:], self._model.light_exponent[:] = 45.0, 0.0
        self._model.light_castshadow[:] = 1
        self._usual = [np.array(v) for v in (*self._headlight(), self._model.light_diffuse)]
        part = self._model.body("part").id
        moving = {int(self._model.body("table").id), part, 0}
        for geom, body in enumerate(self._model.geom_bodyid):
            if body == part:
                self._model.geom_rgba[geom, :3] = colour_of_level(PART_HUE, seen.surface_level)[::-1] / 255.0
            elif int(body) not in moving:
                self._model.geom_rgba[geom, :3] = colour_of_level(HAND_HUE, hand_level(seen))[::-1] / 255.0
        texels = self._model.tex_data.reshape(1, -1, 3)
        texels[:] = _colour_table(TABLE_HUE)[cv2.cvtColor(texels, cv2.COLOR_RGB2GRAY)][..., ::-1]
        self._renderer = mujoco.Renderer(self._model, HEIGHT, WIDTH)  # takes the texture as it is now

    def _headlight(self) -> tuple[Any, Any]:
        return self._model.vis.headlight.ambient, self._model.vis.headlight.diffuse

    def hand(self, world: World) -> Pixels:
        """(480, 640, 3) BGR, of the hand's camera."""
        if world.blocked():
            return _plain(blocked_view(self._seed, frame_number(world)))
        ambient, diffuse = self._headlight()
        ambient[:], diffuse[:], self._model.light_diffuse[:] = self._usual
        return self._render(world, "hand", shadows=False)

    def bystander(self, world: World) -> Pixels:
        """(480, 640, 3) BGR, of the one who stands beside."""
        ambient, diffuse = self._headlight()
        ambient[:], diffuse[:], self._model.light_diffuse[:] = 0.45, 0.12, 0.7
        return self._render(world, "bystander", shadows=True)

    def _render(self, world: World, camera: str, shadows: bool) -> Pixels:
        mujoco, below = import_mujoco(), np.array([*world.pose()[:2, 3], 0.0])
        at = bystander_pose(world)
        self._data.qpos[:] = world.data.qpos
        self._data.mocap_pos[0] = at[:3, 3]
        self._data.mocap_quat[0] = frames.rotation_to_quaternion(at[:3, :3] @ frames.DOWN)
        if shadows:
            self._model.light_pos[0], self._model.light_dir[0] = below + self._LAMP * SUN, -SUN / np.linalg.norm(SUN)
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)
        self._renderer.update_scene(self._data, camera=camera)
        self._renderer.scene.flags[mujoco.mjtRndFlag.mjRND_SHADOW] = int(shadows)
        return np.asarray(cv2.cvtColor(self._renderer.render(), cv2.COLOR_RGB2BGR), dtype=np.uint8)


def _plain(grey: Pixels) -> Pixels:
    return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def _rounded(image: Floats32) -> Pixels:
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)

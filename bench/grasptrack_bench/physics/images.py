# SPDX-License-Identifier: Apache-2.0
"""What the hand's camera sees, drawn by MuJoCo or by this package's own planar renderer."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import InputError
from grasptrack.typing import Floats, Floats32, Pixels
from grasptrack_bench.physics import frames
from grasptrack_bench.physics.gripper import Gripper
from grasptrack_bench.physics.model import import_mujoco
from grasptrack_bench.physics.serial import Rod
from grasptrack_bench.physics.setting import HEIGHT, WIDTH, Setting
from grasptrack_bench.simulation.conditions import pooled_noise
from grasptrack_bench.simulation.render import Renderer
from grasptrack_bench.simulation.textures import SceneAppearance, TextureMap, another_surface, sample_look

if TYPE_CHECKING:
    from grasptrack_bench.physics.world import World

NOISE = 2.0
"""Grey levels of the camera's noise."""
COVER = 34.0
"""Grey level of what blocks the view."""


class Images(Protocol):
    """Draws a world; what is drawn follows from the world's state alone."""

    levels: dict[str, float]
    texture: str
    assets: dict[str, bytes]

    def bind(self, model: Any) -> None:
        """Learn the model, once it is made."""
        ...

    def hand(self, world: World) -> Pixels:
        """(480, 640) grey, of the hand's camera."""
        ...


def hand_level(seen: SceneAppearance) -> float:
    """Grey level of the hand: neither the table's nor the part's."""
    levels = sorted((seen.table_level, seen.surface_level))
    gaps = [levels[0], levels[1] - levels[0], 230.0 - levels[1]]
    widest = int(np.argmax(gaps))
    return float([0.5 * levels[0], 0.5 * sum(levels), 0.5 * (levels[1] + 230.0)][widest])


def add_camera_noise(light: NDArray[np.float32], seed: int, frame: int) -> Pixels:
    """8 bit with the camera's noise, the same for the same frame."""
    rng = np.random.default_rng((seed, 17, frame))
    noisy = light + np.float32(NOISE) * pooled_noise(rng, *light.shape[:2])
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def blocked_view(seed: int, frame: int) -> Pixels:
    """What the camera sees of what is held before it."""
    return add_camera_noise(np.full((HEIGHT, WIDTH), COVER, np.float32), seed, frame)


def frame_number(world: World) -> int:
    """Of the image, for its noise: steps of the physics since the start."""
    return round(world.time() / 0.002)


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

    def __init__(self, setting: Setting, seen: SceneAppearance, seed: int) -> None:
        self.levels = {"table": seen.table_level, "part": seen.surface_level, "hand": hand_level(seen)}
        self._blocked_seed = seed
        found, data = cv2.imencode(".png", seen.table.coloured.image)
        self.texture = _TEXTURE if found else ""
        self.assets = {_TEXTURE: data.tobytes()} if found else {}
        self._renderer: Any = None
        self._model: Any = None

    def bind(self, model: Any) -> None:
        """Learn the model."""
        self._model = model

    def hand(self, world: World) -> Pixels:
        """(480, 640) grey, of the hand's camera."""
        frame = frame_number(world)
        if world.blocked():
            return blocked_view(self._blocked_seed, frame)
        if self._renderer is None:
            self._renderer = import_mujoco().Renderer(self._model, HEIGHT, WIDTH)
        self._renderer.update_scene(world.data, camera="hand")
        grey = cv2.cvtColor(np.asarray(self._renderer.render(), dtype=np.uint8), cv2.COLOR_RGB2GRAY)
        soft = cv2.GaussianBlur(grey.astype(np.float32), (0, 0), 0.6)
        return add_camera_noise(np.asarray(soft, dtype=np.float32), self._blocked_seed, frame)


BLUR = 0.7
"""px, of lens and pixel together."""
SUN: Floats = np.array([-0.35, -0.45, 0.82])
"""Direction in the world toward the light."""
_ROUND = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
_CIRCLE: Floats = np.column_stack([np.cos(_ROUND), np.sin(_ROUND)])
_FACES = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))


class PlanarImages:
    """Draws by homographies."""

    def __init__(self, setting: Setting, hand: Gripper, seen: SceneAppearance, seed: int) -> None:
        self.levels = {"table": seen.table_level, "part": seen.surface_level, "hand": hand_level(seen)}
        self.texture, self.assets = "", dict[str, bytes]()
        self._setting, self._gripper, self._seed = setting, hand, seed
        size = setting.part.size
        table = TextureMap(seen.table.image, seen.table.extent * size)
        surface = TextureMap(seen.surface.image, seen.surface.extent * size)
        self._view = Renderer(setting.part.shape, table, surface, width=WIDTH, height=HEIGHT, blur=BLUR, colour=False)
        self._surfaces = [surface]
        rng = np.random.default_rng((seed, 18))
        for _ in setting.beside:
            other = another_surface(seen.surface_level, rng)
            self._surfaces.append(TextureMap(other.image, other.extent * size))
        self._layer: tuple[float, Layer] | None = None

    def bind(self, model: Any) -> None:
        """Nothing is needed of the model."""

    def hand(self, world: World) -> Pixels:
        """(480, 640) grey, of the hand's camera."""
        frame = frame_number(world)
        if world.blocked():
            return blocked_view(self._seed, frame)
        image = self.scene_from(world, self._setting.camera.matrix, world.camera_pose())
        opening = round(world.opening(), 4)
        if self._layer is None or self._layer[0] != opening:
            boxes = self._gripper.boxes(opening)
            drawn = boxes_seen(
                boxes, frames.inverse_pose(self._setting.mount), self._setting.camera.matrix, self.levels["hand"]
            )
            self._layer = (opening, drawn)
        share, light = self._layer[1]
        image *= 1.0 - share
        image += light
        return add_camera_noise(image, self._seed, frame)

    def scene_from(self, world: World, K: Floats, camera_pose: Floats) -> Floats32:
        """(480, 640) grey levels of table and parts, as a camera with intrinsics (3, 3) at a pose (4, 4) sees them."""
        return draw_scene(world, self._view, K, camera_pose, surfaces=self._surfaces)


def draw_scene(
    world: World,
    view: Renderer,
    K: Floats,
    camera_pose: Floats,
    shade: Callable[[Floats32], None] | None = None,
    surfaces: Sequence[TextureMap] = (),
) -> Floats32:
    """Table and parts, without the hand: grey levels (480, 640), or (480, 640, 3) BGR from a renderer of colours.

    `shade` takes the light of shadows from the table, in place, before parts are drawn; `surfaces` are theirs, else the
    renderer's.
    """
    table = np.eye(4)
    table[:2, 3] = world.belt_travel()
    image = view.render_background(frames.plane_to_image(K, camera_pose, table))
    if shade is not None:
        shade(image)
    for number, part in sorted(world.part_poses().items(), key=lambda each: each[1][2, 3]):
        upper = frames.plane_to_image(K, camera_pose, part, world.setting.part.thickness)
        surface = surfaces[number] if surfaces else None
        view.draw_part(image, upper, surface=surface, foot=frames.plane_to_image(K, camera_pose, part))
    return image


class Layer(NamedTuple):
    """What lies over an image: the share of each pixel that it covers, and that share times its grey level; (480, 640) each."""

    share: Floats32
    light: Floats32


def boxes_seen(boxes: list[Floats], to_camera: Floats, K: Floats, level: float) -> Layer:
    """What boxes of (8, 3) corners each cover of an image. The farther faces are drawn first.

    `to_camera` is (4, 4) from their frame; faces differ by their direction from the mean grey level.
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
                lit = 1.0 + 0.25 * float(to_camera[:3, :3].T @ normal @ SUN)
                pixels = quad @ K.T
                faces.append((float(np.linalg.norm(quad.mean(axis=0))), lit, pixels[:, :2] / pixels[:, 2:]))
    share, light = np.zeros((HEIGHT, WIDTH), np.uint8), np.zeros((HEIGHT, WIDTH), np.uint8)
    for _, lit, quad in sorted(faces, key=lambda f: -f[0]):
        corners = np.rint(quad * 16.0).astype(np.int32)
        cv2.fillConvexPoly(share, corners, 255, cv2.LINE_AA, 4)
        cv2.fillConvexPoly(light, corners, int(min(255.0, max(1.0, level * lit))), cv2.LINE_AA, 4)
    return _blur_layers(share, light)


def rods_seen(rods: list[Rod], to_camera: Floats, K: Floats, level: float) -> Layer:
    """As `boxes_seen`, of rods. Lit along the middle, as what is round is."""
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


def _blur_layers(share: Pixels, light: Pixels) -> Layer:
    soft = cv2.GaussianBlur(share.astype(np.float32) / np.float32(255.0), (0, 0), BLUR)
    glow = cv2.GaussianBlur(light.astype(np.float32), (0, 0), BLUR)
    return Layer(np.asarray(soft, dtype=np.float32), np.asarray(glow, dtype=np.float32))


def images_of(
    kind: Literal["auto", "mujoco", "planar"], setting: Setting, hand: Gripper, name: str, seed: int
) -> Images:
    """Who draws."""
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

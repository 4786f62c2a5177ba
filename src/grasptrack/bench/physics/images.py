# SPDX-License-Identifier: Apache-2.0
"""What the hand's camera and a bystander see, drawn by MuJoCo or by this package's own planar renderer."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from grasptrack.bench.physics import frames
from grasptrack.bench.physics.setting import HEIGHT, WIDTH
from grasptrack.bench.simulation.appearance import Look
from grasptrack.bench.simulation.camera import Camera
from grasptrack.bench.simulation.conditions import pooled_noise
from grasptrack.typing import Floats, Pixels

if TYPE_CHECKING:
    from grasptrack.bench.physics.world import World


NOISE = 2.0
"""Grey levels of the camera's noise."""
COVER = 34.0
"""Grey level of what blocks the view."""
BYSTANDER = Camera(WIDTH, HEIGHT, focal=HEIGHT / 2.0 / np.tan(np.radians(20.0)))
"""Of the one who stands beside; 40 degrees high."""
_BESIDE = np.array([0.55, -0.74, 0.52])
"""m, from the point on the table below the hand."""
FAR, RAISED, ELBOW = 2.2, 1.4, 0.2
"""m beside an arm and above its middle, where the bystander stands and sees no horizon, and how far above that it looks."""


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

    def bystander(self, world: World) -> Pixels:
        """(480, 640, 3) BGR, of the one who stands beside."""
        ...


def hand_level(seen: Look) -> float:
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


def bystander_pose(world: World) -> Floats:
    """(4, 4) of the bystander's camera: it goes along with the hand and looks below it; at an arm from farther off."""
    below, rods = np.array([*world.pose()[:2, 3], 0.0]), world.links()
    at, z = below + _BESIDE, -(_BESIDE - np.array([0.0, 0.0, 0.12]))
    if rods:
        reach = rods[0][1] - below
        across = np.array([-reach[1], reach[0], 0.0]) / max(float(np.hypot(*reach[:2])), 1e-9)
        z = -(FAR * across + np.array([0.0, 0.0, RAISED]))
        at = below + 0.5 * reach + np.array([0.0, 0.0, ELBOW]) - z
    z = z / np.linalg.norm(z)
    x = np.cross(z, np.array([0.0, 0.0, 1.0]))
    x = x / np.linalg.norm(x)
    return frames.make_pose(np.column_stack([x, np.cross(z, x), z]), at)

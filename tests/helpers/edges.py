# SPDX-License-Identifier: Apache-2.0
"""Scenes against their truth: where a plane is seen, and where an image shows an edge."""

from collections.abc import Callable, Sequence

import numpy as np

from grasptrack_bench.simulation import Path, Pinhole, Renderer, Scene, TextureMap

REACH, STEPS = 6.0, 121


def flat(level: int) -> TextureMap:
    """A surface of one grey level."""
    return TextureMap(np.full((16, 16), level, np.uint8), 9.0)


def plane_to_image(scene: Scene) -> np.ndarray:
    """(F, 3, 3) from the plane of the contacts to ideal px, frame by frame."""
    return scene.path.table_to_image(scene.camera, scene.thickness)


def pan(step: float, frames: int, camera: Pinhole) -> Path:
    """A camera that moves evenly, so that the part moves by `step` px a frame to the left."""
    distance, still = 4.0, np.zeros(frames)
    across = np.arange(frames) * step * distance / float(camera.matrix[0, 0])
    return Path(np.column_stack([across - across.mean(), still]), np.full(frames, distance), still, still, still)


def renderer(scene: Scene) -> Renderer:
    """What draws a scene in grey, for single layers of it."""
    size = {"width": scene.camera.width, "height": scene.camera.height, "blur": scene.conditions.blur}
    return Renderer(scene.shape, scene.table, scene.surface, colour=False, camera=scene.camera, **size)


def bilinear(field: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Values (...) of a field at points (..., 2) px, all of them within it."""
    low = np.floor(points).astype(int)
    x, y = low[..., 0], low[..., 1]
    u, v = (points - low)[..., 0], (points - low)[..., 1]
    top = field[y, x] * (1 - u) + field[y, x + 1] * u
    return top * (1 - v) + (field[y + 1, x] * (1 - u) + field[y + 1, x + 1] * u) * v


def offsets(
    image: np.ndarray,
    outline: Sequence[np.ndarray],
    inside: float,
    outside: float,
    reach: float = REACH,
    where: Callable[[np.ndarray, np.ndarray], np.ndarray] = lambda point, normal: np.ones(len(point), dtype=bool),
) -> np.ndarray:
    """(N,) px by which the edge's centre lies outside the outline, at places where it is straight and stands alone.

    Args:
        image: (H, W), without texture and noise.
        outline: polygons, outer first.
        inside: grey level of the part.
        outside: grey level of the table; places next to anything else are passed over.
        reach: px, of the profile to either side.
        where: from points and outward normals (N, 2) to which of them count.
    """
    field = image.astype(float)
    found = []
    for ring in outline:
        side = np.roll(ring, -1, axis=0) - ring
        length = np.hypot(*side.T)
        run = np.concatenate([[0.0], np.cumsum(length)])
        at = np.arange(0.5, run[-1], 0.7)
        k = np.clip(np.searchsorted(run, at, side="right") - 1, 0, len(ring) - 1)
        point = ring[k] + ((at - run[k]) / length[k])[:, None] * side[k]
        along = side[k] / length[k][:, None]
        normal = np.column_stack([along[:, 1], -along[:, 0]])
        # Straight enough: within REACH to either side the outline stays a tenth of a pixel from its tangent.
        bend = np.zeros(len(at))
        for step in np.linspace(-reach, reach, 9):
            s = (at + step) % run[-1]
            j = np.clip(np.searchsorted(run, s, side="right") - 1, 0, len(ring) - 1)
            q = ring[j] + ((s - run[j]) / length[j])[:, None] * side[j]
            bend = np.maximum(bend, np.abs(((q - point) * normal).sum(axis=1)))
        t = np.linspace(-reach, reach, STEPS)
        profile_at = point[:, None] + t[None, :, None] * normal[:, None]
        limit = np.array([field.shape[1] - 2, field.shape[0] - 2])
        use = (
            where(point, normal)
            & (bend < 0.25 * (reach / REACH) ** 2)
            & np.all((profile_at >= 0) & (profile_at <= limit), axis=(1, 2))
        )
        value = bilinear(field, profile_at[use])
        clean = (np.abs(value[:, :12] - inside).max(axis=1) < 1.5) & (
            np.abs(value[:, -12:] - outside).max(axis=1) < 1.5
        )
        slope = np.diff(value[clean], axis=1)
        found.append((slope * (t[:-1] + 0.5 * (t[1] - t[0]))).sum(axis=1) / slope.sum(axis=1))
    return np.concatenate(found)

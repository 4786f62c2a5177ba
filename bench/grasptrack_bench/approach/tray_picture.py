# SPDX-License-Identifier: Apache-2.0
"""A tray as it lay, each part with the number of the pick that took it, or why none did."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from grasptrack.view import style
from grasptrack.view.draw import as_bgr
from grasptrack.view.style import ellipsise_text, put_text, rgb_to_bgr, text_width
from grasptrack_bench.physics import frames
from grasptrack_bench.physics.images import PlanarImages
from grasptrack_bench.physics.setting import HEIGHT, WIDTH
from grasptrack_bench.physics.tray import TRAY

if TYPE_CHECKING:
    from grasptrack_bench.approach.trays import Emptied
    from grasptrack_bench.physics import World

_LINE, _SIZE = 22, 13


_HIGH = 0.8
"""m above the table from which the tray is drawn."""


class TrayPicture:
    """A tray from right above, as it is now.

    Args:
        world: with its tray.
    """

    def __init__(self, world: World) -> None:
        assert isinstance(world.images, PlanarImages)
        at = frames.pose_of(frames.DOWN, np.array([0.0, 0.0, _HIGH]))
        focal = 0.95 * WIDTH * _HIGH / TRAY[0]
        K = np.array([[focal, 0.0, 0.5 * WIDTH], [0.0, focal, 0.5 * HEIGHT], [0.0, 0.0, 1.0]])
        levels = world.images.scene_from(world, K, at)
        self._image = as_bgr(np.clip(np.rint(levels), 0, 255).astype(np.uint8))
        middles = np.array([pose[:3, 3] for pose in world.part_poses().values()])
        self._middles: list[list[float]] = frames.project_points(K, frames.inverse_pose(at), middles).tolist()

    def with_outcome(self, told: Emptied) -> bytes:
        """PNG with the numbers of each part's picks, and below a line for each that failed and each part that is left."""
        picture = self._image.copy()
        for number, (x, y) in enumerate(self._middles):
            picks = [p for p in told.picks if p.part == number]
            status = "lost" if any(p.closed_wrong for p in picks) else "searching" if number in told.left else "tracked"
            text = " ".join(str(p.number) for p in picks) or "left"
            wide, left, base = text_width(text, _SIZE, True), round(x) - 12, round(y) + 4
            cv2.rectangle(picture, (left - 5, base - 15), (left + wide + 5, base + 5), rgb_to_bgr(style.PANEL_RGB), -1)
            put_text(picture, text, (left, base), _SIZE, style.STATUS_RGB[status], True)
        lines = [
            f"{told.name}: {told.lifted} of {told.count} lifted in {told.seconds:.0f} s by {len(told.picks)} picks"
        ]
        lines += [f"pick {p.number}: {p.reason}" for p in told.picks if p.reason]
        lines += [f"pick {p.number} closed wrong" for p in told.picks if p.closed_wrong]
        lines += [f"a part is left: {why}" for why in told.left.values()]
        strip = np.empty((len(lines) * _LINE + 8, picture.shape[1], 3), np.uint8)
        strip[:] = rgb_to_bgr(style.PANEL_RGB)
        for k, line in enumerate(lines):
            ink = style.MUTED_RGB if k else style.INK_RGB
            put_text(strip, ellipsise_text(line, strip.shape[1] - 20, _SIZE), (10, (k + 1) * _LINE - 4), _SIZE, ink)
        return bytes(cv2.imencode(".png", np.vstack([picture, strip]))[1])

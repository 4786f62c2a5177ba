# SPDX-License-Identifier: Apache-2.0
"""What both cameras see, side by side, with what the servo does and why."""

from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np

from grasptrack.bench.physics import World
from grasptrack.typing import Pixels
from grasptrack.view.draw import as_bgr, draw_disc, draw_overlay
from grasptrack.view.style import INK_RGB, MUTED_RGB, PANEL_RGB, Colour, ellipsise_text, put_text, rgb_to_bgr

if TYPE_CHECKING:
    from grasptrack.bench.approach.case import Row
    from grasptrack.bench.approach.trial import Step


_GOAL: Colour = (240, 228, 66)
_LINE = 30
_STATES: dict[str, Colour] = {
    "approaching": (86, 180, 233),
    "converged": (0, 168, 120),
    "closing": (0, 168, 120),
    "done": (0, 168, 120),
    "unsure": (240, 170, 20),
    "holding": (240, 170, 20),
    "searching": (240, 170, 20),
    "failed": (222, 84, 24),
}


def side_by_side(world: World, step: Step) -> Pixels:
    """(H, 1280, 3) BGR: the hand's view with the tracker's overlay and the goal, the bystander's view, and a line below."""
    image = world.image() if step.image is None else step.image
    if step.image is None or step.result is None:
        left = _plain_strip(as_bgr(image), step.stage)
    else:
        picture = as_bgr(image)
        if step.command is not None and step.command.goal is not None:
            for point in step.command.goal[np.isfinite(step.command.goal).all(axis=1)]:
                draw_disc(picture, point, 9.0, _GOAL, 1.6)
        left = draw_overlay(picture, step.result)
    right = np.full((left.shape[0], left.shape[1], 3), rgb_to_bgr(PANEL_RGB), np.uint8)
    beside = world.bystander()
    right[: beside.shape[0]] = beside
    return np.vstack([np.hstack([left, right]), _draw_status_line(step, 2 * left.shape[1])])


def _draw_hand_view(step: Step) -> Pixels:
    """The hand's view at a step, with what the tracker said."""
    assert step.image is not None and step.result is not None
    view = draw_overlay(as_bgr(step.image), step.result)
    put_text(view, f"{step.time:.2f} s", view.shape[1] - 70, 21, 15, INK_RGB)
    return view


def render_final_png(world: World, step: Step, row: Row, seen: Step | None = None, missed: Step | None = None) -> bytes:
    """A PNG of the end of a trial, with its outcome and the reason; where the grasp was lost, above it the hand's view when it
    was seen last and in the image after."""
    picture = side_by_side(world, step)
    if seen is not None and missed is not None:
        picture = np.vstack([np.hstack([_draw_hand_view(seen), _draw_hand_view(missed)]), picture])
    head = np.full((_LINE, picture.shape[1], 3), rgb_to_bgr(PANEL_RGB), np.uint8)
    text = f"{row.shape}, {row.scenario}, seed {row.seed}: {row.outcome} after {row.time_s:.1f} s. {row.reason}"
    put_text(head, ellipsise_text(text, head.shape[1] - 20, 15), 10, 21, 15, INK_RGB)
    _, data = cv2.imencode(".png", np.vstack([head, picture]), [cv2.IMWRITE_PNG_COMPRESSION, 6])
    return data.tobytes()


def _plain_strip(picture: Pixels, stage: str) -> Pixels:
    """Below the image, where the tracker's strip would be: what the hand does without it."""
    told = {"close": "feels for the table and closes", "lift": "lifts, and holds for a second"}.get(stage, "looks")
    strip = np.full((58, picture.shape[1], 3), rgb_to_bgr(PANEL_RGB), np.uint8)
    put_text(strip, told, 10, 36, 14, MUTED_RGB)
    return np.vstack([picture, strip])


def _draw_status_line(step: Step, width: int) -> Pixels:
    line = np.full((_LINE, width, 3), rgb_to_bgr(PANEL_RGB), np.uint8)
    state = step.stage if step.command is None or step.stage in ("close", "lift") else step.command.state
    put_text(line, state, 10, 21, 15, _STATES.get(state, MUTED_RGB), bold=True)
    why = "" if step.command is None or step.stage in ("close", "lift") else step.command.reason
    put_text(line, ellipsise_text(why, width // 2 - 140, 14), 130, 21, 14, INK_RGB)
    figures = f"{step.time:.2f} s"
    if step.command is not None and np.isfinite(step.command.error_px):
        figures += f"    {step.command.error_px:.1f} px from the goal    {1e3 * step.command.height:.0f} mm to go"
    put_text(line, figures, width // 2 + 10, 21, 14, MUTED_RGB)
    return line

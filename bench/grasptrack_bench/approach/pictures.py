# SPDX-License-Identifier: Apache-2.0
"""A frame of the film: the hand's view with the tracker's marks, the view from beside, and what is done and why; and charts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np

from grasptrack.typing import Floats, Pixels
from grasptrack.view import style
from grasptrack.view.draw import Canvas, as_bgr, draw_overlay
from grasptrack.view.style import Colour, create_figure, ellipsise_text, put_text, rgb_to_bgr, save_whole, text_width
from grasptrack_bench.physics import World

if TYPE_CHECKING:
    from grasptrack.geometry.contours import View
    from grasptrack_bench.approach.case import Row
    from grasptrack_bench.approach.trial import Step


_GOAL: Colour = (240, 228, 66)
_LINE, _STRIP = 30, 58
_STATES: dict[str, Colour] = {
    "approaching": (86, 180, 233),
    "converged": (0, 168, 120),
    "closing": (0, 168, 120),
    "done": (0, 168, 120),
    "unsure": (240, 170, 20),
    "holding": (240, 170, 20),
    "searching": (240, 170, 20),
    "retreating": (240, 170, 20),
    "empty": (222, 84, 24),
    "failed": (222, 84, 24),
}
_STAGES = ("look", "approach", "close", "lift")
_BLIND = {
    "close": "feels for the table and closes",
    "open": "opens for another try",
    "lift": "lifts, and holds for a second",
}


def side_by_side(world: World, step: Step, last: View | None = None) -> Pixels:
    """(H, 1280, 3) BGR: the hand's view with the tracker's overlay and the goal, the view from beside, what is done and why
    below, and what the marks mean.
    """
    view = world.hand_in_colour()
    if step.image is None or step.result is None:
        left = np.vstack([view, _blind_strip(view.shape[1], step.stage)])
    else:
        left = draw_overlay(view, step.result, last=last)
        if step.command is not None and step.command.goal is not None:
            _draw_goal(left, step.command.goal)
    right = np.vstack([world.bystander(), _stages_strip(world, step, view.shape[1])])
    for picture, title in ((left, "the hand's camera"), (right, "from beside")):
        _draw_title(picture, title)
    both = np.hstack([left, right])
    return np.vstack([both, _draw_status_line(step, both.shape[1]), _draw_legend(both.shape[1])])


def hold_result(picture: Pixels, row: Row) -> Pixels:
    """The last frame with the outcome over it, to be shown for a while."""
    held = picture.copy()
    text = row.outcome.upper() + (f": {row.reason}" if row.reason else ": held in the air for a second")
    room = held.shape[1] // 2 - 60
    text = ellipsise_text(text, room, 19, bold=True)
    wide, x = text_width(text, 19, bold=True) + 32, held.shape[1] // 2 + 14
    colour = style.STATUS_RGB["tracked"] if row.outcome == "lifted" else style.STATUS_RGB["lost"]
    cv2.rectangle(held, (x, 420), (x + wide, 464), rgb_to_bgr(colour), -1)
    put_text(held, text, (x + 16, 449), 19, style.DARK_RGB, bold=True)
    return held


def _draw_goal(picture: Pixels, goal: Floats) -> None:
    for point in goal[np.isfinite(goal).all(axis=1)]:
        Canvas(picture).draw_ring(point, 11.0, _GOAL, 2.0, casing=4.0)


def _draw_title(picture: Pixels, text: str) -> None:
    wide = text_width(text, 14) + 20
    plate = picture[8:34, 8 : 8 + wide]
    plate[:] = (plate * 0.35).astype(np.uint8)
    put_text(picture, text, (18, 26), 14, style.WHITE_RGB)


def _draw_hand_view(step: Step) -> Pixels:
    """The hand's view at a step, with what the tracker said."""
    assert step.image is not None and step.result is not None
    view = draw_overlay(as_bgr(step.image), step.result)
    put_text(view, f"{step.time:.2f} s", (view.shape[1] - 70, 21), 15, style.INK_RGB)
    return view


def render_final_png(world: World, step: Step, row: Row, seen: Step | None = None, missed: Step | None = None) -> bytes:
    """A PNG of the end of a trial, with its outcome and the reason; where the grasp was lost, above it the hand's view when it
    was seen last and in the image after."""
    picture = side_by_side(world, step)
    if seen is not None and missed is not None:
        picture = np.vstack([np.hstack([_draw_hand_view(seen), _draw_hand_view(missed)]), picture])
    head = _panel(_LINE, picture.shape[1])
    text = f"{row.shape}, {row.scenario}, seed {row.seed}: {row.outcome} after {row.time_s:.1f} s. {row.reason}"
    put_text(head, ellipsise_text(text, head.shape[1] - 20, 15), (10, 21), 15, style.INK_RGB)
    _, data = cv2.imencode(".png", np.vstack([head, picture]), [cv2.IMWRITE_PNG_COMPRESSION, 6])
    return data.tobytes()


def _panel(height: int, width: int) -> Pixels:
    return np.full((height, width, 3), rgb_to_bgr(style.PANEL_RGB), np.uint8)


def _blind_strip(width: int, stage: str) -> Pixels:
    """Below the image, where the tracker's strip would be: what the hand does without it."""
    strip = _panel(_STRIP, width)
    put_text(strip, f"the hand {_BLIND.get(stage, 'looks')}", (10, 36), 14, style.MUTED_RGB)
    return strip


def _stages_strip(world: World, step: Step, width: int) -> Pixels:
    """The stages with the present one, and how high part and fingertips are in truth."""
    strip = _panel(_STRIP, width)
    at = 10
    for stage in _STAGES:
        now = stage == step.stage
        put_text(strip, stage, (at, 24), 15, style.INK_RGB if now else style.MUTED_RGB, bold=now)
        at += text_width(stage, 15, bold=now) + 14
        if stage != _STAGES[-1]:
            put_text(strip, "›", (at, 24), 15, style.RULE_RGB)
            at += 22
    put_text(strip, f"{step.time:.2f} s", (width - 74, 24), 15, style.INK_RGB)
    tips, part = 1e3 * world.pose()[2, 3], max(0.0, 1e3 * world.part_pose()[2, 3])
    put_text(
        strip, f"above the table, in truth: fingertips {tips:.0f} mm, part {part:.0f} mm", (10, 47), 14, style.MUTED_RGB
    )
    return strip


def _draw_status_line(step: Step, width: int) -> Pixels:
    line = _panel(_LINE, width)
    blind = step.command is None or step.stage in _BLIND
    state = step.stage if blind or step.command is None else step.command.state
    put_text(line, state, (10, 21), 15, _STATES.get(state, style.MUTED_RGB), bold=True)
    why = "" if blind or step.command is None else step.command.reason
    put_text(line, ellipsise_text(why, width // 2 - 140, 14), (130, 21), 14, style.INK_RGB)
    if not blind and step.command is not None and np.isfinite(step.command.error_px):
        figures = f"{step.command.error_px:.1f} px from the goal, {1e3 * step.command.height:.0f} mm to go"
        put_text(line, figures, (width // 2 + 10, 21), 14, style.MUTED_RGB)
    return line


def _draw_legend(width: int) -> Pixels:
    """What the marks of the hand's view mean."""
    line = _panel(_LINE, width)
    line[0] = rgb_to_bgr(style.RULE_RGB)
    canvas, at = Canvas(line), 10
    for mark, text in (
        ("outline", "outline as followed"),
        ("last", "where it was seen last"),
        ("contact", "contact of the grasp (orange: not stable)"),
        ("hidden", "hidden contact"),
        ("goal", "goal of the contacts: between the fingers"),
    ):
        centre = np.array([at + 11.0, 15.0])
        if mark == "outline":
            canvas.draw_lines([np.array([[-11.0, 0.0], [11.0, 0.0]]) + centre], style.WHITE_RGB, 2.0, casing=0.0)
        elif mark == "last":
            dashes = [np.array([[start, 0.0], [start + 8.0, 0.0]]) + centre for start in (-11.0, 3.0)]
            canvas.draw_lines(dashes, style.STATUS_RGB["lost"], 2.0, casing=0.0)
        elif mark == "goal":
            canvas.draw_ring(centre, 8.0, _GOAL, 2.0, casing=4.0)
        else:
            canvas.draw_contact(centre, style.STATUS_RGB["tracked"], seen=mark == "contact")
        put_text(line, text, (at + 30, 20), 13, style.MUTED_RGB)
        at += 30 + text_width(text, 13) + 26
    return line


_FEATURES = ("x/l", "y/l", "1/l", "angle, rad", "tilt x", "tilt y")


def plot_approach(
    times: Sequence[float],
    errors: Sequence[Floats],
    error_px: Sequence[float],
    twists: Sequence[Floats],
    blind: Sequence[bool],
    title: str,
    path: Path,
) -> None:
    """Write a picture of four charts over time, s, as a PNG.

    Errors are (4,) or (6,) of the features, `error_px` that of the farthest contact from its goal, twists (6,) in m/s and
    rad/s. Where the grasp was not seen (`blind`) is shaded.
    """
    figure = create_figure(9.0, 8.0, layout="constrained")
    axes = figure.subplots(4, 1, sharex=True)
    t = np.asarray(times, dtype=np.float64)
    if len(t):
        rows = np.array([np.pad(e, (0, 6 - len(e)), constant_values=np.nan) for e in errors])
        for i, name in enumerate(_FEATURES):
            if np.isfinite(rows[:, i]).any():
                axes[0].plot(t, rows[:, i], label=name)
        axes[1].semilogy(t, np.maximum(np.asarray(error_px), 1e-2), color="k")
        axes[1].axhline(1.0, color="0.6", linewidth=0.8)
        rates = np.array(twists)
        for i, name in enumerate("xyz"):
            axes[2].plot(t, rates[:, i], label=f"v {name}")
            axes[3].plot(t, rates[:, 3 + i], label=f"w {name}")
        ends = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(blind, dtype=int), [0]])))
        for begin, end in ends.reshape(-1, 2):
            for axis in axes:
                axis.axvspan(t[begin], t[min(end, len(t) - 1)], color="orange", alpha=0.18, linewidth=0)
    for axis, name in zip(axes, ("features' error", "px from the goal", "m/s", "rad/s"), strict=True):
        axis.set_ylabel(name)
        axis.grid(True, alpha=0.3)
        if axis.get_legend_handles_labels()[0]:
            axis.legend(loc="upper right", fontsize=8, ncols=3)
    axes[-1].set_xlabel("s   (shaded: the grasp is not seen)")
    figure.suptitle(title, fontsize=11)
    save_whole(figure, path, 110)

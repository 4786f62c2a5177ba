# SPDX-License-Identifier: Apache-2.0
"""How thick a part may be: error at the contacts and share located, over thickness and tilt, parts light and dark."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np

import grasptrack as gt
from grasptrack_bench.method import score_sequence
from grasptrack_bench.methods import method_makers
from grasptrack_bench.metrics.score import FrameScore
from grasptrack_bench.scenes import show_scene
from grasptrack_bench.simulation import SHAPES, Conditions, Path, Pinhole, Scene
from grasptrack_bench.simulation.textures import SceneAppearance, sample_look
from research.studies import common

THICK = (0.0, 0.01, 0.02, 0.04, 0.08, 0.12)
"""Of sqrt(area)."""
TILTS = (0, 10, 20, 30, 40)
BAND = 2.5
"""Degrees to both sides of a tilt that count as it."""
PARTS = "bracket,key,hook,notched-plate,t-plate,spanner,blob,gear"
AZIMUTHS, SHADES = (0.3, 2.4, 4.5), (0.55, 0.7, 1.2)
"""The directions in which the camera leans, rad, and how light the sides are as a share of the face, one for each."""
SIZE = 175.0


class ThicknessCase(NamedTuple):
    """One sequence: the camera leans by a degree a frame, with a slow roll."""

    part: str
    light: bool
    thick: float
    way: int

    def scene(self) -> Scene:
        """The part in the middle, sqrt(area) of SIZE px."""
        camera, seen = Pinhole(), _choose_look(self.part, self.light, self.way)
        frames = math.ceil(TILTS[-1] + BAND) + 1
        u = np.arange(frames, dtype=np.float64)
        path = Path(
            target=np.zeros((frames, 2)),
            distance=np.full(frames, float(camera.matrix[0, 0]) / SIZE),
            roll=0.4 * self.way + np.radians(0.5) * u,
            tilt=np.radians(u),
            azimuth=np.full(frames, AZIMUTHS[self.way]),
        )
        return Scene(
            SHAPES[self.part](),
            path,
            camera=camera,
            table=seen.table,
            surface=seen.surface,
            conditions=Conditions(blur=0.8, noise=2.0, pooled=True),
            thickness=self.thick,
            shade=SHADES[self.way],
            seed=self.way,
        )


def _choose_look(part: str, light: bool, way: int) -> SceneAppearance:
    """The part's own look of a seed, the first in which it is lighter than the table, or darker."""
    kinds = (sample_look(part, 100 * way + seed) for seed in itertools.count())
    return next(found for found in kinds if (found.surface_level > found.table_level) is light)


def track_case(case: ThicknessCase) -> list[FrameScore]:
    """Scored frames of `auto`; a frame's index is its tilt in degrees. Empty where the first view has no grasp."""
    try:
        start, shown = show_scene(case.scene())
    except gt.GraspError:
        return []
    return score_sequence(shown, method_makers(["auto"]), start)["auto"]


def format_errors(frames: list[FrameScore]) -> str:
    """Located % / median / 95 % of the errors in px, and wrong frames where there are any."""
    counted = [f for f in frames if not f.defining]
    off = [f.distances for f in counted if f.distances is not None]
    located = f"{100 * len(off) / len(counted):.0f} %" if counted else "-"
    if not off:
        return located
    errors = np.concatenate(off)
    wrong = sum(f.is_false_accept for f in counted)
    return f"{located} / {np.median(errors):.2f} / {np.percentile(errors, 95):.2f}" + (
        f" / {wrong} wrong" if wrong else ""
    )


def select_tilt(frames: list[FrameScore], tilt: int) -> list[FrameScore]:
    """Frames in the band round a tilt."""
    return [f for f in frames if abs(f.frame - tilt) <= BAND]


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__, parts=PARTS, workers=2)
    parser.add_argument("--thick", default=",".join(map(str, THICK)), help="of sqrt(area)")
    asked = parser.parse_args()
    names, thick = asked.parts.split(","), [float(t) for t in asked.thick.split(",")]
    cases = [ThicknessCase(*c) for c in itertools.product(names, (False, True), thick, range(len(AZIMUTHS)))]
    common.begin_section("Thick parts")
    frames = dict(zip(cases, common.run_all(track_case, cases, asked.workers), strict=True))
    total = [f for found in frames.values() for f in found]
    wrong = sum(f.is_false_accept for f in total)
    common.add_paragraph(f"{len(names)} parts, {len(cases)} sequences, {len(total)} frames, {wrong} of them wrong.")

    def of(thick: float, **chosen: object) -> list[FrameScore]:
        rows = (f for c, f in frames.items() if c.thick == thick and all(getattr(c, k) == v for k, v in chosen.items()))
        return [frame for row in rows for frame in row]

    heads = ["thickness, % of sqrt(area)", *(f"{tilt} deg" for tilt in TILTS)]
    for title, chosen in (
        ("All", {}),
        ("Dark parts on light", {"light": False}),
        ("Light parts on dark", {"light": True}),
    ):
        common.add_paragraph(f"{title}: located / median / 95 % px.")
        common.add_table(
            heads, [[f"{100 * t:.0f}", *(format_errors(select_tilt(of(t, **chosen), a)) for a in TILTS)] for t in thick]
        )
    common.add_paragraph("By part, all tilts:")
    common.add_table(
        ["part", *(f"{100 * t:.0f} %" for t in thick)],
        [[n, *(format_errors(of(t, part=n)) for t in thick)] for n in names],
    )
    common.write_sections(asked.output)


if __name__ == "__main__":
    main()

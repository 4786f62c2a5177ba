# SPDX-License-Identifier: Apache-2.0
"""The object's own plane: tilt, margin and stability against the truth, in approaches from aside to frontal."""

from __future__ import annotations

import itertools
import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import grasptrack as gt
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.force_closure import analyze
from grasptrack_bench.simulation import SHAPES, Conditions, Path, Pinhole, Scene
from grasptrack_bench.simulation.coverage import sample_outline
from grasptrack_bench.simulation.textures import sample_look
from research.studies import common

TILTS = (0, 15, 30, 45, 60)
"""Degrees of the first view."""
PARTS = "bracket,hook,key,gear,t-plate,spanner,notched-plate,arrow,hinge,cross,u-clip,puzzle-piece"
AZIMUTHS = (0.3, 2.4, 4.5)
"""rad, in which the camera leans, one for each look of the part."""
FRAMES = 40
SIZE, ZOOM = 90.0, 2.5
"""px of sqrt(area) at first, if it were seen frontally, and by how much it grows."""
FRICTION = 0.3
UNIT = 300.0
"""px of the part's own unit where the truth is analysed."""


class TiltCase(NamedTuple):
    """One approach."""

    part: str
    tilt: int
    way: int
    seed: int

    def scene(self) -> Scene:
        """The camera leans at first, comes over the part and closer, and rolls by 30 degrees."""
        camera, u = Pinhole(), np.linspace(0.0, 1.0, FRAMES)
        seen = sample_look(self.part, self.seed + self.way)
        path = Path(
            target=np.column_stack([0.15 * (1.0 - u), -0.1 * (1.0 - u)]),
            distance=float(camera.matrix[0, 0]) / (SIZE * ZOOM**u),
            roll=0.4 * self.way + math.radians(30.0) * u,
            tilt=math.radians(self.tilt) * (1.0 - u * u * (3.0 - 2.0 * u)),
            azimuth=np.full(FRAMES, AZIMUTHS[self.way]),
        )
        return Scene(
            SHAPES[self.part](),
            path,
            camera=camera,
            table=seen.table,
            surface=seen.surface,
            conditions=Conditions(blur=0.8, noise=2.0, pooled=True),
            seed=self.seed + self.way,
        )


class Told(NamedTuple):
    """Of a frame: what the tracker says of the grasp; and, in degrees, what is true and what it says."""

    frame: int
    tracked: bool
    tilt_open: bool
    chance: float
    tilt: float
    said_tilt: float
    tilt_sd: float
    margin: float
    said_margin: float
    margin_sd: float
    margin_image: float
    margin_first: float


def in_plane(scene: Scene, contacts: NDArray[np.float64]) -> float:
    """rad, the margin of contacts (k, 2) px of the first image on the true outline, in the table's own plane."""
    back = np.linalg.inv(scene.path.table_to_image(scene.camera)[0])
    polygons = [UNIT * apply_homography(back, p) for p in scene[0].outline]
    outline = View([Contour.trusted(sample_outline([p], 1.0)[0], hole=i > 0) for i, p in enumerate(polygons)])
    return analyze(gt.Grasp(UNIT * apply_homography(back, contacts)), outline, FRICTION).margin


def track_case(case: TiltCase) -> list[Told]:
    """Located frames after the first; empty where the first view has no grasp on the part."""
    scene, tracker = case.scene(), gt.GraspTracker(friction=FRICTION)
    told: list[Told] = []
    true = first = math.nan
    for frame in scene:
        result = tracker.update(frame.image)
        if frame.index == 0:
            if result.contacts is None or result.analysis is None:
                return []
            try:
                true, first = in_plane(scene, result.contacts), result.analysis.margin
            except gt.GraspError:  # it took something else
                return []
            continue
        if result.analysis is None:
            continue
        figures = (scene.path.tilt[frame.index], result.tilt, result.tilt_sd)
        margins = (true, result.analysis.margin, result.margin_sd, result.margin_image, first)
        degrees = (math.degrees(float(v)) for v in (*figures, *margins))
        said = result.status == "tracked", result.reason_code == "tilt-open", result.chance
        told.append(Told(frame.index, *said, *degrees))
    return told


def summary_row(name: str, frames: list[Told]) -> list[str]:
    """Figures of frames."""
    tilt = np.array([abs(f.said_tilt - f.tilt) for f in frames])
    off = np.array([f.said_margin - f.margin for f in frames])
    sd = np.array([f.margin_sd for f in frames])
    image = np.array([f.margin_image - f.margin for f in frames])
    first = np.array([f.margin_first - f.margin for f in frames])
    open_ = [f for f in frames if f.margin <= 0.0]
    shut = [f for f in frames if f.margin > 0.0]
    return [
        name,
        str(len(frames)),
        f"{np.median(tilt):.2f} / {np.percentile(tilt, 95):.2f}",
        f"{100 * (tilt < 2.0).mean():.0f} %",
        *(f"{np.median(abs(e)):.2f} / {np.percentile(abs(e), 95):.2f}" for e in (off, image, first)),
        f"{np.median(sd):.2f}",
        f"{100 * (abs(off) <= 1.96 * sd).mean():.0f} %",
        f"{sum(f.tracked and not f.tilt_open for f in open_)} of {len(open_)}",
        str(sum(f.tilt_open for f in open_)),
        f"{sum(not f.tracked for f in shut)} of {len(shut)}",
        str(sum(f.tilt_open for f in shut)),
    ]


def calibration_rows(frames: list[Told]) -> list[list[str]]:
    """Rows of the chances that were told against how often the grasp closes in truth."""
    rows = []
    for low, high in itertools.pairwise((0.0, 0.1, 0.5, 0.9, 0.99, 1.01)):
        found = [f for f in frames if low <= f.chance < high]
        if found:
            told = np.mean([f.chance for f in found])
            true = np.mean([f.margin > 0.0 for f in found])
            rows.append([f"{low:g} to {min(high, 1.0):g}", str(len(found)), f"{told:.3f}", f"{true:.3f}"])
    return rows


HEADS = [
    "first view, degrees", "frames", "tilt off, median / 95 %", "within 2", "margin off, plane", "image", "first view",
    "margin's sd", "in 1.96 sd", "not closing: stable", "tilt-open", "closing: unstable", "tilt-open",
]  # fmt: skip


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__, parts=PARTS, seed=100, workers=1)
    parser.add_argument("--tilts", default=",".join(map(str, TILTS)), help="degrees")
    asked = parser.parse_args()
    names, asked_tilts = asked.parts.split(","), tuple(int(t) for t in asked.tilts.split(","))
    cases = [TiltCase(*c, asked.seed) for c in itertools.product(names, asked_tilts, range(len(AZIMUTHS)))]
    common.begin_section("The object's own plane")
    told = dict(zip(cases, common.run_all(track_case, cases, asked.workers), strict=True))
    common.add_paragraph(f"{len(names)} parts, {sum(bool(f) for f in told.values())} approaches, degrees.")

    def write_table(title: str, first: int, last: int) -> None:
        common.add_paragraph(title)
        rows = []
        for name, tilts in (*((str(t), (t,)) for t in asked_tilts), ("all", asked_tilts)):
            frames = [f for c, found in told.items() if c.tilt in tilts for f in found if first <= f.frame <= last]
            if frames:
                rows.append(summary_row(name, frames))
        common.add_table(HEADS, rows)

    write_table("Last frame:", FRAMES - 1, FRAMES - 1)
    write_table("Second half of the way:", FRAMES // 2, FRAMES - 1)
    write_table("First half of the way:", 1, FRAMES // 2 - 1)
    for title, drawn in (
        ("Chance of closing as told, first half, tilts as above:", [f for found in told.values() for f in found]),
        ("The same, first views at 0 to 30 degrees:", [f for c, found in told.items() if c.tilt <= 30 for f in found]),
    ):
        common.add_paragraph(title)
        common.add_table(
            ["chance", "frames", "told", "closes"], calibration_rows([f for f in drawn if f.frame < FRAMES // 2])
        )
    common.write_sections(asked.output)


if __name__ == "__main__":
    main()

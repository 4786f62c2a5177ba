# SPDX-License-Identifier: Apache-2.0
"""Many effects at once, each there or not and as strong as the seed draws it: what no one of the other scenes shows."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from grasptrack.bench.simulation import effects, tabletop
from grasptrack.bench.simulation.camera import Camera
from grasptrack.bench.simulation.courses import add_hand_tremor, from_aside
from grasptrack.bench.simulation.setting import Parts, Setting

Happening = Callable[[Setting], Parts]

BACKGROUNDS: tuple[tuple[Happening | None, float], ...] = (
    (None, 0.4),
    (tabletop.gravel_table, 0.15),
    (tabletop.paper_sheet, 0.1),
    (tabletop.crowded_table, 0.2),
    (tabletop.identical_parts, 0.15),
)
"""What lies round the part, and in which share of the scenes."""
COVERS: tuple[tuple[Happening | None, float], ...] = (
    (None, 0.6),
    (effects.bar_occlusion, 0.1),
    (effects.hand_occlusion, 0.1),
    (effects.irregular_occlusion, 0.1),
    (effects.bar_parallel, 0.1),
)
"""What comes before it, likewise."""


def _sample_effect(s: Setting, choices: tuple[tuple[Happening | None, float], ...]) -> Happening | None:
    """One of them, by their shares."""
    return choices[int(s.rng.choice(len(choices), p=[share for _, share in choices]))][0]


def mixed_effects(s: Setting) -> Parts:
    """Motion, lens, shutter, light, noise, compression, thickness, background and covers, drawn one by one."""
    rng = s.rng
    background, cover = _sample_effect(s, BACKGROUNDS), _sample_effect(s, COVERS)
    ground: Parts = background(s) if background is not None else {}
    over: Parts = cover(s) if cover is not None else {}
    if background in (tabletop.crowded_table, tabletop.identical_parts):
        s = replace(s, size=0.75 * s.size)
    made = {**ground, **over, **_sample_camera(s)}
    if rng.uniform() < 0.5:
        made |= {"thickness": float(rng.uniform(0.0, 0.08)), "shade": float(rng.choice([0.55, 0.7, 1.2]))}
    made["path"] = _sample_path(s, made["camera"])
    made["light"] = _sample_lighting(s)
    return made


def _sample_camera(s: Setting) -> Parts:
    """Half of the lenses distort."""
    k1 = float(s.rng.uniform(-0.2, 0.08)) if s.rng.uniform() < 0.5 else 0.0
    return {"camera": Camera(s.width, s.height, k1=k1)}


def _sample_path(s: Setting, camera: Camera) -> Any:
    """Even motion of 2 to 14 px a frame; some cameras shake, and some first see the part from aside."""
    rng = s.rng
    speed = math.exp(rng.uniform(math.log(2.0), math.log(14.0)))
    path = s.course(
        camera,
        tilt=math.radians(rng.uniform(0.0, 25.0)),
        speed=speed,
        spin=float(rng.uniform(0.0, 5.0)),
        reach=float(rng.uniform(0.25, 0.7)),
        cycles=float(rng.uniform(0.6, 1.6)),
    )
    what = rng.uniform()
    if what < 0.1:
        return from_aside(s.shape, path, camera, lean=math.radians(rng.uniform(5.0, 25.0)), seed=s.seed)
    if what < 0.25:
        return add_hand_tremor(
            s.shape, path, camera, speed=float(rng.uniform(3.0, 12.0)) * s.width / 640.0, seed=s.seed
        )
    return path


def _sample_lighting(s: Setting) -> dict[str, Any]:
    """Focus, noise and compression of every scene; exposure, readout, light, a shadow or a highlight of some."""
    rng = s.rng
    light: dict[str, Any] = {
        "noise": math.exp(rng.uniform(math.log(1.0), math.log(12.0))),
        "blur": float(rng.uniform(0.6, 2.2)),
    }
    if rng.uniform() < 0.3:
        light |= effects.lighting_changes(s)["light"]
    if rng.uniform() < 0.2:
        light |= effects.cast_shadow(s)["light"]
    if rng.uniform() < 0.2:
        light |= effects.specular_highlight(s)["light"]
    if rng.uniform() < 0.5:
        light["exposure"] = float(rng.uniform(0.0, 0.7))
    if rng.uniform() < 0.4:
        light["readout"] = float(rng.uniform(0.0, 0.9))
    if rng.uniform() < 0.4:
        light["jpeg"] = int(rng.integers(30, 91))
    return light

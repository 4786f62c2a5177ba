# SPDX-License-Identifier: Apache-2.0
"""The scenes of the suite: what can happen to a part in front of a camera, each by its name."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from grasptrack.errors import InputError
from grasptrack_bench.simulation import effects, kinds, tabletop
from grasptrack_bench.simulation.camera import Pinhole
from grasptrack_bench.simulation.conditions import Conditions
from grasptrack_bench.simulation.effects import EffectSetting, Parts
from grasptrack_bench.simulation.lookalikes import mirror_symmetric
from grasptrack_bench.simulation.outlines import Shape
from grasptrack_bench.simulation.paths import add_hand_tremor, from_aside
from grasptrack_bench.simulation.scene import Scene
from grasptrack_bench.simulation.textures import SceneAppearance, TextureMap, sample_look

Happening = Callable[[EffectSetting], Parts]

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


def _sample_effect(s: EffectSetting, choices: tuple[tuple[Happening | None, float], ...]) -> Happening | None:
    """One of them, by their shares."""
    return choices[int(s.rng.choice(len(choices), p=[share for _, share in choices]))][0]


def mixed_effects(s: EffectSetting) -> Parts:
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


def _sample_camera(s: EffectSetting) -> Parts:
    """Half of the lenses distort."""
    k1 = float(s.rng.uniform(-0.2, 0.08)) if s.rng.uniform() < 0.5 else 0.0
    return {"camera": Pinhole(s.width, s.height, k1=k1)}


def _sample_path(s: EffectSetting, camera: Pinhole) -> Any:
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


def _sample_lighting(s: EffectSetting) -> dict[str, Any]:
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


BENCH: tuple[tuple[Happening, ...], ...] = (
    (kinds.h264, kinds.h265, kinds.cheap_camera),
    (kinds.focus, kinds.glare_first),
    (kinds.bevel, kinds.transparent),
    (kinds.glossy_table, kinds.contact_shadow),
    (kinds.touching, kinds.faint),
    (kinds.block, kinds.pushed, kinds.fixed_marks, kinds.hand_camera, kinds.aspect),
)
"""What a bench may have at once: at most one of each row. Those of the last row bring the camera's path."""


def bench_mixture(s: EffectSetting) -> Parts:
    """Two to four kinds of a bench, with the motion, noise and light of `mixed`."""
    rows = sorted(s.rng.choice(len(BENCH), int(s.rng.integers(2, 5)), replace=False).tolist())
    chosen = [BENCH[row][int(s.rng.integers(len(BENCH[row])))] for row in rows]
    if kinds.block in chosen and kinds.glossy_table in chosen:  # each has a thickness of its own
        chosen[chosen.index(kinds.glossy_table)] = kinds.contact_shadow
    made: Parts = _sample_camera(s)
    made["path"], light = _sample_path(replace(s, size=0.8 * s.size), made["camera"]), _sample_lighting(s)
    for kind in chosen:
        parts = kind(s)
        light |= parts.pop("light", {})
        for name in ("layers", "distractors", "covers"):
            made[name] = (*made.get(name, ()), *parts.pop(name, ()))
        path = parts.pop("path")
        if kind in BENCH[-1]:
            parts = {"camera": Pinhole(s.width, s.height), "path": path, **parts}
        made |= parts
    return {**made, "light": light}


Group = Literal["motion", "image", "background", "cover", "identity", "model"]


@dataclass(frozen=True)
class Disturbance:
    """One kind of scene.

    Attributes:
        name: as in tables and on the command line.
        about: one plain line.
        group: "motion", "image", "background", "cover", "identity", or "model" for what breaks the model of a flat part
            and a pinhole.
        make: from the setting to the arguments of the scene.
    """

    name: str
    about: str
    group: Group
    make: Callable[[EffectSetting], Parts]

    def scene(
        self,
        shape: Shape,
        frames: int = 100,
        seed: int = 0,
        *,
        size: tuple[int, int] = (640, 480),
        surface: TextureMap | None = None,
        table: TextureMap | None = None,
        colour: bool = False,
    ) -> Scene:
        """The scene of a part: it starts in view as a whole and uncovered, and frontal but where its name says otherwise.

        Args:
            shape: the part.
            frames: number of frames; what happens is spread over them.
            seed: of everything: path, table, surface, light, noise, and what happens.
            size: (width, height) px.
            surface: the part's own, as of a photo; else drawn by the seed.
            table: else drawn by the seed.
            colour: BGR images, else grey ones.
        """
        if frames < 1:
            raise InputError(f"a scene has at least 1 frame, not {frames}", frames=frames)
        width, height = size
        rng = np.random.default_rng((seed, zlib.crc32(shape.name.encode()), zlib.crc32(self.name.encode())))
        drawn: SceneAppearance = sample_look(shape.name, seed)
        own = drawn.surface if surface is None else surface
        setting = EffectSetting(
            shape=shape,
            frames=frames,
            seed=int(rng.integers(1 << 31)),
            rng=rng,
            size=float(rng.uniform(155.0, 200.0)) * width / 640.0,
            width=width,
            height=height,
            start=float(rng.uniform(-0.5, 0.5)),
            level=float(own.grey.image.mean()),
            table_level=float((drawn.table if table is None else table).grey.image.mean()),
        )
        base = {
            "blur": float(rng.uniform(0.65, 0.95)),
            "noise": float(rng.uniform(1.0, 3.0)),
            "vignette": float(rng.uniform(0.0, 0.15)),
            "drift": float(rng.uniform(0.0, 0.04)),
        }
        parts = self.make(setting)
        light = {**base, **parts.pop("light", {})}
        lies, skin = parts.pop("table", drawn.table), parts.pop("surface", own)
        drawn_shape = parts.pop("shape", shape)
        options = {"camera": Pinhole(width, height), **parts}
        return Scene(
            drawn_shape,
            table=lies if table is None else table,
            surface=skin if surface is None else surface,
            conditions=Conditions(pooled=True, **light),
            colour=colour,
            seed=int(rng.integers(1 << 31)),
            name=f"{self.name} of {shape.name}, seed {seed}",
            **options,
        )


def is_applicable(shape: Shape, name: str) -> bool:
    """Whether a disturbance makes sense for a part: a mirror-symmetric one has no mirror image of its own."""
    if name not in DISTURBANCES:
        raise InputError(f'unknown disturbance "{name}"; choose from {", ".join(DISTURBANCES)}', name=name)
    return name != "mirror" or not mirror_symmetric(shape)


ROWS: tuple[tuple[str, str, Group, Happening], ...] = (
    ("clean-4dof", "The camera shifts, turns and zooms, always frontal.", "motion", effects.clean_4dof),
    ("clean-6dof", "The camera also tilts, up to 25 degrees.", "motion", effects.clean_6dof),
    ("noise", "Noise of 8 to 16 grey levels.", "image", effects.strong_noise),
    ("blur", "The lens is out of focus: a blur of 2 to 3.5 px.", "image", effects.defocus_blur),
    ("light", "Uneven light that drifts, and jumps three times.", "image", effects.lighting_changes),
    ("shadow", "A soft shadow crosses table and part.", "image", effects.cast_shadow),
    ("motion-blur", "Exposed for 40 to 70 % of a frame, up to 12 px a frame.", "image", effects.motion_blur),
    ("fast", "Up to 20 px and 6 degrees from frame to frame.", "motion", effects.fast_motion),
    ("belt", "The table slides under the part.", "motion", effects.moving_belt),
    ("bar", "A bar sweeps over the part and hides up to 30 % of its outline.", "cover", effects.bar_occlusion),
    ("hand", "A hand comes, hides 30 % of the outline for a while, and goes.", "cover", effects.hand_occlusion),
    ("leave", "The part leaves the image altogether and comes back.", "motion", effects.leave_image),
    ("clip", "The border cuts off up to 25 to 40 % of the outline for a while.", "motion", effects.clip_at_border),
    ("exchange", "Another part lies in its place for a while.", "identity", effects.part_exchange),
    ("twin", "A near twin, with one notch or tab, lies in its place for a while.", "identity", effects.twin_exchange),
    ("mirror", "Its mirror image lies in its place for a while.", "identity", effects.mirror_exchange),
    ("lens", "The lens distorts, as a wide one does.", "model", effects.lens_distortion),
    ("thick", "A part 2 to 15 % of its size thick: sides show under tilt.", "model", effects.thick_part),
    ("still", "Nothing moves at all: there is noise, and nothing else.", "motion", effects.static_camera),
    ("print", "A part with printed markings tilts, up to 28 degrees.", "motion", tabletop.printed_part),
    ("highlight", "A saturated highlight wanders over part and table.", "image", effects.specular_highlight),
    ("shake", "A shaking hand: up to 15 px a frame, exposed for 80 % of it.", "image", effects.camera_shake),
    ("jpeg", "Noise of 8 grey levels, then JPEG of quality 30.", "image", effects.jpeg_compression),
    ("gravel", "The table is gravel whose contrast is like the part's.", "background", tabletop.gravel_table),
    ("sheet", "The part lies on a sheet of paper hardly larger than it.", "background", tabletop.paper_sheet),
    ("crowd", "Other parts lie beside it, some nearly touching.", "background", tabletop.crowded_table),
    ("cover", "Something like a hand stays over up to 30 % of the outline, and moves.", "cover", effects.irregular_occlusion),
    ("bar-parallel", "A bar's edge rests parallel to a side, 3 to 12 px inside it.", "cover", effects.bar_parallel),
    ("equals", "One to three equal parts lie beside it.", "identity", tabletop.identical_parts),
    ("equal-enters", "An equal part comes into view, the first is partly covered.", "identity", tabletop.equal_enters),
    ("print-exchange", "The same outline with another print lies in its place.", "identity", tabletop.print_exchange),
    ("rolling-shutter", "Rows are exposed one after another, up to 14 px a frame.", "model", effects.rolling_shutter),
    ("thick-6", "A part 2 to 6 % of its size thick, tilted up to 20 degrees.", "model", effects.thick_6),
    ("aside", "A part 2 to 10 % of its size thick, first seen 25 degrees from aside; the camera comes over it.",
     "model", effects.oblique_start),
    ("exchange-hidden", "Another part lies in its place after something passed over it.", "identity", effects.exchange_hidden),
    ("mixed", "All of it at once, drawn one by one: motion, lens, shutter, light, thickness, background, covers.",
     "model", mixed_effects),
    ("h264", "Through H.264 with P-frames, at crf 26 to 36.", "image", kinds.h264),
    ("h265", "Through H.265 with P-frames, at crf 26 to 36.", "image", kinds.h265),
    ("cheap-camera", "One colour a pixel, noise reduction, sharpening with halos, JPEG.", "image", kinds.cheap_camera),
    ("fixed-marks", "Dirt, black bars, a bezel or a text stand still in the image.", "image", kinds.fixed_marks),
    ("overlay", "A crosshair, a watermark or a ring of lamps' reflection stands still over the part.", "image",
     kinds.overlay),
    ("focus", "The focus comes and goes: a blur of 0.7 to 5 px, and back.", "image", kinds.focus),
    ("aspect", "Pixels 0.88 to 1.12 times as wide as high.", "model", kinds.aspect),
    ("hand-camera", "A camera in a free hand: bursts of 14 to 61 px a frame at 1280 px width, and their blur.",
     "motion", kinds.hand_camera),
    ("glare-first", "A saturated highlight from the first image on.", "image", kinds.glare_first),
    ("glossy-table", "Lamps and the part's sides are mirrored in the table.", "background", kinds.glossy_table),
    ("contact-shadow", "A soft dark ramp of 3 to 15 px beside one side of the part.", "background", kinds.contact_shadow),
    ("bevel", "A rim of 2 to 6 px that shines as it turns to the light.", "model", kinds.bevel),
    ("faint", "8 to 20 grey levels between part and table, both scratched.", "background", kinds.faint),
    ("transparent", "25 to 60 % opaque, with a bright rim, some with holes.", "model", kinds.transparent),
    ("block", "A printed body 8 to 20 % of its size thick, seen 10 to 30 degrees from aside.", "model", kinds.block),
    ("touching", "Other pieces or a cable touch it from the first image on.", "background", kinds.touching),
    ("pushed", "A finger pushes the part aside and round, and goes.", "cover", kinds.pushed),
    ("equal-belt", "Equal parts on a belt, a step of 0.1 to 0.9 of their distance a frame.", "identity", kinds.equal_belt),
    ("two-bodies", "Two pieces round a rivet open by up to 15 degrees.", "model", kinds.two_bodies),
    ("bench", "Two to four of a bench's kinds at once, with the motion, noise and light of mixed.", "model", bench_mixture),
)  # fmt: skip
DISTURBANCES = {row[0]: Disturbance(*row) for row in ROWS}
"""Every disturbance by its name."""

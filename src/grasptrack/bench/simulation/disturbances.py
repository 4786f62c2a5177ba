# SPDX-License-Identifier: Apache-2.0
"""The scenes of the suite: what can happen to a part in front of a camera, each by its name."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from grasptrack.bench.simulation import effects, mixtures, tabletop
from grasptrack.bench.simulation.appearance import Look, sample_look
from grasptrack.bench.simulation.camera import Camera
from grasptrack.bench.simulation.conditions import Conditions
from grasptrack.bench.simulation.lookalikes import mirror_symmetric
from grasptrack.bench.simulation.outlines import Shape
from grasptrack.bench.simulation.scene import Scene
from grasptrack.bench.simulation.setting import Parts, Setting
from grasptrack.bench.simulation.texture import Texture
from grasptrack.errors import InputError

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
    make: Callable[[Setting], Parts]

    def scene(
        self,
        shape: Shape,
        frames: int = 100,
        seed: int = 0,
        *,
        size: tuple[int, int] = (640, 480),
        surface: Texture | None = None,
        table: Texture | None = None,
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

        Raises:
            InputError: fewer than 1 frame.
        """
        if frames < 1:
            raise InputError(f"a scene has at least 1 frame, not {frames}", frames=frames)
        width, height = size
        rng = np.random.default_rng((seed, zlib.crc32(shape.name.encode()), zlib.crc32(self.name.encode())))
        drawn: Look = sample_look(shape.name, seed)
        own = drawn.surface if surface is None else surface
        setting = Setting(
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
        options = {"camera": Camera(width, height), **parts}
        return Scene(
            shape,
            table=lies if table is None else table,
            surface=skin if surface is None else surface,
            conditions=Conditions(pooled=True, **light),
            colour=colour,
            seed=int(rng.integers(1 << 31)),
            name=f"{self.name} of {shape.name}, seed {seed}",
            **options,
        )


def is_applicable(shape: Shape, name: str) -> bool:
    """Whether a disturbance makes sense for a part: a mirror-symmetric one has no mirror image of its own.

    Raises:
        InputError: no such disturbance.
    """
    if name not in DISTURBANCES:
        raise InputError(f'unknown disturbance "{name}"; choose from {", ".join(DISTURBANCES)}', name=name)
    return name != "mirror" or not mirror_symmetric(shape)


DISTURBANCES: dict[str, Disturbance] = {
    d.name: d
    for d in (
        Disturbance("clean-4dof", "The camera shifts, turns and zooms, always frontal.", "motion", effects.clean_4dof),
        Disturbance("clean-6dof", "The camera also tilts, up to 25 degrees.", "motion", effects.clean_6dof),
        Disturbance("noise", "Noise of 8 to 16 grey levels.", "image", effects.strong_noise),
        Disturbance("blur", "The lens is out of focus: a blur of 2 to 3.5 px.", "image", effects.defocus_blur),
        Disturbance("light", "Uneven light that drifts, and jumps three times.", "image", effects.lighting_changes),
        Disturbance("shadow", "A soft shadow crosses table and part.", "image", effects.cast_shadow),
        Disturbance("motion-blur", "Exposed for 40 to 70 % of a frame, up to 12 px a frame.", "image", effects.motion_blur),
        Disturbance("fast", "Up to 20 px and 6 degrees from frame to frame.", "motion", effects.fast_motion),
        Disturbance("belt", "The table slides under the part.", "motion", effects.moving_belt),
        Disturbance("bar", "A bar sweeps over the part and hides up to 30 % of its outline.", "cover", effects.bar_occlusion),
        Disturbance("hand", "A hand comes, hides 30 % of the outline for a while, and goes.", "cover", effects.hand_occlusion),
        Disturbance("leave", "The part leaves the image altogether and comes back.", "motion", effects.leave_image),
        Disturbance(
            "clip", "The border cuts off up to 25 to 40 % of the outline for a while.", "motion", effects.clip_at_border,
        ),
        Disturbance("exchange", "Another part lies in its place for a while.", "identity", effects.part_exchange),
        Disturbance(
            "twin", "A near twin, with one notch or tab, lies in its place for a while.", "identity", effects.twin_exchange,
        ),
        Disturbance("mirror", "Its mirror image lies in its place for a while.", "identity", effects.mirror_exchange),
        Disturbance("lens", "The lens distorts, as a wide one does.", "model", effects.lens_distortion),
        Disturbance("thick", "A part 2 to 15 % of its size thick: sides show under tilt.", "model", effects.thick_part),
        Disturbance("still", "Nothing moves at all: there is noise, and nothing else.", "motion", effects.static_camera),
        Disturbance("print", "A part with printed markings tilts, up to 28 degrees.", "motion", tabletop.printed_part),
        Disturbance("highlight", "A saturated highlight wanders over part and table.", "image", effects.specular_highlight),
        Disturbance("shake", "A shaking hand: up to 15 px a frame, exposed for 80 % of it.", "image", effects.camera_shake),
        Disturbance("jpeg", "Noise of 8 grey levels, then JPEG of quality 30.", "image", effects.jpeg_compression),
        Disturbance("gravel", "The table is gravel whose contrast is like the part's.", "background", tabletop.gravel_table),
        Disturbance("sheet", "The part lies on a sheet of paper hardly larger than it.", "background", tabletop.paper_sheet),
        Disturbance("crowd", "Other parts lie beside it, some nearly touching.", "background", tabletop.crowded_table),
        Disturbance(
            "cover",
            "Something like a hand stays over up to 30 % of the outline, and moves.",
            "cover",
            effects.irregular_occlusion,
        ),
        Disturbance(
            "bar-parallel", "A bar's edge rests parallel to a side, 3 to 12 px inside it.", "cover", effects.bar_parallel
        ),
        Disturbance("equals", "One to three equal parts lie beside it.", "identity", tabletop.identical_parts),
        Disturbance(
            "equal-enters", "An equal part comes into view, the first is partly covered.", "identity", tabletop.equal_enters
        ),
        Disturbance(
            "print-exchange", "The same outline with another print lies in its place.", "identity", tabletop.print_exchange
        ),
        Disturbance(
            "rolling-shutter", "Rows are exposed one after another, up to 14 px a frame.", "model", effects.rolling_shutter
        ),
        Disturbance("thick-6", "A part 2 to 6 % of its size thick, tilted up to 20 degrees.", "model", effects.thick_6),
        Disturbance(
            "aside",
            "A part 2 to 10 % of its size thick, first seen 25 degrees from aside; the camera comes over it.",
            "model",
            effects.oblique_start,
        ),
        Disturbance(
            "exchange-hidden", "Another part lies in its place after something passed over it.", "identity",
            effects.exchange_hidden,
        ),
        Disturbance(
            "mixed", "All of it at once, drawn one by one: motion, lens, shutter, light, thickness, background, covers.",
            "model", mixtures.mixed_effects,
        ),
    )
}  # fmt: skip
"""Every disturbance by its name."""

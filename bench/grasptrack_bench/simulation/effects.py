# SPDX-License-Identifier: Apache-2.0
"""What happens in each scene of the suite: from a setting to the arguments of a scene."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grasptrack_bench.simulation.camera import Pinhole
from grasptrack_bench.simulation.conditions import Glare, Shadow
from grasptrack_bench.simulation.lookalikes import best_fit, mirrored_shape, near_twin
from grasptrack_bench.simulation.occluders import Laid, bar_over, hand_over, irregular_over, parallel_bar
from grasptrack_bench.simulation.outlines import Shape
from grasptrack_bench.simulation.paths import (
    Path,
    add_hand_tremor,
    at_rest,
    bounded_path,
    drift_out_of_view,
    from_aside,
)
from grasptrack_bench.simulation.scene import Guest
from grasptrack_bench.simulation.shapes import SHAPES
from grasptrack_bench.simulation.textures import TextureMap, another_surface


@dataclass(frozen=True)
class EffectSetting:
    """What a disturbance starts from.

    Attributes:
        shape: the part.
        frames: number of frames.
        seed: of the path.
        rng: for everything else.
        size: px, sqrt(area) of the part in the first frame, where it fits.
        width, height: px of the image.
        start: rad, of the part in the first image.
        level: mean grey level of the part.
        table_level: mean grey level of the table.
    """

    shape: Shape
    frames: int
    seed: int
    rng: np.random.Generator
    size: float
    width: int
    height: int
    start: float
    level: float
    table_level: float = 150.0

    def course(self, camera: Pinhole | None = None, **options: Any) -> Path:
        """A gentle path with some tilt, its options as in `courses.course`; speeds are those of a 640 px wide image."""
        scale = self.width / 640.0
        given: dict[str, Any] = {"tilt": math.radians(15.0), "speed": 4.0, **options}
        given["speed"] *= scale
        return bounded_path(
            self.shape,
            self.frames,
            self.seed,
            camera=camera if camera is not None else Pinhole(self.width, self.height),
            size=self.size,
            start=self.start,
            **given,
        )

    def at(self, *shares: float) -> tuple[float, ...]:
        """Frames at shares of the sequence."""
        return tuple(share * self.frames for share in shares)

    def view(self, path: Path) -> float:
        """Table units from the middle of the image to its corner, where the camera is farthest."""
        focal = float(Pinhole(self.width, self.height).matrix[0, 0])
        return 0.5 * math.hypot(self.width, self.height) / focal * float(path.distance.max()) + 0.5


Parts = dict[str, Any]
"""Arguments of a `Scene` that a disturbance sets; `light` are changes of its conditions. A `table` or a `surface` gives way
to the user's own."""


ADDED = ("half-disc", "slotted-disc", "pencil", "bottle")
"""Built-in shapes that came after `part_exchange`: it does not draw from them, so that its scenes stay as they were."""
OTHER = 0.12
"""sqrt(area) by which a part that takes the object's place differs from it at least."""


# --- motion --------------------------------------------------------------------------------------


def clean_4dof(s: EffectSetting) -> Parts:
    """Frontal."""
    return {"path": s.course(tilt=0.0)}


def clean_6dof(s: EffectSetting) -> Parts:
    """With tilt."""
    return {"path": s.course(tilt=math.radians(25.0))}


def fast_motion(s: EffectSetting) -> Parts:
    """Quick, with tilt."""
    return {"path": s.course(tilt=math.radians(20.0), speed=20.0, spin=6.0, reach=0.7, cycles=2.4)}


def moving_belt(s: EffectSetting) -> Parts:
    """The table slides by 2 to 6 px a frame."""
    px, angle = s.rng.uniform(2.0, 6.0), s.rng.uniform(0.0, 2.0 * math.pi)
    step = px / 175.0
    return {"path": s.course(speed=2.5), "slide": (step * math.cos(angle), step * math.sin(angle))}


def leave_image(s: EffectSetting) -> Parts:
    """Out of the image, above or below, and back."""
    side = float(s.rng.choice([-0.5, 0.5]) * math.pi + s.rng.uniform(-0.35, 0.35))
    return _drift_away(s, side, 1.0, (0.1, 0.42, 0.58, 0.9))


def clip_at_border(s: EffectSetting) -> Parts:
    """Partly out of the image, to any side, and back."""
    side, share = float(s.rng.uniform(0.0, 2.0 * math.pi)), float(s.rng.uniform(0.25, 0.4))
    return _drift_away(s, side, share, (0.12, 0.42, 0.65, 0.92))


def _drift_away(s: EffectSetting, side: float, share: float, times: tuple[float, ...]) -> Parts:
    path, camera, at = s.course(speed=2.5, reach=0.25), Pinhole(s.width, s.height), _as_four_times(s.at(*times))
    return {"path": drift_out_of_view(s.shape, path, camera, direction=side, share=share, times=at)}


def static_camera(s: EffectSetting) -> Parts:
    """A camera on a stand, in even light."""
    return {"path": at_rest(s.course()), "light": {"drift": 0.0}}


# --- image ---------------------------------------------------------------------------------------


def strong_noise(s: EffectSetting) -> Parts:
    """Strong noise."""
    return {"path": s.course(), "light": {"noise": float(s.rng.uniform(8.0, 16.0))}}


def defocus_blur(s: EffectSetting) -> Parts:
    """Out of focus."""
    return {"path": s.course(), "light": {"blur": float(s.rng.uniform(2.0, 3.5))}}


def lighting_changes(s: EffectSetting) -> Parts:
    """A gradient, a drift, three jumps."""
    angle, strength = s.rng.uniform(0.0, 2.0 * math.pi), s.rng.uniform(0.15, 0.3)
    darker, lighter = float(s.rng.uniform(0.5, 0.7)), float(s.rng.uniform(1.15, 1.3))
    first, last = (darker, lighter) if s.rng.uniform() < 0.5 else (lighter, darker)
    a, b, c = (round(f) for f in s.at(0.3, 0.55, 0.75))
    light = {
        "gradient": (float(strength * math.cos(angle)), float(strength * math.sin(angle))),
        "vignette": float(s.rng.uniform(0.1, 0.3)),
        "drift": float(s.rng.uniform(0.08, 0.15)),
        "jumps": ((a, first), (b, 1.0), (c, last)),
    }
    return {"path": s.course(), "light": light}


def cast_shadow(s: EffectSetting) -> Parts:
    """A blob or a bar of shadow."""
    start, end = (round(f) for f in s.at(0.1, 0.95))
    shadow = Shadow(
        start=max(1, start),
        end=end,
        depth=float(s.rng.uniform(0.3, 0.55)),
        width=float(s.rng.uniform(0.2, 0.4)),
        softness=float(s.rng.uniform(4.0, 20.0)) * s.width / 640.0,
        angle=float(s.rng.uniform(0.0, 2.0 * math.pi)),
        round=bool(s.rng.uniform() < 0.5),
        seed=int(s.rng.integers(1 << 20)),
    )
    return {"path": s.course(), "light": {"shadow": shadow}}


def motion_blur(s: EffectSetting) -> Parts:
    """A long exposure on a quick path."""
    path = s.course(speed=12.0, spin=4.0, reach=0.6, cycles=1.6)
    return {"path": path, "light": {"exposure": float(s.rng.uniform(0.4, 0.7))}}


def specular_highlight(s: EffectSetting) -> Parts:
    """A spot 0.3 to 0.6 sqrt(area) wide, from frame 3 on."""
    path = s.course()
    unit = float(Pinhole(s.width, s.height).matrix[0, 0] / path.distance[0])
    reach = unit * (0.75 * s.shape.radius() + 0.15)
    glare = Glare(
        start=3,
        middle=(0.5 * (s.width - 1.0), 0.5 * (s.height - 1.0)),
        reach=(min(reach, 0.5 * s.width), min(reach, 0.5 * s.height)),
        radius=0.5 * unit * float(s.rng.uniform(0.3, 0.6)),
        softness=float(s.rng.uniform(2.0, 8.0)) * s.width / 640.0,
        waves=float(s.rng.uniform(0.8, 1.4)),
        count=s.frames,
        seed=int(s.rng.integers(1 << 20)),
    )
    return {"path": path, "light": {"glare": glare}}


def camera_shake(s: EffectSetting) -> Parts:
    """A long exposure in a hand that trembles."""
    camera, speed = Pinhole(s.width, s.height), 13.0 * s.width / 640.0
    path = add_hand_tremor(s.shape, s.course(speed=2.0), camera, speed=speed, seed=s.seed)
    return {"path": path, "light": {"exposure": 0.8}}


def jpeg_compression(s: EffectSetting) -> Parts:
    """A cheap camera's stream."""
    return {"path": s.course(), "light": {"noise": 8.0, "jpeg": 30}}


# --- covers --------------------------------------------------------------------------------------


def bar_occlusion(s: EffectSetting) -> Parts:
    """A bar sweeps across."""
    path = s.course()
    return {"path": path, "covers": (_sweeping_bar(s, path, s.at(0.15, 0.5, 0.5, 0.85), 0.3),)}


def _sweeping_bar(s: EffectSetting, path: Path, times: tuple[float, ...], share: float) -> Laid:
    """A grey bar from any side that hides at most a share of the outline."""
    level, angle = (float(v) for v in (s.rng.uniform(30.0, 210.0), s.rng.uniform(0.0, 2.0 * math.pi)))
    colour = (level * 0.97, level, level * 1.01)
    return bar_over(s.shape, _as_four_times(times), share=share, angle=angle, view=s.view(path), colour=colour)


def hand_occlusion(s: EffectSetting) -> Parts:
    """A hand reaches in and rests."""
    path = s.course()
    hand = hand_over(
        s.shape,
        _as_four_times(s.at(0.15, 0.38, 0.65, 0.88)),
        share=0.3,
        side=float(s.rng.uniform(0.0, 2.0 * math.pi)),
        aside=float(s.rng.uniform(-0.25, 0.25)),
        view=s.view(path),
        seed=int(s.rng.integers(1 << 20)),
    )
    return {"path": path, "covers": (hand,)}


def irregular_occlusion(s: EffectSetting) -> Parts:
    """An irregular occluder that stays."""
    path = s.course()
    return {"path": path, "covers": (irregular_over(s.shape, s.frames, s.rng, share=0.3, view=s.view(path)),)}


def bar_parallel(s: EffectSetting) -> Parts:
    """A bar along one side."""
    path = s.course()
    unit = float(Pinhole(s.width, s.height).matrix[0, 0] / path.distance[0])
    px = s.width / 640.0 / unit
    level = float(s.rng.uniform(30.0, 210.0))
    colour = (level * 0.97, level, level * 1.01)
    over = parallel_bar(s.shape, s.frames, s.rng, depths=(3.0 * px, 12.0 * px), view=s.view(path), colour=colour)
    return {"path": path, "covers": (over,)}


def _as_four_times(at: tuple[float, ...]) -> tuple[float, float, float, float]:
    a, b, c, d = at
    return a, b, c, d


# --- identity ------------------------------------------------------------------------------------


def _replace_by_guest(s: EffectSetting, shape: Shape, surface: TextureMap | None = None) -> Parts:
    start, end = (round(f) for f in s.at(0.35, 0.65))
    return {"path": s.course(), "guests": (Guest(max(1, start), end, shape, surface),)}


def part_exchange(s: EffectSetting) -> Parts:
    """Another part, of another outline and another pattern."""
    names = [str(name) for name in s.rng.permutation([name for name in SHAPES if name not in ADDED])]
    for name in names:
        other = SHAPES[name]()
        if best_fit(other, s.shape).distance > OTHER and other.radius() < 1.3 * max(1.0, s.shape.radius()):
            break
    return _replace_by_guest(s, other.moved(float(s.rng.uniform(0.0, 2.0 * math.pi))), another_surface(s.level, s.rng))


def exchange_hidden(s: EffectSetting) -> Parts:
    """The same, brought while a bar hid both, and left there."""
    swapped, path = part_exchange(s), s.course()
    before, over, on, gone = s.at(0.2, 0.4, 0.5, 0.7)
    bar = _sweeping_bar(s, path, (before, over, on, gone), 1.0)
    guests = tuple(replace(guest, start=round(0.5 * (over + on)), end=s.frames) for guest in swapped["guests"])
    return {"path": path, "guests": guests, "covers": (bar,)}


def twin_exchange(s: EffectSetting) -> Parts:
    """A near twin with the same pattern."""
    return _replace_by_guest(s, near_twin(s.shape, int(s.rng.integers(1 << 20))))


def mirror_exchange(s: EffectSetting) -> Parts:
    """The mirror image with the same pattern."""
    return _replace_by_guest(s, mirrored_shape(s.shape))


# --- what breaks the model -----------------------------------------------------------------------


def lens_distortion(s: EffectSetting) -> Parts:
    """A barrel, less often a pincushion."""
    k1 = float(s.rng.uniform(0.06, 0.2) * s.rng.choice([-1.0, -1.0, -1.0, 1.0]))
    camera = Pinhole(s.width, s.height, k1=k1, k2=float(s.rng.uniform(-0.02, 0.04)))
    return {"path": s.course(camera, reach=0.9), "camera": camera}


def thick_part(s: EffectSetting) -> Parts:
    """Sides darker or lighter than the upper face."""
    return _thick(s, s.course(tilt=math.radians(25.0)), 0.15)


def thick_6(s: EffectSetting) -> Parts:
    """As most flat parts are."""
    return _thick(s, s.course(tilt=math.radians(20.0)), 0.06)


def oblique_start(s: EffectSetting) -> Parts:
    """As thick, its sides on view in the first image; the camera comes over it."""
    path = from_aside(s.shape, s.course(tilt=0.0), Pinhole(s.width, s.height), lean=math.radians(25.0), seed=s.seed)
    return _thick(s, path, 0.1)


def _thick(s: EffectSetting, path: Path, most: float) -> Parts:
    thickness = float(s.rng.uniform(0.02, most))
    return {"path": path, "thickness": thickness, "shade": float(s.rng.choice([0.55, 0.7, 1.2]))}


def rolling_shutter(s: EffectSetting) -> Parts:
    """A quick camera whose sensor is read out in 60 to 90 % of the time from frame to frame."""
    path = s.course(speed=14.0, spin=2.5, reach=0.7, cycles=max(1.6, s.frames / 28.0))
    return {"path": path, "light": {"readout": float(s.rng.uniform(0.6, 0.9))}}

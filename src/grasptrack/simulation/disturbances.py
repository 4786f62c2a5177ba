# SPDX-License-Identifier: Apache-2.0
"""The scenes of the suite: what can happen to a part in front of a camera, each by its name."""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from grasptrack.errors import InputError
from grasptrack.simulation.camera import Camera, Path
from grasptrack.simulation.conditions import Conditions, Shadow
from grasptrack.simulation.courses import astray, course
from grasptrack.simulation.hand import bar_over, hand_over
from grasptrack.simulation.looks import Look, another_surface, look
from grasptrack.simulation.outlines import Shape
from grasptrack.simulation.scene import Guest, Scene
from grasptrack.simulation.shapes import SHAPES
from grasptrack.simulation.texture import Texture
from grasptrack.simulation.twins import best_fit, mirror_symmetric, mirrored, near_twin

Group = Literal["motion", "image", "cover", "identity", "model"]

OTHER = 0.12
"""sqrt(area) by which a part that takes the object's place differs from it at least."""


@dataclass(frozen=True)
class Setting:
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

    def course(self, camera: Camera | None = None, **options: Any) -> Path:
        """A gentle path with some tilt, its options as in `courses.course`; speeds are those of a 640 px wide image."""
        scale = self.width / 640.0
        given: dict[str, Any] = {"tilt": math.radians(15.0), "speed": 4.0, **options}
        given["speed"] *= scale
        return course(
            self.shape,
            self.frames,
            self.seed,
            camera=camera if camera is not None else Camera(self.width, self.height),
            size=self.size,
            start=self.start,
            **given,
        )

    def at(self, *shares: float) -> tuple[float, ...]:
        """Frames at shares of the sequence."""
        return tuple(share * self.frames for share in shares)

    def view(self, path: Path) -> float:
        """Table units from the middle of the image to its corner, where the camera is farthest."""
        focal = float(Camera(self.width, self.height).matrix[0, 0])
        return 0.5 * math.hypot(self.width, self.height) / focal * float(path.distance.max()) + 0.5


Parts = dict[str, Any]
"""Arguments of a `Scene` that a disturbance sets; `light` are changes of its conditions."""


@dataclass(frozen=True)
class Disturbance:
    """One kind of scene.

    Attributes:
        name: as in tables and on the command line.
        about: one plain line.
        group: "motion", "image", "cover", "identity", or "model" for what breaks the model of a flat part and a pinhole.
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
        """The scene of a part: it starts in view as a whole, uncovered and frontal.

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
        drawn: Look = look(shape.name, seed)
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
        )
        base = {
            "blur": float(rng.uniform(0.65, 0.95)),
            "noise": float(rng.uniform(1.0, 3.0)),
            "vignette": float(rng.uniform(0.0, 0.15)),
            "drift": float(rng.uniform(0.0, 0.04)),
        }
        parts = self.make(setting)
        light = {**base, **parts.pop("light", {})}
        options = {"camera": Camera(width, height), **parts}
        return Scene(
            shape,
            table=table if table is not None else drawn.table,
            surface=own,
            conditions=Conditions(pooled=True, **light),
            colour=colour,
            seed=int(rng.integers(1 << 31)),
            name=f"{self.name} of {shape.name}, seed {seed}",
            **options,
        )


def applicable(shape: Shape, name: str) -> bool:
    """Whether a disturbance makes sense for a part: a mirror-symmetric one has no mirror image of its own.

    Raises:
        InputError: no such disturbance.
    """
    if name not in DISTURBANCES:
        raise InputError(f'unknown disturbance "{name}"; choose from {", ".join(DISTURBANCES)}', name=name)
    return name != "mirror" or not mirror_symmetric(shape)


# --- motion --------------------------------------------------------------------------------------


def _clean_4dof(s: Setting) -> Parts:
    return {"path": s.course(tilt=0.0)}


def _clean_6dof(s: Setting) -> Parts:
    return {"path": s.course(tilt=math.radians(25.0))}


def _fast(s: Setting) -> Parts:
    return {"path": s.course(tilt=math.radians(20.0), speed=20.0, spin=6.0, reach=0.7, cycles=2.4)}


def _belt(s: Setting) -> Parts:
    px, angle = s.rng.uniform(2.0, 6.0), s.rng.uniform(0.0, 2.0 * math.pi)
    step = px / 175.0
    return {"path": s.course(speed=2.5), "slide": (step * math.cos(angle), step * math.sin(angle))}


def _leave(s: Setting) -> Parts:
    side = float(s.rng.choice([-0.5, 0.5]) * math.pi + s.rng.uniform(-0.35, 0.35))
    path, camera = s.course(speed=2.5, reach=0.25), Camera(s.width, s.height)
    out, there, back, home = s.at(0.1, 0.42, 0.58, 0.9)
    return {"path": astray(s.shape, path, camera, direction=side, share=1.0, times=(out, there, back, home))}


def _clip(s: Setting) -> Parts:
    side, share = float(s.rng.uniform(0.0, 2.0 * math.pi)), float(s.rng.uniform(0.25, 0.4))
    path, camera = s.course(speed=2.5, reach=0.25), Camera(s.width, s.height)
    out, there, back, home = s.at(0.12, 0.42, 0.65, 0.92)
    return {"path": astray(s.shape, path, camera, direction=side, share=share, times=(out, there, back, home))}


# --- image ---------------------------------------------------------------------------------------


def _noise(s: Setting) -> Parts:
    return {"path": s.course(), "light": {"noise": float(s.rng.uniform(8.0, 16.0))}}


def _blur(s: Setting) -> Parts:
    return {"path": s.course(), "light": {"blur": float(s.rng.uniform(2.0, 3.5))}}


def _light(s: Setting) -> Parts:
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


def _shadow(s: Setting) -> Parts:
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


def _motion_blur(s: Setting) -> Parts:
    path = s.course(speed=12.0, spin=4.0, reach=0.6, cycles=1.6)
    return {"path": path, "light": {"exposure": float(s.rng.uniform(0.4, 0.7))}}


# --- covers --------------------------------------------------------------------------------------


def _bar(s: Setting) -> Parts:
    path = s.course()
    level = float(s.rng.uniform(30.0, 210.0))
    bar = bar_over(
        s.shape,
        _four(s.at(0.15, 0.5, 0.5, 0.85)),
        share=0.3,
        angle=float(s.rng.uniform(0.0, 2.0 * math.pi)),
        view=s.view(path),
        colour=(level * 0.97, level, level * 1.01),
    )
    return {"path": path, "covers": (bar,)}


def _hand(s: Setting) -> Parts:
    path = s.course()
    hand = hand_over(
        s.shape,
        _four(s.at(0.15, 0.38, 0.65, 0.88)),
        share=0.3,
        side=float(s.rng.uniform(0.0, 2.0 * math.pi)),
        aside=float(s.rng.uniform(-0.25, 0.25)),
        view=s.view(path),
        seed=int(s.rng.integers(1 << 20)),
    )
    return {"path": path, "covers": (hand,)}


def _four(at: tuple[float, ...]) -> tuple[float, float, float, float]:
    a, b, c, d = at
    return a, b, c, d


# --- identity ------------------------------------------------------------------------------------


def _guest(s: Setting, shape: Shape, surface: Texture | None = None) -> Parts:
    start, end = (round(f) for f in s.at(0.35, 0.65))
    return {"path": s.course(), "guests": (Guest(max(1, start), end, shape, surface),)}


def _exchange(s: Setting) -> Parts:
    names = [str(name) for name in s.rng.permutation(list(SHAPES))]
    for name in names:
        other = SHAPES[name]()
        if best_fit(other, s.shape).distance > OTHER and other.radius() < 1.3 * max(1.0, s.shape.radius()):
            break
    return _guest(s, other.moved(float(s.rng.uniform(0.0, 2.0 * math.pi))), another_surface(s.level, s.rng))


def _twin(s: Setting) -> Parts:
    return _guest(s, near_twin(s.shape, int(s.rng.integers(1 << 20))))


def _mirror(s: Setting) -> Parts:
    return _guest(s, mirrored(s.shape))


# --- what breaks the model -----------------------------------------------------------------------


def _lens(s: Setting) -> Parts:
    k1 = float(s.rng.uniform(0.06, 0.2) * s.rng.choice([-1.0, -1.0, -1.0, 1.0]))
    camera = Camera(s.width, s.height, k1=k1, k2=float(s.rng.uniform(-0.02, 0.04)))
    return {"path": s.course(camera, reach=0.9), "camera": camera}


def _thick(s: Setting) -> Parts:
    thickness = float(s.rng.uniform(0.02, 0.15))
    path = s.course(tilt=math.radians(25.0))
    return {"path": path, "thickness": thickness, "shade": float(s.rng.choice([0.55, 0.7, 1.2]))}


DISTURBANCES: dict[str, Disturbance] = {
    d.name: d
    for d in (
        Disturbance("clean-4dof", "The camera shifts, turns and zooms, always frontal.", "motion", _clean_4dof),
        Disturbance("clean-6dof", "The camera also tilts, up to 25 degrees.", "motion", _clean_6dof),
        Disturbance("noise", "Noise of 8 to 16 grey levels.", "image", _noise),
        Disturbance("blur", "The lens is out of focus: a blur of 2 to 3.5 px.", "image", _blur),
        Disturbance("light", "Uneven light that drifts, and jumps three times.", "image", _light),
        Disturbance("shadow", "A soft shadow crosses table and part.", "image", _shadow),
        Disturbance("motion-blur", "The exposure lasts 40 to 70 % of a frame, at up to 12 px a frame.", "image", _motion_blur),
        Disturbance("fast", "Up to 20 px and 6 degrees from frame to frame.", "motion", _fast),
        Disturbance("belt", "The table slides under the part.", "motion", _belt),
        Disturbance("bar", "A bar sweeps over the part and hides up to 30 % of its outline.", "cover", _bar),
        Disturbance("hand", "A hand comes, hides 30 % of the outline for a while, and goes.", "cover", _hand),
        Disturbance("leave", "The part leaves the image altogether and comes back.", "motion", _leave),
        Disturbance("clip", "The border cuts off up to 25 to 40 % of the outline for a while.", "motion", _clip),
        Disturbance("exchange", "Another part lies in its place for a while.", "identity", _exchange),
        Disturbance("twin", "A near twin, with one notch or tab, lies in its place for a while.", "identity", _twin),
        Disturbance("mirror", "Its mirror image lies in its place for a while.", "identity", _mirror),
        Disturbance("lens", "The lens distorts, as a wide one does.", "model", _lens),
        Disturbance("thick", "The part is 2 to 15 % of its size thick, and its sides show under tilt.", "model", _thick),
    )
}  # fmt: skip
"""Every disturbance by its name."""

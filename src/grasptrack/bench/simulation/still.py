# SPDX-License-Identifier: Apache-2.0
"""Several parts on one table, seen from straight above: a scene to choose a grasp in."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from grasptrack.bench.simulation.conditions import Conditions
from grasptrack.bench.simulation.outlines import Shape
from grasptrack.bench.simulation.render import Renderer
from grasptrack.bench.simulation.shapes import SHAPES
from grasptrack.bench.simulation.surfaces import brushed_texture
from grasptrack.bench.simulation.tables import plain_texture

PX_PER_UNIT = 130.0
"""Scale of the image; a part's area is its size squared."""
LIE = (
    ("spanner", 1.0, -1.0, -0.7, 0.5),
    ("gasket", 1.0, 0.75, 0.8, 0.35),
    ("rectangle", 0.75, 1.55, -0.75, -0.3),
    ("disc", 0.6, -1.2, 0.95, 0.0),
)
"""Name, size, x, y in table units, turn in rad of each part."""


def still_life(seed: int = 3, *, width: int = 640, height: int = 480) -> NDArray[np.uint8]:
    """(height, width, 3) BGR: a spanner, a gasket, a plate and a disc on a laminate.

    Args:
        seed: of textures and noise.
        width: px.
        height: px.
    """
    parts = []
    for name, size, x, y, turn in LIE:
        cos, sin = size * math.cos(turn), size * math.sin(turn)
        parts += [ring @ np.array([[cos, sin], [-sin, cos]]) + (x, y) for ring in SHAPES[name]().polygons]
    scale = PX_PER_UNIT * width / 640
    H = np.array([[scale, 0.0, 0.5 * (width - 1)], [0.0, scale, 0.5 * (height - 1)], [0.0, 0.0, 1.0]])
    together = Shape("parts", parts[0], tuple(parts[1:]))  # rendered by the even-odd rule, which parts apart obey too
    light = Conditions(blur=0.75 * width / 640, noise=1.0, vignette=0.14)
    view = Renderer(
        together, plain_texture(seed), brushed_texture(seed), width=width, height=height, blur=light.blur, colour=True
    )
    rng = np.random.default_rng((seed, 19))
    return view.expose(view.light(H), rng, light)

# SPDX-License-Identifier: Apache-2.0
"""inspect.json: how well an object can be tracked, for other programs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from grasptrack.io.results import software_versions, to_strict_json

if TYPE_CHECKING:
    from grasptrack.trackability import Suitability
    from grasptrack.trackability.result import Held, Texture

FORMAT = 3
"""Raised when a key changes its meaning or goes away; new keys alone do not raise it."""

_to_json_value = partial(to_strict_json, digits=6)


def inspection_to_dict(
    found: Suitability, name: str, shape: tuple[int, ...], options: Mapping[str, Any]
) -> dict[str, Any]:
    """An inspection as plain values; lengths in px, the centre of the top-left pixel at (0, 0), x right and y down.

    Args:
        found: what was found.
        name: the image's, as the user gave it.
        shape: height and width of the image.
        options: what was asked for.
    """
    models, run = found.motions.models, found.prediction
    return {
        "format": FORMAT,
        "image": {"name": name, "width": shape[1], "height": shape[0]},
        "options": dict(options),
        "versions": software_versions(),
        "level": found.level,
        "verdict": found.verdict,
        "reasons": [reason._asdict() for reason in found.reasons],
        "strategy": found.strategy,
        "located": _to_json_value(found.located),
        "located_interval": _to_json_value(list(found.located_interval)),
        "error_px": _to_json_value(found.error_px),
        "error_interval_px": _to_json_value(list(found.error_interval)),
        "drawn": None if run is None else {key: _to_json_value(value) for key, value in run.drawn._asdict().items()},
        "object": {key: _to_json_value(value) for key, value in found.looks._asdict().items()},
        "motions": [
            {**m._asdict(), "shown": _to_json_value(m.shown), "observed": list(m.observed)}
            for m in found.motions.motions
        ],
        "models": {
            key: {"observable": m.observable, "weakest": _to_json_value(m.weakest), "least": m.least}
            for key, m in models.items()
        },
        "symmetry": {
            "known": found.symmetry.known,
            "every_turn": found.symmetry.every,
            "turns_deg": _to_json_value(np.array(found.symmetry.turns)),
        },
        "equals": [_to_json_value(view.outer.points) for view in found.equals],
        "peaks": _to_json_value(found.peaks),
        "strategies": {u.name: {"usable": not u.reason, "reason": u.reason} for u in found.strategies},
        "texture": {"surface": _texture_entry(found.surface), "ground": _texture_entry(found.ground)},
        "fixed_by": found.by,
        "evidence_px": None if found.settled is None else _evidence_entry(found.settled.deviations),
        "grasp": None if found.grasp is None else _grasp_entry(found.grasp),
        "outline": [_to_json_value(contour.points) for contour in found.view.contours],
    }


def _evidence_entry(deviations: tuple[float, float, float]) -> dict[str, Any]:
    return dict(zip(("outline", "surface", "ground"), _to_json_value(list(deviations)), strict=True))


def _texture_entry(texture: Texture) -> dict[str, Any]:
    return {key: _to_json_value(value) for key, value in texture._asdict().items()}


def _grasp_entry(grasp: Held) -> dict[str, Any]:
    return {
        "contacts": _to_json_value(grasp.contacts),
        "opening_px": _to_json_value(grasp.opening),
        "margin_deg": _to_json_value(math.degrees(grasp.margin)),
        "stable": grasp.stable,
        "chance": _to_json_value(grasp.chance),
        "sigma_px": _to_json_value(grasp.sigma),
        "covariance_px2": _to_json_value(grasp.covariance),
        "limit_px": _to_json_value(grasp.limit),
        "tolerance_px": _to_json_value(grasp.tolerance),
    }

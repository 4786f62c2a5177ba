# SPDX-License-Identifier: Apache-2.0
"""transfer.json: a grasp in two images, for other programs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from grasptrack.io.results import software_versions

if TYPE_CHECKING:
    from grasptrack.tracking.image_pair import Outcome, Place
    from grasptrack.typing import Floats

FORMAT = 1
"""Raised when a key changes its meaning or goes away; new keys alone do not raise it."""


def transfer_to_dict(
    images: tuple[str, str],
    contacts: Floats,
    outcomes: Sequence[Outcome],
    places: Sequence[Place],
    ambiguous: str,
    options: Mapping[str, Any],
) -> dict[str, Any]:
    """A transfer as plain values; lengths in px, the centre of the top-left pixel at (0, 0), x right and y down.

    Args:
        images: names of both, as the user gave them.
        contacts: (k, 2) px in the first.
        outcomes: of the registration and of each strategy.
        places: where the contacts may be in the second, where nothing tells which.
        ambiguous: what the image cannot tell, in words; empty where it tells all.
        options: what was asked for.
    """
    return {
        "format": FORMAT,
        "images": list(images),
        "options": dict(options),
        "versions": software_versions(),
        "contacts": contacts.tolist(),
        "believed": any(not o.reason for o in outcomes),
        "outcomes": [_outcome_entry(o) for o in outcomes],
        "ambiguous": ambiguous,
        "places": [{"contacts": p.contacts.tolist(), "share": p.share, "turn_deg": p.turn} for p in places],
    }


def _outcome_entry(outcome: Outcome) -> dict[str, Any]:
    """Of one strategy: contacts only where they are believed, as everywhere."""
    believed, analysis = not outcome.reason, outcome.analysis
    shown = believed and analysis is not None
    return {
        "strategy": outcome.strategy,
        "believed": believed,
        "confidence": outcome.confidence,
        "reason": outcome.reason,
        "reason_code": outcome.code,
        "contacts": outcome.contacts.tolist() if believed and outcome.contacts is not None else None,
        "off_px": outcome.off if math.isfinite(outcome.off) else None,
        "stable": analysis.stable if shown and analysis is not None else None,
        "margin_deg": math.degrees(analysis.margin) if shown and analysis is not None else None,
    }

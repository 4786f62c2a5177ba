# SPDX-License-Identifier: Apache-2.0
"""Every instance of known parts in one image: where a part may lie, each pose made exact, each place decided by itself.

Outlines of the image say where a part may lie, whole or in pieces; the tracker's estimator makes each pose exact, and its
decision, which asks the edges of the image, says which is believed. A part turned over is one more outline that may explain
a place; where two explain one, the image must have so much more evidence for one of them as the risk asks for.
"""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Any

import numpy as np
from numpy.typing import NDArray

from grasptrack import arguments, kernels
from grasptrack.equality import compared_by_value
from grasptrack.errors import ConditioningError, ContourError
from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import apply_homography, normalize_homography
from grasptrack.grasp.force_closure import GraspAnalysis
from grasptrack.images import to_bgr
from grasptrack.presentation import to_dict
from grasptrack.segmentation.candidate import is_same_region
from grasptrack.tracking.claims import (
    LEAST_OVERLAP,
    SMALLEST,
    PartClaim,
    PartSearch,
    PartSide,
    Ways,
    claims_beside,
    claims_by_votes,
    claims_in_plane,
    claims_of,
    sides_of,
    ways_onto_part,
    ways_onto_whole,
)
from grasptrack.tracking.evidence import contact_testimony
from grasptrack.tracking.messages import StatusReason
from grasptrack.tracking.numbers import DEFAULT_RISK, NUMBERS
from grasptrack.tracking.parts import KnownPart, as_parts, prepare_once
from grasptrack.tracking.places import ImagePyramids, PlaceSearch, overlap_share
from grasptrack.tracking.single import UNKNOWN_PRESENCE
from grasptrack.typing import Floats

CORES = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
"""Hypotheses that are made exact at a time."""
TURNED_OVER, WHICH_PART = "turned-over", "which-part"


@compared_by_value
@dataclass(frozen=True, eq=False)
class Instance:
    """A part in an image. Contacts are there where it is believed, turned over or not; `found` says that it can be grasped.

    Attributes:
        part: its name.
        homography: (3, 3) from the part's image to this one; it mirrors where the part is turned over.
        view: its outline in this image, px.
        contacts: (k, 2) px of the part's first grasp; None where it is not believed.
        covariance: (k, 2, 2) px^2 of the contacts; None with them.
        confidence: 0 to 1, the complement of the probability that a contact is off by more than 3 px and 4 % of sqrt(area),
            or on something else.
        mirrored: it is turned over: its lower side is seen.
        seen: (k,) 0 to 1, how much of each contact was observed; None with them.
        edge: 0 to 1, the share of its outline whose own edge was observed.
        room: px behind each finger's pad up to the nearest neighbour, the least of all fingers; infinite where the fingers
            have all the room that they need.
        analysis: of the grasp, in the part's image; None with the contacts.
        turns: degrees of other turns by which its outline fits as well and which its surface does not tell apart: the
            contacts are those of one of them, and equal by the outline alone.
        any_turn: it is round, as a disc or a ring, and nothing tells how far it is turned: contacts are those of one turn, and
            `covariance` is theirs on it.
        reason: empty where it is found, else a short sentence.
        reason_code: the reason in one word, see `messages.SENTENCES`.
    """

    part: str
    homography: Floats
    view: View
    contacts: Floats | None
    covariance: Floats | None
    confidence: float
    mirrored: bool
    seen: Floats | None
    edge: float
    room: float
    analysis: GraspAnalysis | None
    turns: tuple[float, ...] = ()
    any_turn: bool = False
    reason: str = ""
    reason_code: str = ""

    @property
    def found(self) -> bool:
        """Whether it is believed, the right way up."""
        return not self.reason_code

    def __repr__(self) -> str:
        """One line: the part, and where."""
        x, y = self.view.outer.points.mean(axis=0).tolist()
        return f"Instance({self.part} at {x:.0f},{y:.0f}, {self.reason_code or f'confidence {self.confidence:.4f}'})"

    def to_dict(self) -> dict[str, Any]:
        """Its attributes by name as plain values, for JSON and data frames; what is not finite is None."""
        return to_dict(self)


@arguments.checked(
    image=arguments.array(unbounded=True),
    risk=arguments.number,
    ignore=arguments.optional(arguments.array(unbounded=True)),
)
def find(
    image: NDArray[Any],
    parts: KnownPart | Sequence[KnownPart],
    *,
    risk: float = DEFAULT_RISK,
    ignore: NDArray[Any] | None = None,
) -> list[Instance]:
    """Every instance of known parts in an image: any turn, scales of 0.4 to 2.5, tilts to 45 degrees.

    Args:
        image: 8 or 16 bit, grey, BGR or BGRA.
        parts: what to look for, one part or several of different names; of two that look alike in the image neither is found.
        risk: probability, between 0 and 1, below which an answer may be wrong: less refuses more.
        ignore: (H, W) nonzero where nothing belongs to the scene; None where all does.

    Returns:
        Those that are found first, the easiest to grasp first: with room for the fingers, uncovered, sure. Then those turned
        over, then what looks like a part and is not believed, each with its reason. No two of the first two share a place.

    Raises:
        InputError: no part, two parts of one name, a risk out of range, or a mask of another size.
        SourceError: no image.
    """
    colours = to_bgr(image)
    said = FirstImage.of(ignore=ignore).within(colours.shape)
    numbers = NUMBERS.with_risk(risk)
    scene = ImagePyramids(colours)
    settled, doubted, new = list[PartClaim](), list[PartClaim](), list[PartClaim]()
    tried: dict[Ways, list[View]] = {ways_onto_whole: [], ways_onto_part: []}

    def two_sides(part: KnownPart) -> list[PartSide]:
        return prepare_once(part, numbers.risk, partial(sides_of, part, numbers.risk))

    with ThreadPoolExecutor(CORES) as pool:
        kinds = list(chain.from_iterable(pool.map(two_sides, as_parts(parts))))
        regions = PlaceSearch(colours, said, SMALLEST * min(kind.outline.size for kind in kinds))
        search = PartSearch(kinds, scene, regions.find_spots(), set(), pool)
        while True:
            new = []
            for ways, before in tried.items():
                fresh = [p for p in search.places if not any(is_same_region(p.rough.view, view) for view in before)]
                before += [p.rough.view for p in fresh]
                new, refused = _settle_claims(claims_of(fresh, ways, search), settled, numbers.risk)
                doubted += refused
                if new:
                    break
            if not new:
                _, doubted = _settle_claims(doubted, settled, numbers.risk)
            for again in (claims_in_plane, claims_by_votes, claims_beside, claims_in_plane):
                if not new:
                    new, doubted = _settle_claims(again(settled, doubted, search), settled, numbers.risk)
            if not new:
                break
            settled += new
            regions.leave_out([claim.view for claim in new])
            search = search._replace(places=regions.find_spots())
    beside = [p.image_view for p in search.places]
    outlines = [claim.view for claim in settled]
    outlines += [v for v in beside if not any(overlap_share(v, o) > LEAST_OVERLAP for o in outlines)]
    answers = [_instance_of(claim, outlines) for claim in [*settled, *doubted]]
    return sorted(answers, key=lambda a: (not a.found, not a.mirrored, -a.room, -a.edge, -a.confidence))


def _instance_of(claim: PartClaim, others: list[View]) -> Instance:
    """A claim as it is told, beside other outlines of the image."""
    kind, estimate, believed = claim.kind, claim.estimate, claim.code in ("", TURNED_OVER)
    return Instance(
        kind.part.name,
        normalize_homography(claim.H @ kind.part.flip) if kind.mirrored else claim.H,
        claim.view,
        estimate.contacts if believed else None,
        estimate.covariance if believed else None,
        claim.decision.confidence,
        kind.mirrored,
        contact_testimony(claim.state, estimate) if believed else None,
        estimate.edge_share,
        _finger_room(kind.taught, claim.H, [v for v in others if v is not claim.view]),
        kind.grasp_analysis if believed else None,
        claim.turns,
        claim.any_turn,
        StatusReason(claim.code, claim.decision.figures).sentence if claim.code else "",
        claim.code,
    )


# --- which of them is believed ---------------------------------------------------------------------


def _settle_claims(
    claims: list[PartClaim], known: list[PartClaim], risk: float
) -> tuple[list[PartClaim], list[PartClaim]]:
    """Those claims that are believed, each place once, and for each other place the best of those that are not."""
    settled: list[PartClaim] = []
    refused: list[PartClaim] = []
    left = [c for c in sorted(claims, key=lambda c: -c.evidence) if not any(c.shares_place(k) for k in known)]
    while left:
        best, left = left[0], left[1:]
        here = [c for c in left if c.shares_place(best)]
        left = [c for c in left if c not in here]
        rival = next((c for c in here if c.kind is not best.kind), None)
        if rival is not None:
            best.rival_evidence = max(best.rival_evidence, rival.evidence)
        if best.code == "" and best.evidence - best.rival_evidence < -math.log(risk):
            best.code = WHICH_PART
        if best.code == "" and best.kind.mirrored:
            best.code = TURNED_OVER
        (settled if best.code in ("", TURNED_OVER) else refused).append(best)
    return settled, [c for c in refused if c.decision.presence > UNKNOWN_PRESENCE]


def _finger_room(part: KnownPart, H: Floats, beside: list[View]) -> float:
    """px of the part's image behind the pads up to the nearest outline of an image, the least of all fingers."""
    back, (width, depth) = np.linalg.inv(H), part.finger
    contacts, ways = part.grasps[0].contacts, part.directions[0]
    across = np.column_stack([-ways[:, 1], ways[:, 0]])
    corners = [contacts - far * ways + aside * across for far in (0.0, depth) for aside in (-width, width)]
    low, high = np.full(2, -math.inf), np.full(2, math.inf)
    with suppress(ConditioningError):
        ends = apply_homography(H, np.concatenate(corners))
        low, high = ends.min(axis=0), ends.max(axis=0)
    least = math.inf
    for view in beside:
        first, last = view.outer.bounds
        if (first > high).any() or (last < low).any():
            continue
        try:
            outer = View(view.outer).transformed(back)
        except (ConditioningError, ContourError):
            continue
        rooms = kernels.finger_clearance(outer.points, outer.offsets, contacts, ways, None, width, depth, width)
        least = min(least, float(rooms[:, 1].min()))
    return least

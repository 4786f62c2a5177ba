# SPDX-License-Identifier: Apache-2.0
"""Equals that are followed together: which of them lies where, by the one motion that explains all that an image shows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from grasptrack.tracking.emptiness import place_is_empty
from grasptrack.tracking.equals import NOTICED, ONE_PLACE, Way, way_density
from grasptrack.tracking.evidence import MAX_EXPONENT
from grasptrack.tracking.follower import Follower, Sight
from grasptrack.tracking.pose import CONTINUOUS, carried_in_front, contact_tolerance, share_in_view, worst_variance
from grasptrack.tracking.rivals import ALIKE_SHARE
from grasptrack.tracking.target import Grey
from grasptrack.typing import Floats

EMPTY_RIGHT = 0.999
"""Probability that no part lies where the ground of its surroundings is seen all over its place."""
FIT = 0.1
"""Share of a way by which perspective lets parts err that all went that way."""

SAME_WAY = 3.0
"""px by which motions differ that are one."""


class _Places(NamedTuple):
    """Places on a part in an image: their middle (2,) px, and (m, 2) px where they lie about it."""

    middle: Floats
    about: Floats

    @staticmethod
    def of(at: Floats) -> _Places:
        """Of places (m, 2) px."""
        middle = at.mean(axis=0)
        return _Places(middle, at - middle)


class _Member(NamedTuple):
    """One of some equals in an image.

    Attributes:
        follower: of it.
        sight: of the image.
        way: where it would be, had it moved as is expected.
        before, now: places on it as expected and as found; `now` is None where it is not found.
        beside: (n, 2) px, its middle as expected on equals that are known and not followed.
    """

    follower: Follower
    sight: Sight
    way: Way
    before: _Places
    now: _Places | None
    beside: Floats

    def is_empty_now(self, shift: Floats) -> bool:
        """Whether the image shows most of the place (2,) px beside the expected one, and nothing in it."""
        return self._is_empty(_shifted(self.way.G, shift), self.sight.levels)

    def was_empty(self, shift: Floats) -> bool:
        """The same of the last image, and of the place that has come to lie (2,) px beside the expected one."""
        G = self.way.last @ np.linalg.inv(self.way.G) @ _shifted(self.way.G, shift)
        return self._is_empty(np.asarray(G / G[2, 2], dtype=np.float64), self.follower.state.last.levels)

    def _is_empty(self, G: Floats, levels: list[Grey]) -> bool:
        state = self.follower.state
        return place_is_empty(state.target, state.located, levels, G, on_ground=False)

    def is_shown(self, shift: Floats) -> bool:
        """Whether the image shows a part (2,) px beside the expected place."""
        share, grey = self.follower.redetection.samples.edge_share, self.sight.levels[0]
        G = _shifted(self.way.G, shift)
        least = ALIKE_SHARE * self.follower.target.edge_share
        return share_in_view(G, self.follower.target.outline, grey) == 1.0 and share(grey, G) >= least


def alias_probabilities(followers: Sequence[Follower], sights: Sequence[Sight]) -> list[float]:
    """Probability of each of some equals that what it is taken for is another one, all of them having moved together.

    Each is where it was found, or all went another way, as what lies on one belt does, and each is taken for another one.
    What speaks against a motion is a place that it leaves a part in and that is seen to be empty, and a part that was
    seen to be nowhere before. Where nothing does, a way is as probable as for one object alone, see `alias_probability`.

    Args:
        followers: of equals, none of which was lost before the image.
        sights: theirs, of the image.
    """
    members = [_member_of(f, s) for f, s in zip(followers, sights, strict=True)]
    found = [m for m in members if m.now is not None]
    odds = dict.fromkeys(map(id, found), 0.0)
    own = {id(m): m.now.middle - m.before.middle for m in found if m.now is not None}
    if len(members) > 1 and found:
        usual = np.median(list(own.values()), axis=0)
        ways = _other_ways(found, members)
        # what all of them do is as probable as for that one of which most is known
        shares = np.min([_density_ratios(m, own[id(m)], ways) for m in found], axis=0)
        least = NOTICED * found[0].follower.state.numbers.risk / max(1, len(ways))
        against_own = sum(m.is_empty_now(usual) for m in members if m.now is None)
        tried: list[Floats] = []
        for k in np.argsort(-shares, kind="stable").tolist():
            way, share = ways[k], float(shares[k])
            if share < least or any(math.hypot(*(way - known).tolist()) < SAME_WAY for known in tried):
                continue
            tried.append(way)
            told = _log_odds(way, usual, members, math.log(least / share))
            told -= against_own * math.log(1.0 - EMPTY_RIGHT)
            for m in found:
                if (
                    m.now is not None and not _compare(m.before, way, [m.now], m, way)[0]
                ):  # else it went that way itself
                    odds[id(m)] += share * math.exp(min(told, MAX_EXPONENT))
    return [odds[id(m)] / (1.0 + odds[id(m)]) if id(m) in odds else 0.0 for m in members]


def _member_of(follower: Follower, sight: Sight) -> _Member:
    target, way, decision = follower.target, follower.expected_way(sight), sight.decision
    # of what fits itself turned, only the middle is known to be the same
    places = target.outline.mean(axis=0)[None] if target.turns or target.is_round else target.work_contacts
    shows = decision.estimate is not None and decision.presence > 0.5 and decision.evidence > 0.0
    now = carried_in_front(decision.estimate.G, places) if shows and decision.estimate is not None else None
    if decision.estimate is not None and decision.estimate.origin not in CONTINUOUS:
        follower.rivals.shows_equals(follower.state.located)
    beside = carried_in_front(way.G, follower.state.equals + places.mean(axis=0))
    before = _Places.of(carried_in_front(way.G, places))
    return _Member(follower, sight, way, before, None if now is None else _Places.of(now), beside)


def _other_ways(found: Sequence[_Member], members: Sequence[_Member]) -> Floats:
    """(n, 2) px, the motions that would carry a part to where another one was found."""
    ways = []
    for m in found:
        if m.now is not None:
            ways += [m.now.middle - other.before.middle for other in members if other is not m]
            ways += list(m.now.middle - m.beside)
    told = np.array(ways).reshape(-1, 2)
    return told[np.isfinite(told).all(axis=1)]


def _density_ratios(member: _Member, own: Floats, ways: Floats) -> Floats:
    """(n,) how much more probable each of the ways (n, 2) is than its own, by what is known of how it moves."""
    estimate, spread = member.sight.decision.estimate, member.way.spread
    assert estimate is not None
    squares = np.append((ways**2).sum(axis=1), own @ own).clip(worst_variance(estimate.covariance)) / estimate.area
    density = 1.0 / squares if spread is None else way_density(squares, spread, member.follower.state.numbers)
    return np.asarray(density[:-1] / density[-1], dtype=np.float64)


def _log_odds(way: Floats, usual: Floats, members: Sequence[_Member], least: float) -> float:
    """What both images say for a way (2,) px of all, against each being where it was found; `least` is enough."""
    told, doubt = 0.0, math.log(1.0 - EMPTY_RIGHT)
    now, before = [n.now for n in members if n.now is not None], [n.before for n in members]
    for m in members:
        if told < least:
            break
        fits, occupied = _compare(m.before, way, now, m, way)
        if not fits:
            told += doubt * (occupied or m.is_empty_now(way))
            if m.now is not None and m.is_shown(way):  # nobody has found this part: where did it come from?
                told -= doubt * m.was_empty(way - usual)
        if m.now is None:
            continue
        fits, occupied = _compare(m.now, -way, before, m, way)
        if not fits:
            told += doubt * (occupied or m.was_empty(m.now.middle - m.before.middle - way))
    return told


def _compare(
    places: _Places, shift: Floats, others: Sequence[_Places], member: _Member, way: Floats
) -> tuple[bool, bool]:
    """Whether places of a member that went a way, moved by a shift (2,) px, are those of one of others, and whether both lie in
    one place."""
    estimate, state = member.sight.decision.estimate, member.follower.state
    area = state.target.area if estimate is None else estimate.area
    allowed = contact_tolerance(area, state.numbers)
    away = np.hypot(*(np.array([other.middle for other in others]) - (places.middle + shift)).T)
    near = np.nonzero(away <= allowed + FIT * math.hypot(*way.tolist()))[0].tolist()
    fits = any(
        len(others[k].about) == len(places.about)
        and float(np.hypot(*(places.about - others[k].about).T).max()) <= allowed
        for k in near
    )
    return fits, bool((away < ONE_PLACE * math.sqrt(area)).any())


def _shifted(G: Floats, shift: Floats) -> Floats:
    """(3, 3) a pose moved by (2,) px in the image."""
    return np.asarray(np.array([[1.0, 0.0, shift[0]], [0.0, 1.0, shift[1]], [0.0, 0.0, 1.0]]) @ G, dtype=np.float64)

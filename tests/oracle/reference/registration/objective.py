# SPDX-License-Identifier: Apache-2.0
"""What an estimated pose makes least: prior, camera, texture and edges as weighted squares about it.

The unknowns x (12,) are the pose's error d (8,) and the nuisances, as they are: the part's thickness in work px and theta, see
`Pinhole`. Each term is half of (r - J x)^T W (r - J x); robust terms have the weights that they have at the pose.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from grasptrack.kernels import FINE_LEVELS, LEAST_HALF_WIDTH, MOST_HALF_WIDTH
from grasptrack.statistics import MAD_TO_SD
from grasptrack.typing import Floats, Ints
from reference.registration.camera import Pinhole, pinhole_rows
from reference.registration.edges import (
    Candidates,
    EdgeNumbers,
    Light,
    edge_likelihoods,
    explain_outline,
    is_other_light,
    measure_edges,
    misplaced_edge_log_ratio,
    surface_light,
)
from reference.registration.pyramid import Pyramid, clamp_to_int, transform_points, upper_median
from reference.registration.target import Target, bent
from reference.registration.texture import (
    AGREEING,
    CHANCE,
    LEAST_PATCHES,
    Matches,
    join_matches,
    match_patches,
    texture_weights,
)

MOST_THETA = 1.2
"""Of the log of the focal length, and of the normal's slopes: a view beyond it is not believable."""
ENOUGH_EDGES = 30
"""Samples of the outline below which its edges are not looked at."""
LEAST_REACH, MOST_REACH, FARTHEST = 4, 30, 1000
"""Work px within which edges are looked for; the last bounds what a caller may ask for."""
MOST_SPAN = 46
"""Work px of a profile on either side of a sample, at most."""
EDGE_ROUNDS = 20
"""Times that edges are explained and fitted: till the explanation stays."""
STILL_FROM, STILL_SHARE = 1.0, 0.25
"""px that the object's middle has moved from which on what stands still is none of it, and share of that which is still."""
NEVER = 1e-12
"""Share of a state that is left out."""


@dataclass(frozen=True)
class Start:
    """What `PoseTarget.solve` is asked, by its names: a hypothesis, and what else is known."""

    G: Floats
    P: Floats
    last: Floats
    bend: Floats
    readout: float
    nuisance: Floats
    nuisance_covariance: Floats
    sides: float
    inner_spread: float
    gain: float
    bias: float
    reach: float
    edge_width: float
    blur_share: float
    aspect: float


class Term(NamedTuple):
    """(m, 12) J, (m,) r and (m, m) W of half of (r - J x)^T W (r - J x)."""

    J: Floats
    r: Floats
    W: Floats


class Explained(NamedTuple):
    """Edges as they are explained: the term, (9, 9) scatter of its scores, and which candidate counts how much.

    `share` (n, candidates, 2) is that of each candidate in its sample's edge, of the upper and of the lower face.
    """

    term: Term
    scatter: Floats
    view: Candidates
    share: Floats


class Objective:
    """The terms about a pose.

    Args:
        target, pyramid, start, numbers: what is looked for, where, what is known, and `grasptrack.tracking.numbers` by name.
        G: (3, 3) the pose.

    Attributes:
        terms: by name.
        A, b: (12, 12), (12,) their sum: half of x^T A x - b^T x, but for a constant.
        x: (12,) where it is least.
        P: (12, 12) covariance of x, which allows for residuals of the edges that are correlated along the outline.
    """

    def __init__(self, target: Target, pyramid: Pyramid, start: Start, numbers: dict[str, float], G: Floats) -> None:
        self.target, self.pyramid, self.start, self.numbers, self.G = target, pyramid, start, numbers, G
        height, width = pyramid[0].grey.shape
        self.size = float(width), float(height)
        n = len(target.points)
        self.shares = np.array([numbers[f"share_{state}"] for state in ("object", "occluded", "other")])
        self.stay = float(np.exp(-1.0 / (numbers["stretch"] * n))) if n else 0.0
        gaps = np.hypot(*(target.points - np.roll(target.points, -1, axis=0)).T)
        self.power = min(1.0, float(upper_median(gaps) / numbers["sample_distance"])) if n else 0.0
        self.edge_numbers = EdgeNumbers(
            numbers["edge_missed"], numbers["same_sign"], numbers["edge_floor"], start.inner_spread,
            numbers["other_spread"], start.sides,
        )  # fmt: skip
        self.light = surface_light(target, pyramid, G, Light(start.gain, start.bias))
        self.places = self._seen_at(target.points, target.jacobian(target.points))
        camera = Pinhole(target, start.nuisance[1:], *self.size, start.aspect)
        # sides that the first view showed count the other way
        self.parallax = camera.lower_face(target, G) - camera.lower_face(target, target.A)
        nuisance, spread, P = start.nuisance, start.nuisance_covariance, None
        for _ in range(4):  # the weights depend on the answer
            self.theta = nuisance[1:]
            self.terms = self.expected_terms(nuisance)
            A, b = _reduced(*_summed(self.terms), 8)
            matches = self.matches(G)
            weight = texture_weights(matches, A, b, numbers)
            self.terms["texture"] = _texture_term(matches, weight)
            alone = np.linalg.inv(_reduced(*_summed(self.terms), 8)[0])
            P, scatter = alone if P is None else P, np.zeros((12, 12))
            if n >= ENOUGH_EDGES:
                variance = ((target.rows @ P) * target.rows).sum(axis=1).max()
                reach = clamp_to_int(3.0 * np.sqrt(variance) + 3.0, LEAST_REACH, MOST_REACH)
                self.edges = self._explained_edges(reach, alone, nuisance[0], spread[0, 0])
                self.terms["edges"], scatter[:9, :9] = self.edges.term, self.edges.scatter
            self.A, self.b = _summed(self.terms)
            inverse = np.linalg.inv(self.A)
            self.x, self.P = inverse @ self.b, inverse + inverse @ scatter @ inverse
            P, spread = self.P[:8, :8], self.P[8:, 8:]
            nuisance = np.concatenate([np.maximum(self.x[8:9], 0.0), np.clip(self.x[9:], -MOST_THETA, MOST_THETA)])

    def expected_terms(self, nuisance: Floats) -> dict[str, Term]:
        """What is expected of the pose and allowed by a camera, the pinhole about these nuisances (4,)."""
        n, start, target = self.numbers, self.start, self.target
        eye = np.eye(12)
        d, information = target.difference(start.G, self.G), np.linalg.inv(start.P)
        weight = (n["prior_freedom"] + 8.0) / (n["prior_freedom"] + max(8.0, d @ information @ d))
        known = np.linalg.inv(start.nuisance_covariance)
        terms = {
            "prior": Term(eye[:8], -d, weight * information),
            "nuisances": Term(eye[8:], start.nuisance, known),
            "perspective": Term(
                eye[6:8], self.perspective(self.G), np.eye(2) / (n["perspective"] * target.radius) ** 2
            ),
        }
        pin = pinhole_rows(target, self._all_at_once(self.G), nuisance[1:], *self.size, self.start.aspect)
        if pin.valid:
            J = np.column_stack([pin.by_pose, np.zeros(2), pin.by_camera])
            rest = pin.misfit - pin.by_camera @ nuisance[1:]
            off = rest + pin.by_camera @ start.nuisance[1:]
            own = n["pinhole_sd"] ** 2
            C = own * np.eye(2) + pin.by_camera @ start.nuisance_covariance[1:, 1:] @ pin.by_camera.T
            far = off @ np.linalg.solve(C, off)
            weight = (n["pinhole_freedom"] + 2.0) / (n["pinhole_freedom"] + max(2.0, far))
            terms["pinhole"] = Term(J, -rest, weight / own * np.eye(2))
        return terms

    def perspective(self, G: Floats) -> Floats:
        """(2,) minus the perspective of a pose against the first view, work px at the half size."""
        r = self.target.radius
        return np.asarray(G[2, :2] * r / (G[2, :2] @ self.target.centre + G[2, 2]) * r)

    def matches(self, G: Floats) -> Matches:
        """The patches of the finest levels on the image seen through a pose G (3, 3)."""
        floor, noise, sets = self.numbers["texture_floor"], self.target.noise, self.target.texture[:FINE_LEVELS]
        here, still = (
            join_matches([match_patches(self.pyramid, H, s, at(s), noise, floor * s.stride) for s in sets])
            for H, at in ((G, lambda s: self._seen_at(s.places, s.rows)), (self.target.A, lambda s: s.places))
        )
        points = np.concatenate([self.target.centre[None], *(s.places for s in sets)])
        pairs = (np.array(transform_points(H, *points.T)) for H in (G, self.target.A))
        middle, *ways = np.hypot(*np.subtract(*pairs))
        if middle > STILL_FROM:  # what the first view had there as well is the lens's or the camera's
            own = (here.correlation > AGREEING) & (np.array(ways) > STILL_SHARE * middle)
            asked = here.inside & ~own
            there = asked & (still.correlation > AGREEING)
            if there.sum() >= LEAST_PATCHES + CHANCE * asked.sum():
                here = here._replace(inside=here.inside & ~there)
        return here

    def candidates(self, G: Floats, reach: int) -> Candidates:
        """The edges on the normals of the image seen through a pose G (3, 3)."""
        half = self._half_widths(G)
        return measure_edges(self.target, self.pyramid, G, self.places, reach, half, self.light, MOST_SPAN)

    def _seen_at(self, points: Floats, J: Floats) -> Floats:
        """(n, 2) work px, where points (n, 2), which tell shifts by J (n, 2, 8), are seen, by the readout that is believed."""
        return points + self.start.readout * bent(self.start.bend, J)

    def _all_at_once(self, G: Floats) -> Floats:
        """What a readout makes of a pose, no camera that sees all rows at once would show."""
        return self.target.moved(G, self.start.readout * self.start.bend[0])

    def _half_widths(self, G: Floats) -> Ints:
        """(n,) of the edge filter: two standard deviations of an edge at rest, and half of what moved across it."""
        inverse, (x, y) = np.linalg.inv(G), self.target.points.T
        u, v = transform_points(inverse @ self.start.last, x, y)
        speed = np.nan_to_num(np.abs((u - x) * self.target.normals[:, 0] + (v - y) * self.target.normals[:, 1]))
        rest = clamp_to_int(2.0 * self.start.edge_width, LEAST_HALF_WIDTH, MOST_HALF_WIDTH)
        wide = np.clip(rest + self.start.blur_share * speed, LEAST_HALF_WIDTH, MOST_HALF_WIDTH)
        return np.asarray(wide.astype(np.int64))

    def _log_likelihood(self, light: Light, reach: int, P: Floats, h: float, vh: float) -> float:
        """That of the edges, of which a light tells how the outline's inner side looks."""
        self.light, none = light, np.zeros(len(self.parallax))
        view, low = self.candidates(self.G, reach), self.parallax**2 * vh
        found = edge_likelihoods(self.target, view, none, self.parallax * h, low, P, self.edge_numbers)
        return explain_outline(found.object, found.other, self.power, self.shares, self.stay)[1]

    def _explained_edges(self, reach: int, P: Floats, h: float, vh: float) -> Explained:
        """Edges and thickness by expectation and maximisation: which candidate is whose edge, then the pose.

        Args:
            reach: work px within which edges are looked for.
            P: (8, 8) covariance of the pose's error without them.
            h, vh: work px, thickness and its variance.
        """
        rows, along, parallax = self.target.rows, self.target.along, self.parallax
        before = Light(self.start.gain, self.start.bias)
        if is_other_light(self.target, self.light, before):  # or most is covered: by the outline's inner side
            self.light = max((self.light, before), key=lambda light: self._log_likelihood(light, reach, P, h, vh))
        view, n = self.candidates(self.G, reach), len(rows)
        A, b = _reduced(*_summed(self.terms), 9)
        d = P @ _reduced(*_summed(self.terms), 8)[1]
        both = np.concatenate([np.pad(rows, ((0, 0), (0, 1))), np.column_stack([rows, parallax])])
        for _ in range(EDGE_ROUNDS):
            shift, low = rows @ d, parallax * h
            found = edge_likelihoods(self.target, view, shift, low, parallax**2 * vh, P, self.edge_numbers)
            own, _ = explain_outline(found.object, found.other, self.power, self.shares, self.stay)
            seen = np.concatenate([found.upper * own[:, 0], found.lower * own[:, 0]])
            offset = np.concatenate([found.upper_offset, found.lower_offset])
            off = offset - np.concatenate([shift, shift + low])
            likelier = np.where(seen[:n] > seen[n:], off[:n], off[n:])[seen[:n] + seen[n:] > 0.5]
            variance = 4.0
            if len(likelier) > 10:
                spread = MAD_TO_SD * float(upper_median(np.abs(likelier)))
                variance = self.numbers["edge_noise"] ** 2 + spread**2
            weight = seen / variance * self.power / (1.0 + off**2 / (9.0 * variance))
            own_A = (both * weight[:, None]).T @ both
            P9 = np.linalg.inv(A + own_A)
            x = P9 @ (b + both.T @ (weight * offset))
            d, P, h, vh = x[:8], P9[:8, :8], max(0.0, x[8]), P9[8, 8]
        sideways = (along * ((weight[:n] + weight[n:]) * self.target.normal_noise**2)[:, None]).T @ along
        telling = beyond_noise(own_A, sideways, 1.0)
        lower = seen[n:] >= seen[:n]
        residual = np.where(lower, offset[n:] - parallax * h, offset[:n]) - rows @ d
        pull = (weight[:n] + weight[n:]) * residual
        scores = np.where(lower[:, None], both[n:], both[:n]) @ telling.T * pull[:, None]
        J = np.pad(both @ telling.T, ((0, 0), (0, 3)))
        return Explained(Term(J, offset, np.diag(weight)), scatter_of(scores), view, found.share)

    def measured(self, name: str, G: Floats) -> Floats:
        """(m,) the r of a term measured anew at a pose G (3, 3) nearby, with the same weights and explanations."""
        if name == "prior":
            return -self.target.difference(self.start.G, G)
        if name == "perspective":
            return self.perspective(G)
        if name == "pinhole":
            camera = Pinhole(self.target, self.theta, *self.size, self.start.aspect)
            return self.terms["pinhole"].J[:, 9:] @ self.theta - camera.misfit(self._all_at_once(G))
        if name == "texture":
            return self.matches(G).shift.ravel()
        old, new = self.edges.view, self.candidates(G, self.edges.view.reach)
        expected = old.offset - (self.target.rows @ self.target.difference(self.G, G))[:, None]
        away = np.nan_to_num(np.abs(new.offset[:, None] - expected[:, :, None]), nan=np.inf)
        near = np.take_along_axis(new.offset, away.argmin(axis=2), axis=1)
        offset = np.where(away.min(axis=2) < 1.0, near, expected)  # or else it is none of its old neighbours
        return (self.edges.share * np.nan_to_num(offset)[:, :, None]).sum(axis=1).T.ravel()


class OutlineEvidence(NamedTuple):
    """What the outline tells of a pose: as the fields of `PoseEstimate` of these names."""

    visible: Floats
    occluded: Floats
    other: Floats
    log_odds: float
    elsewhere: float
    astray: float


def outline_evidence(objective: Objective, P: Floats) -> OutlineEvidence:
    """The evidence at the pose of an objective, P (8, 8) the covariance of its error, of a part without thickness."""
    o, n = objective, len(objective.target.points)
    numbers, size = o.numbers, 2.0 * o.target.radius
    view, none = o.candidates(o.G, clamp_to_int(numbers["wide"] * size, 0, FARTHEST)), np.zeros(n)
    found = edge_likelihoods(o.target, view, none, none, none, P, o.edge_numbers)
    states, here = explain_outline(found.object, found.other, o.power, o.shares, o.stay)
    share = np.array([NEVER, o.shares[1], o.shares[2] + o.shares[0]])
    _, without = explain_outline(np.ones(n), found.other, o.power, share / share.sum(), o.stay)
    # two standard deviations of a pose that is a little off are as much as a contact may be off
    sigma = max(numbers["tolerance_px"], numbers["tolerance"] * size) / 2.0
    astray = o.power * states[:, 2] @ misplaced_edge_log_ratio(o.target, view, o.edge_numbers, sigma)
    visible = states[:, 0] * (found.upper + found.lower)
    return OutlineEvidence(visible, states[:, 1], states[:, 2], here - without, states[:, 2].sum() / n, float(astray))


def beyond_noise(own: Floats, along: Floats, noise: float) -> Floats:
    """(9, 9) by which rows of the edges are to be multiplied from the right, transposed.

    Along a motion under which the outline stays on itself, as a disc turned, exact normals tell nothing; noise in them seems to
    tell all the same (errors in variables). Of information that is so many times that of noise alone, what is beyond counts.

    Args:
        own: (9, 9) the edges' information, of the pose and of the thickness.
        along: (8, 8) the same of motions along the outline.
        noise: rad^2, variance of the normals' directions.
    """
    out = np.eye(9)
    try:
        L = np.linalg.cholesky(noise * along)
    except np.linalg.LinAlgError:
        return out
    inverse = np.linalg.inv(L)
    values, Q = np.linalg.eigh(inverse @ own[:8, :8] @ inverse.T)
    beyond = np.maximum(0.0, 1.0 - 1.0 / np.maximum(values, 1e-12))
    out[:8, :8] = L @ (Q * beyond) @ Q.T @ inverse
    return out


def scatter_of(scores: Floats) -> Floats:
    """(k, k) of scores (n, k) that are correlated with their neighbours along the outline (Newey and West 1987)."""
    lags = max(3, int(0.06 * len(scores)))
    near = sum((1.0 - q / lags) * np.roll(scores, q, axis=0) for q in range(1, lags))
    cross = scores.T @ near
    return np.asarray(scores.T @ scores + cross + cross.T)


def _texture_term(matches: Matches, weight: Floats) -> Term:
    blocks = [w * np.array([[xx, xy], [xy, yy]]) for w, (xx, xy, yy) in zip(weight, matches.weight, strict=True)]
    J = np.pad(matches.rows.reshape(-1, 8), ((0, 0), (0, 4)))
    return Term(J, matches.shift.ravel(), block_diag(*blocks) if blocks else np.zeros((0, 0)))


def _summed(terms: dict[str, Term]) -> tuple[Floats, Floats]:
    A = sum((J.T @ W @ J for J, _, W in terms.values()), np.zeros((12, 12)))
    return A, sum((J.T @ W @ r for J, r, W in terms.values()), np.zeros(12))


def _reduced(A: Floats, b: Floats, count: int) -> tuple[Floats, Floats]:
    """The equations of the leading unknowns, the others eliminated: whatever these may be is allowed for."""
    share = np.linalg.solve(A[count:, count:], np.column_stack([A[count:, :count], b[count:]]))
    off = A[:count, count:]
    return A[:count, :count] - off @ share[:, :-1], b[:count] - off @ share[:, -1]

# SPDX-License-Identifier: Apache-2.0
"""One hypothesis of the pose, made exact, and the evidence for it.

Gauss-Newton on edges, texture, thickness and what a pinhole allows, with a prior of heavy tails.
"""

from __future__ import annotations

import numpy as np

from grasptrack.kernels import FINE_LEVELS, LEAST_HALF_WIDTH, MOST_HALF_WIDTH
from grasptrack.statistics import MAD_TO_SD
from grasptrack.typing import Floats, Ints
from reference.registration.camera import Pinhole
from reference.registration.edges import (
    Candidates,
    EdgeNumbers,
    edge_likelihoods,
    edge_widths,
    measure_edges,
    misplaced_edge_log_ratio,
    surface_light,
)
from reference.registration.occlusion import (
    NEVER,
    RegionNumbers,
    forward_backward,
    has_boundary,
    other_shape,
)
from reference.registration.pyramid import (
    Pyramid,
    clamp_to_int,
    inverse_definite,
    inverse_homography,
    transform_points,
    upper_median,
)
from reference.registration.system import (
    Beliefs,
    Solution,
    Start,
    System,
    beyond_noise,
    bounded_nuisance,
    learned_nuisances,
    scatter_of,
    system_about,
    with_correlated,
)
from reference.registration.target import Target, bent
from reference.registration.texture import (
    Matches,
    TextureFit,
    TextureNumbers,
    empty_fit,
    fit_patches,
    is_informative,
    join_matches,
    match_patches,
)

ROUNDS, DIRECT, TEXTURE_ROUNDS = 8, 4, 3
FIRST_EDGE_ROUNDS, EDGE_ROUNDS = 3, 4
"""Times that edges are weighed: after the first step they are looked for anew anyway."""
ENOUGH_EDGES = 30
"""Samples of the outline below which its edges are not looked at."""
LEAST_REACH, MOST_REACH, FARTHEST = 4, 30, 1000
"""Work px within which edges are looked for; the last bounds what a caller may ask for."""
MOST_SPAN = 46
"""Work px of a profile on either side of a sample, at most."""
STILL, FAST = 1.0, 4.0
"""Work px that may move across an edge for its width to be that at rest, and widths at rest that must for its blur to tell."""
RAMP = 0.6267
"""sqrt(pi / 8): the width that `edge_widths` gives a ramp, of its half length."""
FEW_EDGES = 20
"""Edges that must tell."""
SETTLED = 0.02
"""Work px: a step that moves no contact by more is the last."""
EXACT = 0.002
"""The same where edges are weighed anew."""
LEAST_TOLD = 1e-9
"""Information about a readout that is none."""
NEAR = 0.3
"""Of a patch's pixel: a step that is no larger is the last on its level. The edges' steps go on with the texture."""


class Solver:
    """A target, an image and a hypothesis.

    Args:
        target: what is looked for.
        pyramid: where.
        start: the hypothesis.
        numbers: by name, see `grasptrack.tracking.numbers.Numbers`.
    """

    def __init__(self, target: Target, pyramid: Pyramid, start: Start, numbers: dict[str, np.float64]) -> None:
        self.target, self.pyramid, self.start, self.numbers = target, pyramid, start, numbers
        self.height, self.width = (float(side) for side in pyramid[0].grey.shape)
        self.texture_numbers = TextureNumbers(
            numbers["texture_floor"], numbers["texture_independent"], numbers["texture_freedom"]
        )
        self.edge_numbers = EdgeNumbers(
            numbers["edge_missed"],
            numbers["same_sign"],
            numbers["edge_floor"],
            start.inner_spread,
            numbers["other_spread"],
            np.float64(start.sides),
        )
        self.shares = np.array([numbers["share_object"], numbers["share_occluded"], numbers["share_other"]])
        n = len(target.points)
        self.stay = float(np.exp(-1.0 / (numbers["stretch"] * n)))
        gaps = np.hypot(*(target.points - np.roll(target.points, -1, axis=0)).T)
        spacing = upper_median(gaps) if n > 1 else np.float64(1.0)
        self.power = min(1.0, float(spacing / numbers["sample_distance"]))
        J = target.jacobian(target.points)
        self.places = self._seen_at(target.points, J)
        self.bent = (bent(start.bend, J) * target.normals).sum(axis=1)  # work px along the normals, for a readout of 1
        self.rows, self.weight, self.pull = np.zeros((0, 9)), np.zeros(0), np.zeros(0)
        camera = Pinhole(target, start.nuisance[1:], self.width, self.height)
        self.camera, self.first_sides = camera, camera.lower_face(target, target.A)

    def solve(self) -> Solution:
        """The pose near the hypothesis that image, prior and camera model agree on."""
        out, start, target = Solution(), self.start, self.target
        prior, nuisance_prior = inverse_definite(start.P), inverse_definite(start.nuisance_covariance)
        if prior is None or nuisance_prior is None:
            return out
        self.beliefs = Beliefs(prior, nuisance_prior)
        found = self._texture_alone(start.G)
        if found is None:
            return out
        G, P, nuisance, spread = found, start.P, start.nuisance, start.nuisance_covariance
        edges = len(target.points) >= ENOUGH_EDGES
        first = clamp_to_int(start.reach, 0, FARTHEST)
        reach, settled, d = first, False, np.zeros(8)
        for round_ in range(ROUNDS):
            system = self._linearize_about(G, nuisance)
            if system is None:
                return out
            A, b = system.reduced(8)
            texture = self._fit_texture(G, A, b, out)
            system.add(texture.information, texture.gradient)
            A, b = A + texture.information, b + texture.gradient
            inverse = inverse_definite(A)
            if inverse is None:
                return out
            P, scatter = inverse, np.zeros((9, 9))
            out.light = surface_light(target, self.pyramid, G, self.start.light)
            if edges:
                if round_ == 0 and start.reach > 0:
                    reach = first
                elif round_ == 0 or reach == 0:
                    reach = self._search_reach(P, 2.5)
                view = measure_edges(
                    target, self.pyramid, G, self.places, reach, self._half_widths(G), out.light, MOST_SPAN
                )
                rounds = EDGE_ROUNDS if round_ else FIRST_EDGE_ROUNDS
                fitted = self._fit_edges(rounds, view, G, P @ b, P, nuisance[0], spread[0, 0], system, out)
                if fitted is None:
                    return out
                scatter = fitted
            inverse = inverse_definite(system.A)
            if inverse is None:
                return out
            unknowns, x = inverse, inverse @ system.b
            every = with_correlated(inverse, scatter)
            P, spread = every[:8, :8], every[8:, 8:]
            # what does not settle goes to and fro between two answers
            d = np.clip(x[:8] if round_ < DIRECT else 0.5 * x[:8], -target.radius, target.radius)
            nuisance = bounded_nuisance(x[8:])
            learned = learned_nuisances(system, scatter, target.radius)
            if learned is None:
                return out
            out.nuisance, out.nuisance_covariance = learned
            moved = self._contacts_moved(d)
            G = target.moved(G, d)
            if not np.isfinite(G).all():
                return out
            if edges:
                reach = clamp_to_int(self._search_reach(P, 3.0) + moved, LEAST_REACH, MOST_REACH)
            settled = moved < SETTLED and round_ > 0
            # after the first few, what moves by less than half its own standard deviation is not worth another
            if settled or (round_ + 1 >= DIRECT and moved < 0.5 * self._contacts_deviation(P)):
                break
        self._tell_readout(unknowns, x, texture, out)
        P = P + np.outer(d, d)  # an answer that still moves is not known better than by its last step
        if not settled:  # else the last step moved none of them
            self.matches = self._match_levels(0, FINE_LEVELS, G)
        out.G, out.P, out.valid = G, P, True
        self._evaluate_evidence(out, edges, nuisance[0], spread[0, 0])
        return out

    def _seen_at(self, points: Floats, J: Floats) -> Floats:
        """(n, 2) work px, where points (n, 2), which tell shifts by J (n, 2, 8), are seen, by the readout that is believed."""
        start = self.start
        return points if start.readout == 0.0 else points + start.readout * bent(start.bend, J)

    def _contacts_deviation(self, P: Floats) -> float:
        """Work px, standard deviation of a contact along an axis at most, by the covariance P (8, 8) of the pose's error."""
        J = self.target.jacobian(self.target.contacts)
        return float(np.sqrt(_max_ignoring_nan(((J @ P) * J).sum(axis=2))))

    def _contacts_moved(self, d: Floats) -> float:
        """Work px by which the pose's error d (8,) moves a contact at most, along an axis."""
        return _max_ignoring_nan(np.abs(self.target.jacobian(self.target.contacts) @ d))

    def _linearize_about(self, G: Floats, nuisance: Floats) -> System | None:
        size = self.width, self.height
        return system_about(self.target, self.start, self.numbers, self.beliefs, size, G, nuisance)

    # --- texture --------------------------------------------------------------------------------

    def _match_levels(self, first: int, end: int, G: Floats) -> Matches:
        """All patches of the levels from `first` to `end`."""
        floor, noise = self.numbers["texture_floor"], self.target.noise
        sets = self.target.texture[first:end]
        return join_matches(
            [match_patches(self.pyramid, G, s, self._seen_at(s.places, s.rows), noise, floor * s.stride) for s in sets]
        )

    def _texture_alone(self, G: Floats) -> Floats | None:
        """The pose by texture, coarse to fine, before edges are looked at: their candidates are many, its valley is wide."""
        target = self.target
        J = target.jacobian(target.contacts)
        far = _max_ignoring_nan(np.sqrt(((J @ self.start.P) * J).sum(axis=2)))  # work px within which the pose is known
        for level, patches in reversed(list(enumerate(target.texture))):
            if len(patches) < 4 or (level > 0 and far < patches.stride):
                continue
            for _ in range(TEXTURE_ROUNDS):
                system = self._linearize_about(G, self.start.nuisance)
                if system is None:
                    break
                A, b = system.reduced(8)
                fit = fit_patches(self._match_levels(level, level + 1, G), A, b, self.texture_numbers)
                if not is_informative(fit, len(patches)):
                    break
                P = inverse_definite(A + fit.information)
                if P is None:
                    return None
                d = P @ (b + fit.gradient)
                G = target.moved(G, d)
                if not np.isfinite(G).all():
                    return None
                if np.abs(d).max() < NEAR * patches.stride:
                    break
        return G

    def _fit_texture(self, G: Floats, A: Floats, b: Floats, out: Solution) -> TextureFit:
        """The finest levels; coarser ones tell where blur has taken the finest one."""
        matches = self.matches = self._match_levels(0, FINE_LEVELS, G)
        if len(matches.inside) < 4:
            return empty_fit()
        fit = fit_patches(matches, A, b, self.texture_numbers)
        out.texture_used, out.texture_agreeing, out.texture_spread = fit.used, fit.agreeing, fit.spread
        return fit if is_informative(fit, len(matches.inside)) else empty_fit()

    # --- edges ----------------------------------------------------------------------------------

    def _search_reach(self, P: Floats, deviations: float) -> int:
        """Work px within which edges are looked for, by the pose's covariance."""
        variance = ((self.target.rows @ P) * self.target.rows).sum(axis=1)
        return clamp_to_int(deviations * np.sqrt(_max_ignoring_nan(variance)) + 3.0, LEAST_REACH, MOST_REACH)

    def _moved_across(self, G: Floats) -> Floats:
        """(n,) work px that moved across each sample's edge since the image before."""
        inverse = inverse_homography(G)
        if inverse is None:
            return np.zeros(len(self.target.points))
        x, y = self.target.points.T
        u, v = transform_points(inverse @ self.start.last, x, y)
        speed = np.abs((u - x) * self.target.normals[:, 0] + (v - y) * self.target.normals[:, 1])
        return np.where(np.isnan(speed), 0.0, speed)

    def _motion_blur(self, G: Floats) -> Floats:
        """(n,) work px, half of what moves across each sample's edge while it is exposed."""
        return self.start.blur_share * self._moved_across(G)

    def _half_widths(self, G: Floats) -> Ints:
        """(n,) of the edge filter: two standard deviations of an edge at rest, and the way that it moves."""
        rest = clamp_to_int(2.0 * self.start.edge_width, LEAST_HALF_WIDTH, MOST_HALF_WIDTH)
        wide = np.clip(rest + self._motion_blur(G), LEAST_HALF_WIDTH, MOST_HALF_WIDTH)
        return np.where(np.isnan(wide), LEAST_HALF_WIDTH, wide).astype(np.int64)

    def _learn_widths(self, G: Floats, half: Ints, seen: Floats, out: Solution) -> Floats:
        """How wide the edges are that are seen (n,), where next to nothing moves across them, and what much motion adds.

        Returns:
            (n,) half of what blurs each edge, as far as it moved, or where that is not known as wide as most edges are.
        """
        width, own = edge_widths(self.target, self.pyramid, G, self.places, half), np.float64(self.start.edge_width)
        moved, known = self._moved_across(G), bool(self.start.last[0, 0] == self.start.last[0, 0])
        told = (seen > 0.5) & ~np.isnan(width)
        rest, fast = told & (moved < STILL), told & (moved > STILL) & (moved > FAST * own)
        length = np.sqrt(np.where(width**2 - own**2 > 0.0, width**2 - own**2, 0.0)) / RAMP
        if known and rest.sum() > FEW_EDGES:
            out.edge_width = float(upper_median(width[rest]))
        if fast.sum() > FEW_EDGES:
            out.blur_share = min(1.0, float(upper_median(length[fast] / moved[fast])))
        if told.sum() > FEW_EDGES:
            out.blur = float(np.sort(length[told])[told.sum() * 3 // 4])
            if not known:
                return np.full(len(width), out.blur)
        return self._motion_blur(G)

    def _lower_face_parallax(self, G: Floats) -> Floats:
        """(n,) of the lower face, less what the first view showed, which counts the other way."""
        return self.camera.lower_face(self.target, G) - self.first_sides

    def _fit_edges(
        self,
        rounds: int,
        view: Candidates,
        G: Floats,
        d: Floats,
        P: Floats,
        h: np.float64,
        vh: np.float64,
        system: System,
        out: Solution,
    ) -> Floats | None:
        """Edges and thickness by expectation and maximisation: which candidate, then the pose, `rounds` times at most.

        Args:
            rounds, view, G: see above; the candidates are those about the pose G.
            d, P: the pose's error without them, and its covariance.
            h, vh: work px, thickness and its variance.
            system: their rows are added to it.
            out: what is told of them.

        Returns:
            (9, 9) scatter of their scores by pose and thickness; None where the pose is not determined.
        """
        rows, numbers = self.target.rows, self.numbers
        parallax = self._lower_face_parallax(G)
        A, b = system.reduced(9)
        last = d
        for round_ in range(rounds):
            if round_ > 1 and self._contacts_moved(d - last) < EXACT:
                break
            last, shift, low = d, rows @ d, parallax * h
            found = edge_likelihoods(self.target, view, shift, low, parallax**2 * vh, P, self.edge_numbers)
            own = forward_backward(found.object, found.other, self.power, self.shares, self.stay).states[:, 0]
            seen_up, seen_low = found.upper * own, found.lower * own
            up, down = found.upper_offset - shift, found.lower_offset - shift - low
            rest = np.where(seen_up > seen_low, up, down)
            seen = np.abs(rest[seen_up + seen_low > 0.5])
            variance = np.float64(4.0)
            if len(seen) > 10:
                variance = numbers["edge_noise"] ** 2 + (MAD_TO_SD * upper_median(seen)) ** 2
            weight_up = seen_up / variance * self.power / (1.0 + up**2 / (9.0 * variance))
            weight_low = seen_low / variance * self.power / (1.0 + down**2 / (9.0 * variance))
            weight = weight_up + weight_low
            # the ninth unknown is the thickness
            own_A, own_b, along = np.zeros((9, 9)), np.zeros(9), np.zeros((8, 8))
            upper, lower = np.pad(rows, ((0, 0), (0, 1))), np.column_stack([rows, parallax])
            for row, w, offset in ((upper, weight_up, found.upper_offset), (lower, weight_low, found.lower_offset)):
                counts = w > 1e-9
                weighed = row[counts] * w[counts, None]
                own_A += weighed.T @ row[counts]
                own_b += weighed.T @ offset[counts]
                along += (self.target.along[counts] * w[counts, None]).T @ self.target.along[counts]
            P9 = inverse_definite(A + own_A)
            if P9 is None:
                return None
            x = P9 @ (b + own_b)
            d, P, h, vh = x[:8], P9[:8, :8], max(np.float64(0.0), x[8]), P9[8, 8]
            out.edge_sigma = float(np.sqrt(variance))
        telling = beyond_noise(own_A, along, self.target.normal_noise**2)
        system.add(telling @ own_A @ telling.T, telling @ own_b)
        out.edge_share = float((seen_up + seen_low).sum()) / len(rows)
        least = np.where(view.there(), view.difference, 1e9).min(axis=1)[seen_up + seen_low > 0.5]
        out.look = float(upper_median(np.sqrt(least))) if len(least) > 20 else 0.0
        low_seen = seen_low >= seen_up
        residual = np.where(low_seen, found.lower_offset - parallax * h, found.upper_offset) - rows @ d
        self.rows, self.weight = np.where(low_seen[:, None], lower, upper) @ telling.T, weight
        self.pull = weight * residual
        return scatter_of(self.rows * self.pull[:, None])

    def _tell_readout(self, P: Floats, x: Floats, texture: TextureFit, out: Solution) -> None:
        """What edges and texture tell of the readout, and how the pose depends on it.

        Args:
            P, x: (12, 12) the unknowns' covariance, (12,) their values.
            texture: as it was matched last.
            out: what is told.
        """
        n, across = len(self.pull), np.zeros(len(x))  # information that it shares with them
        z = self.bent[:n]
        across[:9] = (self.weight * z) @ self.rows
        own, toward = float((self.weight * z) @ z), float(z @ self.pull)
        if len(texture.weight):
            m = self.matches
            xx, xy, yy = m.weight.T
            zx, zy = bent(self.start.bend, m.rows).T
            pull = texture.weight[:, None] * np.column_stack([xx * zx + xy * zy, xy * zx + yy * zy])
            both = np.einsum("ni,nij->j", pull, m.rows)
            across[:8] += both
            own += float(pull[:, 0] @ zx + pull[:, 1] @ zy)
            toward += float((pull * m.shift).sum() - both @ x[:8])
        by = P @ across
        information = own - float(across @ by)
        out.by_readout, out.readout = -by[:8], self.start.readout
        if not information > LEAST_TOLD:
            return
        scores = (z - self.rows @ by[:9]) * self.pull
        out.readout += toward / information
        out.readout_variance = (1.0 + float(scatter_of(scores[:, None])[0, 0]) / information) / information

    # --- evidence -------------------------------------------------------------------------------

    def _evaluate_evidence(self, out: Solution, edges: bool, h: np.float64, vh: np.float64) -> None:
        """The evidence at the answer, edges looked for much farther away than the answer's own uncertainty."""
        target, numbers = self.target, self.numbers
        n = len(target.points)
        out.visible, out.occluded, out.other = np.zeros(n), np.zeros(n), np.zeros(n)
        if edges:
            reach = clamp_to_int(numbers["wide"] * 2.0 * target.radius, 0, FARTHEST)
            half = self._half_widths(out.G)
            view = measure_edges(target, self.pyramid, out.G, self.places, reach, half, out.light, MOST_SPAN)
            parallax = self._lower_face_parallax(out.G)
            low, variance = parallax * h, parallax**2 * vh
            found = edge_likelihoods(target, view, np.zeros(n), low, variance, out.P, self.edge_numbers)
            here = forward_backward(found.object, found.other, self.power, self.shares, self.stay)
            share = np.array([NEVER, self.shares[1], self.shares[2] + self.shares[0]])
            without = forward_backward(np.ones(n), found.other, self.power, share / share.sum(), self.stay)
            out.log_odds = float(here.log_likelihood - without.log_likelihood)
            out.visible = here.states[:, 0] * (found.upper + found.lower)
            out.occluded, out.other = here.states[:, 1], here.states[:, 2]
            out.elsewhere = float(out.other.sum()) / n
            tells = np.abs(low) * here.states[:, 0]
            either = float(tells @ (found.upper + found.lower))
            if either > 0:
                out.sides = float(tells @ found.lower) / either
            allowed = max(float(numbers["tolerance_px"]), float(numbers["tolerance"]) * 2.0 * target.radius)
            sigma = allowed / 2.0  # two standard deviations are as much as a contact may be off
            out.astray = (
                float(out.other @ misplaced_edge_log_ratio(target, view, self.edge_numbers, sigma)) * self.power
            )
            blur = self._learn_widths(out.G, half, here.states[:, 0] * found.upper, out)
            regions = RegionNumbers(
                numbers["cell_unlikely"],
                numbers["cell_far"],
                numbers["cell_power"],
                numbers["cell_cover"],
                allowed,
            )
            ends = has_boundary(view, target.contrast)
            # what is faint beside its own edge may be a mark of its surface, on which a tab goes on
            seen = np.where(ends, out.visible, 0.0)
            out.other_shape, out.differs = other_shape(
                target,
                self.pyramid,
                out.G,
                self.places,
                seen,
                ends,
                blur,
                out.light,
                regions,
                self.shares,
                self.stay,
                self.power,
            )
        correlation = np.where(self.matches.inside, self.matches.correlation, np.nan)
        counts = [len(patches) for patches in target.texture[:FINE_LEVELS]]
        out.correlation = np.split(correlation, np.cumsum(counts)[:-1]) if counts else []


def _max_ignoring_nan(values: Floats) -> float:
    """The largest of some values, 0 at least; what is no number does not count."""
    return float(np.max(np.where(np.isnan(values), 0.0, values), initial=0.0))

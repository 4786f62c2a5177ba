# SPDX-License-Identifier: Apache-2.0
"""Independent regions of contact: how far contacts may slip along the outline, each as it likes ([13])."""

from __future__ import annotations

import math

import numpy as np

from grasptrack.typing import Bools, Floats, Ints


class Along:
    """Candidates along closed contours, evenly spaced, and what `rank_grasps` asks of them.

    Args:
        contacts: (m, 2) px.
        normals: (m, 2) unit, into the material.
        usable: (m,) False where no contact may slip to.
        starts: (C + 1,) contour c holds the candidates ``starts[c]:starts[c + 1]``.
        steps: (C,) px of arc length between them.
        friction: coefficient.
        centre: px, the point about which torques are taken.
        rho: px by which torques are divided.
    """

    def __init__(
        self,
        contacts: Floats,
        normals: Floats,
        usable: Bools,
        starts: Ints,
        steps: Floats,
        friction: float,
        centre: tuple[float, float],
        rho: float,
    ) -> None:
        self.contacts, self.normals, self.usable = contacts, normals, usable
        self.starts, self.steps, self.friction = starts, steps, friction
        self.home = np.repeat(np.arange(len(steps)), np.diff(starts))
        angle = math.atan(friction)
        every = np.arange(len(contacts))
        self.turn = np.zeros(len(contacts))
        for way in (-1, 1):
            other = np.array([self.moved(int(i), way) for i in every], dtype=np.int64)
            n, m = normals, normals[other]
            between = np.arctan2(np.abs(n[:, 0] * m[:, 1] - n[:, 1] * m[:, 0]), (n * m).sum(axis=1))
            self.turn = np.maximum(self.turn, between)
        self.cone = np.where(usable & (self.turn < angle), np.tan(np.clip(angle - self.turn, 0.0, None)), -1.0)
        arms, tangents = (contacts - centre) / rho, np.column_stack([-normals[:, 1], normals[:, 0]])
        forces = np.stack([normals + friction * tangents, normals - friction * tangents], axis=1)
        torque = arms[:, None, 0] * forces[..., 1] - arms[:, None, 1] * forces[..., 0]
        self.edges = np.concatenate([forces, torque[..., None]], axis=2)

    def step(self, i: int) -> float:
        """Px of arc length from a candidate to the next."""
        return float(self.steps[self.home[i]])

    def count(self, i: int) -> int:
        """Candidates on the contour of one of them."""
        c = self.home[i]
        return int(self.starts[c + 1] - self.starts[c])

    def moved(self, i: int, by: int) -> int:
        """The candidate so many steps farther along the same contour."""
        first = int(self.starts[self.home[i]])
        return first + (i - first + by) % self.count(i)

    def pair(self, a: int, b: int, needed: float, most: float) -> float:
        """Half-length in px of the regions of two contacts, at most `most`.

        Squares of pairs are tried ring by ring. Each is held to a narrower cone, by what a normal turns to the next
        candidate and the line with half a step at either end, so that what lies between candidates closes as well.
        Where not even the nearest candidates close so, the regions are a share of a step, from the friction to spare.
        """
        step_a, step_b = self.step(a), self.step(b)
        step, slip = min(step_a, step_b), (step_a + step_b) / 2
        limit = min(math.ceil(most / step - 1e-9), self.count(a) // 2, self.count(b) // 2)
        sense = 1.0 if self.normals[a] @ (self.contacts[b] - self.contacts[a]) > 0 else -1.0
        k = 0
        distance = math.dist(self.contacts[a], self.contacts[b])
        slant = slip * (1 + self.friction**2)
        if self._all_pairs_close([a], [b], sense, slant, 0.0):
            for k in range(1, limit + 2):
                if k > limit:
                    break
                around = range(-k, k + 1)
                near = distance - k * (step_a + step_b)
                lean = slant / near if near > 0.75 * distance else 0.0
                at_a = [self.moved(a, e) for e in around]
                at_b = [self.moved(b, e) for e in around]
                if not (
                    self._all_pairs_close([at_a[0], at_a[-1]], at_b, sense, slant, lean)
                    and self._all_pairs_close(at_a, [at_b[0], at_b[-1]], sense, slant, lean)
                ):
                    break
            k -= 1
        if k > 0:
            return min(k * step, most)
        spare = math.atan(self.friction) - math.atan(needed)
        change = max(float(self.turn[a]), float(self.turn[b])) + 2 * slip / distance
        return min(step, most, step * spare / (2 * change))

    def _all_pairs_close(self, first: list[int], second: list[int], sense: float, slant: float, lean: float) -> bool:
        """Whether every pair of one of `first` and one of `second` closes with room to spare.

        The line's slant by half a step at either end adds `lean` to the friction needed, slant / distance where it is 0.
        """
        d = self.contacts[second][None] - self.contacts[first][:, None]
        n, m = self.normals[first][:, None], self.normals[second][None]
        p = sense * (n[..., 0] * d[..., 0] + n[..., 1] * d[..., 1])
        q = -sense * (m[..., 0] * d[..., 0] + m[..., 1] * d[..., 1])
        cone_a, cone_b = self.cone[first][:, None], self.cone[second][None]
        if not ((p > 0) & (q > 0) & (cone_a > 0) & (cone_b > 0)).all():
            return False
        leans = lean or slant / np.hypot(d[..., 0], d[..., 1])
        at_a = np.abs(n[..., 0] * d[..., 1] - n[..., 1] * d[..., 0]) < (cone_a - leans) * p
        at_b = np.abs(m[..., 0] * d[..., 1] - m[..., 1] * d[..., 0]) < (cone_b - leans) * q
        return bool((at_a & at_b).all())

    def one_of_three(self, i: int, epsilon: float, most: float) -> float:
        """Half-length in px of the region of one contact of a grasp, at most `most`.

        As long as no edge of any cone moves by epsilon, in wrenches, the hull still holds the origin. What the next
        step would add counts too, for what lies between candidates.
        """
        step = self.step(i)
        limit = max(min(math.ceil(most / step - 1e-9), self.count(i) // 2), 1)
        first, k = 0.0, 0
        for far in range(1, limit + 1):
            good = True
            for way in (-1, 1):
                here, before = self.moved(i, way * far), self.moved(i, way * (far - 1))
                between = self._cone_edge_distance(here, before)
                if far == 1:
                    first = max(first, between)
                good &= bool(self.usable[here]) and self._cone_edge_distance(here, i) + between < epsilon
            if not good:
                break
            k = far
        if k > 0:
            return min(k * step, most)
        return min(step, most, step * epsilon / (2 * max(first, 1e-12)))

    def _cone_edge_distance(self, i: int, j: int) -> float:
        """The larger distance between corresponding edges of two candidates' cones, in wrenches."""
        return float(np.sqrt(((self.edges[i] - self.edges[j]) ** 2).sum(axis=1).max()))

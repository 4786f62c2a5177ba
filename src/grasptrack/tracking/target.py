# SPDX-License-Identifier: Apache-2.0
"""What is followed, as the estimator looks for it: outline, texture and contacts of the first view."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.geometry.contours import View
from grasptrack.geometry.homographies import HORIZON, apply_homography, behind_camera_error
from grasptrack.grasp.force_closure import FINGER_WIDTH
from grasptrack.tracking.numbers import Numbers
from grasptrack.typing import Bools, Floats

Grey = NDArray[np.uint8]

PATCH = 3
"""Pixels of its own level by which a patch reaches to either side of its middle."""
ALIKE = 0.5
"""Correlation from which on a patch shows the same, and share of its usual one."""
GUESSED_TILT = 0.01
"""Share of sqrt(area) by which the perspective of a pose may be off that no frame before tells."""
OPEN_SHAPE, OPEN_TILT = 0.3, 0.05
"""Shares by which the shape and the perspective of a pose may be off that nothing tells: what 45 degrees stretch, and bend in
an image that is 70 degrees wide, of which an object fills 0.15."""
FREELY = 1e-12
"""Mean square by which edges move at least, where an outline slides along itself and none moves."""
CONTACTS_FIRST = 1e6
"""By how much a contact counts for more than the whole outline where a bend is taken for a pose's error."""
POSE_ENTRIES = ((0, 2, 1), (1, 2, 1), (0, 0, 1), (0, 1, 1), (1, 0, 1), (1, 1, 1), (2, 0, -1), (2, 1, -1))
"""Row, column and sign of each number of the pose's error in the matrix that it is, in half sizes about the middle."""


def build_pyramid(grey: Grey) -> list[Grey]:
    """The image and its halves, down to some 30 px."""
    levels = [np.ascontiguousarray(grey)]
    while min(levels[-1].shape) >= 60:
        levels.append(as_grey(cv2.pyrDown(levels[-1])))
    return levels


def as_grey(image: NDArray[Any]) -> Grey:
    """What OpenCV made of a grey image, as one."""
    return np.asarray(image, dtype=np.uint8)


def hidden_levels(hidden: Grey) -> list[Grey]:
    """The mask (H, W) of what is hidden for each level of a pyramid: nonzero where any pixel that was averaged is."""
    levels = [as_grey(cv2.dilate((hidden != 0).astype(np.uint8), np.ones((5, 5), np.uint8)))]
    while min(levels[-1].shape) >= 60:
        levels.append((cv2.pyrDown(levels[-1] * 255) > 0).astype(np.uint8))
    return levels


@dataclass
class Recipe:
    """What a kernel's target is made of, so that a copy of it can be made in another process.

    Attributes:
        arguments: of `kernels.PoseTarget`.
        origin: width and middle (x, y) of the image that the first one was cut out of, or its own, px of the first one.
        hidden: pyramid of what is hidden, or None.
        textures: of each `add_texture`: the pyramid of the first image, (n, 2) work px, and work px between pixels.
    """

    arguments: tuple[Any, ...]
    origin: tuple[float, float, float]
    hidden: list[Grey] | None = None
    textures: list[tuple[list[Grey], Floats, float]] = field(default_factory=list)

    def build_target(self) -> Any:
        """A kernel's target; the same recipe always gives the same one."""
        made = kernels.PoseTarget(*self.arguments)
        made.taught_by(*self.origin)
        if self.hidden is not None:
            made.hide(self.hidden)
        for texture in self.textures:
            made.add_texture(*texture)
        return made


SIDE_DEPTH, MIN_SIDE_DEPTH = 0.06, 4.0
"""Share of sqrt(area), and work px, from the outline at which object and ground are looked at."""
SMALL_TURN = 1e-4
"""rad, of a difference that stands for a derivative."""
AGREED = 0.05
"""Work px at a round outline, to which its turn is agreed upon."""
SIDES = (-1.0, 1.0, 3.0)
"""How far outside the outline samples lie, in that."""
SIDE_CLEAR = 0.7
"""How far from all of the outline samples of the ground lie at least, in that."""


SATURATED = 250
"""Grey level from which on a sensor may have shown no more, as compressed images tell it."""
GLARE = 9
"""Work px, the width of a glare that hides what is under it: of a narrower one the edges on both sides are in reach."""


@dataclass(frozen=True)
class Target:
    """The object and the grasp in the first view.

    Attributes:
        view: its outline in px of the first image.
        contacts: (k, 2) px of the first image.
        area: px^2 in the first image.
        A: (3, 3) work px -> px of the first image.
        crop: width and height of the rectified first view, work px.
        centre: (2,) work px, about which the pose's error is told.
        size: sqrt(area) in work px.
        work_contacts: (k, 2) work px.
        outline: (N, 2) work px, of the outer contour, for drawing and overlap.
        corners: (n, 2) work px, places at which motion from image to image is measured.
        ring: (n, 2) work px, places round it, at which the ground's motion is measured.
        turns: (3, 3) work px -> work px each, turns under which the outline fits itself.
        is_round: the outline fits itself in any turn.
        surface: (H, W) the rectified first view, and (H, W) nonzero on its surface.
        strides: work px between the pixels of a patch, fine to coarse.
        counts: of patches on each of the finest levels.
        spacing: work px from one sample of the outline to the next.
        edge_share: of the outline's samples, which have an edge; edge_width: work px, their standard deviation, the median.
        noise: grey levels, of the camera.
        handle: the same for the kernel.
        recipe: of the handle, which cannot be copied itself.
        any_turn: in which turn about itself it lies makes no difference, and is taken for agreed upon.
    """

    view: View
    contacts: Floats
    area: float
    A: Floats
    crop: tuple[int, int]
    centre: Floats
    size: float
    work_contacts: Floats
    outline: Floats
    points: Floats
    normals: Floats
    corners: Floats
    corner_strides: Floats
    ring: Floats
    turns: tuple[Floats, ...]
    is_round: bool
    surface: tuple[Grey, Grey]
    counts: tuple[int, ...]
    spacing: float
    edge_share: float
    edge_width: float
    noise: float
    numbers: Numbers
    handle: Any = field(repr=False)
    recipe: Recipe = field(repr=False)
    any_turn: bool = False

    def __getstate__(self) -> dict[str, Any]:
        """All but the kernel's own memory."""
        return {name: value for name, value in self.__dict__.items() if name != "handle"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make the kernel's target anew."""
        self.__dict__.update(state, handle=state["recipe"].build_target())

    @cached_property
    def noise_of_motion(self) -> Floats:
        """(8, 8) what a frame may change of the pose when nothing predicts it, work px^2."""
        numbers = self.numbers
        shares = [numbers.drift] * 2 + [numbers.stretch_rate] * 4 + [numbers.tilt_rate] * 2
        return np.asarray(np.diag((np.array(shares) * self.size) ** 2), dtype=np.float64)

    @cached_property
    def noise_of_guess(self) -> Floats:
        """(8, 8) how far a pose may be off that something else tells of a view that need not follow another, work px^2."""
        shares = [*np.sqrt(np.diagonal(self.noise_of_motion)[:6]), *[GUESSED_TILT * self.size] * 2]
        return np.asarray(np.diag(shares) ** 2, dtype=np.float64)

    @cached_property
    def noise_of_view(self) -> Floats:
        """(8, 8) how far a pose may be off that is known of no view, work px^2: what lies anywhere leans up to 45 degrees."""
        shares = [1.0] * 2 + [OPEN_SHAPE] * 4 + [OPEN_TILT] * 2
        return np.asarray(np.diag((np.array(shares) * self.size) ** 2), dtype=np.float64)

    @cached_property
    def error_of_bend(self) -> Floats:
        """(8, 16) by b1 and b2 (8,): the pose's error that a bend J (u b1 + v b2) is taken for, see `kernels.PoseTarget.solve`.

        At the contacts it is the whole bend, as far as that many may have, along the outline nearly all of it.
        """
        places = np.concatenate([self.points, self.work_contacts])
        weight = np.where(np.arange(len(places)) < len(self.points), 1.0, CONTACTS_FIRST * len(self.points))
        u, v = ((places - self.centre) / (0.5 * self.size)).T
        A, B = np.zeros((8, 8)), np.zeros((8, 16))
        for J in self._rows_at(places):
            A += J * weight @ J.T
            B += np.concatenate([J * (weight * u) @ J.T, J * (weight * v) @ J.T], axis=1)
        return np.asarray(np.linalg.solve(A, B), dtype=np.float64)

    @cached_property
    def slide(self) -> Floats:
        """(8,) the pose's error by which contacts move by 1 px, root mean square, while edges move least, outward or inward.

        An outline of few arcs slides along itself: the arc of half a disc by 14 times as far as edges move, an L by 5.
        """
        across = np.einsum("xkn,nx->kn", self._rows_at(self.points), self.normals)
        least, axes = np.linalg.eigh(across @ across.T / across.shape[1])
        unit = axes / np.sqrt(np.maximum(least, FREELY))  # each moves edges by 1 px, root mean square
        moved = np.concatenate(list(self._rows_at(self.work_contacts).transpose(0, 2, 1))) @ unit
        _, far, ways = np.linalg.svd(moved * math.sqrt(2.0 / len(moved)))
        return np.asarray(unit @ ways[0] / far[0], dtype=np.float64)

    @cached_property
    def slides(self) -> bool:
        """Whether contacts can be off by more than is asked for while edges are where they are expected."""
        across = np.einsum("xkn,nx,k->n", self._rows_at(self.points), self.normals, self.slide)
        moved = math.sqrt(float(across @ across) / len(across))
        return not self.is_round and moved * self.numbers.tolerance_px < self.numbers.edge_floor

    def _rows_at(self, places: Floats) -> Floats:
        """(2, 8, n) by how much places (n, 2) work px move along x and y with each number of the pose's error."""
        u, v = ((places - self.centre) / (0.5 * self.size)).T
        one, no = np.ones(len(places)), np.zeros(len(places))
        return np.array([[one, no, u, v, no, no, u * u, u * v], [no, one, no, no, u, v, u * v, v * v]])

    @cached_property
    def sides(self) -> tuple[float, list[Floats]]:
        """How far from the outline its sides are looked at, work px, and (N, 2) work px within it, beside it and farther away.

        They are NaN where the outline returns so soon that they lie on another side.
        """
        depth = max(MIN_SIDE_DEPTH, SIDE_DEPTH * self.size)
        rows, outline = [], np.round(self.outline, 2).astype(np.float32)
        for times in SIDES:
            row = self.points + times * depth * self.normals
            within = np.array([cv2.pointPolygonTest(outline, (x, y), True) for x, y in row.tolist()])
            row[within < 0.0 if times < 0.0 else within > -SIDE_CLEAR * depth] = np.nan
            rows.append(row)
        return depth, rows

    @cached_property
    def at_glare(self) -> Bools:
        """(N,) which samples of the outline lie at a glare in the first image, and may be of its edge.

        None where most of them do: there the ground, or the object, is as bright.
        """
        image, square = self.surface[0], np.ones((GLARE, GLARE), np.uint8)
        bright = cv2.morphologyEx((image >= SATURATED).astype(np.uint8), cv2.MORPH_OPEN, square)
        x, y = np.clip(np.rint(self.points), 0, np.array(image.shape[::-1]) - 1).astype(np.intp).T
        found = cv2.dilate(bright, square)[y, x] > 0
        return np.asarray(found & (2 * np.count_nonzero(found) <= len(found)), dtype=np.bool_)

    @cached_property
    def place_metric(self) -> Floats:
        """(2, 2) 1/work px^2: the square of how far something like it lies from it, as a share of sqrt(area).

        Along each way as far as discs of that area lie apart which overlap as much: a long object that slid along itself still
        covers most of its own place. By the moments of the outline's area.
        """
        told = cv2.moments(self.outline.astype(np.float32))
        spread = np.array([[told["mu20"], told["mu11"]], [told["mu11"], told["mu02"]]]) / told["m00"]
        return np.asarray(np.linalg.inv(spread) / (2.0 * math.tau), dtype=np.float64)

    @cached_property
    def precision_of_motion(self) -> Floats:
        """(8,) the inverse of its diagonal."""
        return np.asarray(1.0 / np.diagonal(self.noise_of_motion), dtype=np.float64)

    def with_patches(self, own: list[Bools]) -> Target:
        """The same with some of the surface's patches alone, (n,) of each level in `counts`.

        Coarser ones, and places of motion, go where more of the others than of these lie in them.
        """
        textures = list(self.recipe.textures)
        kept, dropped = np.empty((0, 2)), np.empty((0, 2))
        for k, which in enumerate(own):
            levels, places, stride = textures[k]
            if len(places) == len(which):
                kept, dropped = np.concatenate([kept, places[which]]), np.concatenate([dropped, places[~which]])
                textures[k] = levels, places[which], stride

        def clear(places: Floats, stride: float) -> Floats:
            fixed, moving = (
                (np.abs(places[:, None] - others).max(axis=2) <= PATCH * stride).sum(axis=1)
                for others in (dropped, kept)
            )
            return np.ascontiguousarray(places[fixed <= moving])

        textures[len(own) :] = [
            (levels, clear(places, stride), stride) for levels, places, stride in textures[len(own) :]
        ]
        recipe = replace(self.recipe, textures=textures)
        corners, counts = (
            clear(self.corners, float(self.corner_strides.max())),
            tuple(int(which.sum()) for which in own),
        )
        return replace(self, corners=corners, counts=counts, recipe=recipe, handle=recipe.build_target())

    @property
    def knows_patches(self) -> bool:
        """Whether it is known which places of the surface its patches are: those that lay beyond the image are none."""
        textures = self.recipe.textures[: len(self.counts)]
        return [len(places) for _, places, _ in textures] == [*self.counts]

    def about_contact(self, k: int, reach: float) -> TargetPiece:
        """What lies within a reach of contact k, work px, as a target by itself; its pose is told as that of the whole."""
        contact, given = self.work_contacts[k], self.recipe.arguments
        near: Bools = np.hypot(*(self.points - contact).T) <= reach
        samples = [np.ascontiguousarray(each[near]) for each in given[6:11]]
        arguments = (
            *given[:6],
            *samples,
            *given[11:13],
            contact[None],
            given[14],
            *(each[near] for each in given[15:]),
        )
        own = [np.hypot(*(places - contact).T) <= reach for _, places, _ in self.recipe.textures]
        textures = [
            (levels, np.ascontiguousarray(places[which]), stride)
            for which, (levels, places, stride) in zip(own, self.recipe.textures, strict=True)
        ]
        recipe, own = replace(self.recipe, arguments=arguments, textures=textures), own[: len(self.counts)]
        made = replace(
            self,
            work_contacts=contact[None],
            points=self.points[near],
            normals=self.normals[near],
            counts=tuple(int(np.count_nonzero(which)) for which in own),
            recipe=recipe,
            handle=recipe.build_target(),
        )
        return TargetPiece(made, near, own)

    def carried_contacts(self, G: Floats) -> Floats:
        """(k, 2) px, the contacts in an image that shows the target through G."""
        at, in_front = kernels.carry_points(G, self.work_contacts)
        if not in_front > HORIZON:
            raise behind_camera_error(G)
        return at

    def contact_visibility(self, visible: Floats) -> Floats:
        """(k,) 0 to 1: how much of the edge under each finger shows, of the samples' probabilities (N,) to be visible."""
        return np.asarray(visible @ self._finger_weights, dtype=np.float64)

    def seen_surface(self, correlation: list[Floats], usual: list[Floats]) -> Floats:
        """(k,) 0 to 1: of the patches beside each contact that usually look alike the share that do; 0 where there are none."""
        if not correlation:
            return np.zeros(len(self.work_contacts))
        r, u = np.concatenate(correlation), np.concatenate(usual)
        usually = u > ALIKE
        able = self._patches_beside @ (usually & np.isfinite(r))
        alike = self._patches_beside @ (usually & (r > ALIKE * u))  # never where it is NaN
        return np.asarray(alike / np.maximum(able, 1.0), dtype=np.float64)

    def shown_share(self, contacts: Floats, usual: list[Floats]) -> float:
        """0 to 1: how much the first view shows of what later images may see again, of the contact of which it shows least.

        That is the stretch of edge under a finger, or surface beside it.

        Args:
            contacts: (k, 2) px of the first image.
            usual: how much each patch of the surface looks like itself, as for `seen_surface`.
        """
        other = replace(self, work_contacts=apply_homography(self._view_to_work, contacts))
        edge = np.count_nonzero(other._finger_weights, axis=0) * self.spacing / (2.0 * self._finger_reach)
        return float(np.maximum(np.minimum(edge, 1.0), other.seen_surface(usual, usual)).min())

    @cached_property
    def _patches_beside(self) -> Floats:
        """(k, n) of the patches of the finest levels: 1 where one lies beside a contact."""
        found = []
        for (_, places, stride), count in zip(self.recipe.textures, self.counts, strict=False):
            away = np.hypot(*(self.work_contacts[:, None] - places[None]).transpose(2, 0, 1))
            near = away <= 0.5 * FINGER_WIDTH * self.size + PATCH * stride
            # which of them lay within the image, where not all of them did, is not known
            found.append(near.astype(np.float64) if len(places) == count else np.zeros((len(away), count)))
        return np.concatenate(found, axis=1)

    def clear_corners(self, visible: Floats) -> Floats:
        """(n, 2) work px, the corners whose coarsest patches hold no sample of the outline that does not show.

        What hides a sample moves by itself: a patch that holds any of it tells of that motion. Nothing else may contradict it,
        as on an outline that slides along itself.

        Args:
            visible: (N,) probability of each sample to be visible; empty where that is not known.
        """
        return self._clear_of_occluder(self.corners, self._corners_near, visible)

    def clear_ring(self, visible: Floats) -> Floats:
        """(n, 2) work px, the same of the ring."""
        return self._clear_of_occluder(self.ring, self._ring_near, visible)

    def _clear_of_occluder(self, places: Floats, near: Floats, visible: Floats) -> Floats:
        hidden = visible <= 0.5
        if not len(places) or not hidden.any():
            return places
        beside = np.concatenate([hidden[-1:], hidden, hidden[:1]])
        hidden &= beside[:-2] | beside[2:]  # one sample alone misses its edge by noise
        return np.ascontiguousarray(places[near @ hidden == 0.0]) if hidden.any() else places

    @cached_property
    def _corners_near(self) -> Floats:
        """(n, N) 1 where the coarsest patch at a corner may hold a sample of the outline, else 0."""
        return self._samples_within_patch(self.corners)

    @cached_property
    def _ring_near(self) -> Floats:
        """(n, N) the same of the ring."""
        return self._samples_within_patch(self.ring)

    def _samples_within_patch(self, places: Floats) -> Floats:
        reach = math.sqrt(2.0) * PATCH * float(self.corner_strides.max())
        return np.asarray(self._sample_distances(places) <= reach, dtype=np.float64)

    def _sample_distances(self, places: Floats) -> Floats:
        return np.asarray(np.hypot(*(places[:, None] - self.points[None]).transpose(2, 0, 1)), dtype=np.float64)

    @property
    def _finger_reach(self) -> float:
        """Work px to either side of a contact within which the outline is that under the finger: a small object's finger may
        stand between two samples."""
        return max(0.5 * FINGER_WIDTH * self.size, self.spacing)

    @cached_property
    def _finger_weights(self) -> Floats:
        """(N, k) how much each sample counts for the edge under each finger."""
        under = self._finger_reach >= self._sample_distances(self.work_contacts).T
        return np.asarray(under / np.maximum(under.sum(axis=0), 1), dtype=np.float64)

    def pose_difference(self, G0: Floats, G: Floats) -> Floats:
        """(8,) the pose's error, work px at the half size, that leads from G0 to G; NaN where none does."""
        return np.asarray(self.handle.difference(G0, G), dtype=np.float64)

    def homography_and_covariance(self, G: Floats, P: Floats) -> tuple[Floats, Floats]:
        """`homography(G)`, and (9, 9) of its entries, row by row, the last one being 1, by the pose's covariance P (8, 8)."""
        moved, H = G @ self._pose_generators, G @ self._view_to_work
        scale = H[2, 2]
        H = H / scale
        J = (moved - H * moved[:, 2:, 2:]).reshape(8, 9).T / scale
        return H, J @ P @ J.T

    @cached_property
    def _pose_generators(self) -> Floats:
        """(8, 3, 3) by which G is to be multiplied for its derivatives, as a map from px of the first view, by its error."""
        r, (x, y) = self.size / 2.0, self.centre
        T = np.array([[1.0 / r, 0.0, -x / r], [0.0, 1.0 / r, -y / r], [0.0, 0.0, 1.0]])
        E = np.zeros((8, 3, 3))
        for k, (i, j, sign) in enumerate(POSE_ENTRIES):
            E[k, i, j] = sign / r
        return np.asarray(np.linalg.inv(T) @ E @ T @ self._view_to_work, dtype=np.float64)

    @cached_property
    def _view_to_work(self) -> Floats:
        """(3, 3) px of the first view -> work px."""
        return np.asarray(np.linalg.inv(self.A), dtype=np.float64)

    @cached_property
    def agreed(self) -> Floats:
        """(8, 8) 1 / work px^2, what is agreed upon of a pose's error: of a part in any turn, that turn."""
        if not self.any_turn:
            return np.zeros((8, 8))
        axes = np.linalg.cholesky(np.cov(self.outline.T))  # seen a little aslant a round part is an ellipse
        turn = axes @ np.array([[0.0, -SMALL_TURN], [SMALL_TURN, 0.0]]) @ np.linalg.inv(axes)
        T = np.eye(3)
        T[:2, :2] += turn
        T[:2, 2] = -turn @ self.outline.mean(axis=0)
        way = self.pose_difference(np.eye(3), T)
        return np.outer(way, way) / float(way @ way) ** 2 * (0.5 * self.size * SMALL_TURN / AGREED) ** 2

    def homography(self, G: Floats) -> Floats:
        """(3, 3) H_current_reference of a pose G."""
        H = G @ self._view_to_work
        return np.asarray(H / H[2, 2], dtype=np.float64)

    def pose(self, H: Floats) -> Floats:
        """The G of a homography H_current_reference."""
        G = H @ self.A
        return np.asarray(G / G[2, 2], dtype=np.float64)


class TargetPiece(NamedTuple):
    """Part of a target, as one by itself.

    Attributes:
        target: the piece.
        samples: (n,) which of the whole outline's samples it has.
        patches: (m,) of each level in `counts`, which of the whole surface's.
    """

    target: Target
    samples: Bools
    patches: list[Bools]

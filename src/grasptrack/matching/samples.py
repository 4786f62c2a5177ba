# SPDX-License-Identifier: Apache-2.0
"""An outline as the match looks at it, points at equal steps with normals; and the alignments that a match begins with."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.geometry.contours import Outline, as_view
from grasptrack.geometry.homographies import displacement_fields, whitening_matrix
from grasptrack.typing import Floats

MOST = 400
"""Samples of an outline, holes included; ..."""
SPACING = 1.0
"""... fewer where they would lie nearer than so many px."""
SMOOTHING = 2.0
"""px or samples, whichever is more, over which a sample is the mean: what noise does to a normal stays below 10 degrees."""
FEWEST = 12
"""Samples of the least hole."""
TWIN = 0.2
"""Share of the whitened outline's norm by which a near twin of itself may differ."""
TWINS, TWIN_COUNT, TWIN_APART = 23, 256, 0.015
"""Near twins that are kept at most, the steps at which they are looked for, and what they are apart at least, in lengths
of the outline."""
SHAPE = 256
"""Points of the outer contour for the whitened alignment."""
EVEN_SPACING = 3.0
"""px between samples of an outline that is followed, ..."""
MAX_SAMPLES, MIN_SAMPLES = 400, 60
"""... of which there are so many at most, and, of a small outline, at least."""
MIN_CONTOUR_SAMPLES = 8
"""Samples of the least contour."""
ABOVE_NOISE = 9.0
"""Power of a harmonic over that of noise from which on it is the outline's own: noise exceeds it once in e^9 harmonics."""
NOISE_FROM = 0.375
"""Orders of harmonics over the number of points from which on they are noise: the highest quarter."""


COUNT = 128
"""Samples of a whitened outline."""
IN_FRONT = 0.25
"""A bend that magnifies a part of the outline by more than the inverse of this is not tried."""
APART = 0.025
"""Lengths of the outline between two starts."""
AT_ONCE = 64
"""Pairs that are laid on each other at once, the most promising first."""
Spectra = NDArray[np.complex128]
Row = tuple[float, int, int, int, complex]
"""How alike a pair is, the indices of both, the shift between them, and their correlation."""


def _perspective_bends(*rings: tuple[float, int]) -> Floats:
    turns = [(0.0, 0.0)]
    for radius, count in rings:
        step = 2.0 * math.pi / count
        turns += [(radius * math.cos(step * k), radius * math.sin(step * k)) for k in range(count)]
    return np.array(turns)


BENDS = _perspective_bends((0.1, 6))
"""Perspective that is tried, in units of the whitened outline: up to 0.18 arises when an object that fills 60 % of a view
of 60 degrees is tilted by 60; nine of ten such views are below 0.11."""
MORE_BENDS = _perspective_bends((0.08, 6), (0.15, 6))
"""The same where a first look found nothing that fits."""


class Sampled:
    """Samples of an outline. Making them once serves all matches of a view.

    Attributes:
        centre: (2,) px, the outer contour's centroid.
        points, normals: (m, 2) px from the centre, (m, 2) unit, out of the material; contour after contour.
        offsets: (C + 1,) where each contour begins.
        outer: (k, 2) px from the centre, fewer points of the outer contour.
        size: px, the square root of the outer contour's area.
    """

    def __init__(self, outline: Outline) -> None:
        view = as_view(outline)
        spacing = max(SPACING, sum(c.length for c in view.contours) / MOST)
        rings = []
        for contour in view.contours:
            count = max(FEWEST, round(contour.length / spacing))
            smooth = min(SMOOTHING * max(1.0, spacing), 0.25 * contour.length)
            rings.append(kernels.resample(contour.points, count, smooth))
        area, x, y, *_ = kernels.polygon_moments(rings[0], np.array([0, len(rings[0])], dtype=np.int64))
        self.size: float = math.sqrt(area)
        self.centre: Floats = np.array([x, y])
        # from the centre: with strong perspective the image's own origin may lie beyond the horizon
        self.points: Floats = np.concatenate(rings) - self.centre
        self.normals: Floats = np.ascontiguousarray(np.concatenate([kernels.blend_normals(r) for r in rings]))
        self.offsets: NDArray[np.int64] = np.cumsum([0, *(len(r) for r in rings)], dtype=np.int64)
        outer = rings[0] if len(rings[0]) <= SHAPE else kernels.resample(rings[0], SHAPE, 0.0)
        self.outer: Floats = outer - self.centre

    @cached_property
    def softest_direction(self) -> tuple[Floats, float, Floats]:
        """Centre (2,) and radius in px, and (8,) parameters of the homography near the identity that the normals show
        least, such that it moves the farthest point by 1 px."""
        centre = self.points.mean(axis=0)
        radius = math.sqrt(float(((self.points - centre) ** 2).sum()) / len(self.points))
        fields = displacement_fields((self.points - centre) / radius)
        own = whitening_matrix(fields)
        seen = np.einsum("mi,mij->mj", self.normals, fields) @ own
        mode = own @ np.linalg.eigh(seen.T @ seen)[1][:, 0]
        return centre, radius, mode / (radius * math.sqrt(float(((fields @ mode) ** 2).sum(axis=1).max())))

    @cached_property
    def self_alignments(self) -> Floats:
        """(k, 9) affine maps after which the outer contour lies on itself or nearly, without the identity."""
        if not kernels.polygon_moments(self.outer, np.array([0, len(self.outer)], dtype=np.int64)).minor > 0.0:
            return np.zeros((0, 9))  # it goes round one way nearly as much as the other
        found = kernels.initial_alignments(self.outer, self.outer, np.zeros((1, 2)), TWIN_COUNT, TWIN_APART, TWINS + 1)
        own = np.abs(np.mod(found[:, 1] + 0.5, 1.0) - 0.5) < TWIN_APART
        return np.ascontiguousarray(found[(found[:, 0] <= TWIN) & ~own, 2:])

    @cached_property
    def whitened_outline(self) -> Whitened:
        """The outer contour."""
        return Whitened.of([self.outer], BENDS[:1])

    @cached_property
    def whitened_bent(self) -> Whitened:
        """The outer contour as it is, and bent by perspective."""
        return Whitened.of([self.outer], BENDS)

    @cached_property
    def whitened_pieces(self) -> Whitened:
        """What straight cuts leave of the outer contour."""
        depths = [(self.outer @ np.array([math.cos(angle), math.sin(angle)]), share) for angle, share in PIECES]
        rings = [self.outer[depth <= np.sort(depth)[int((1.0 - share) * len(depth))]] for depth, share in depths]
        return Whitened.of(rings, BENDS[:1])


def as_sampled(outline: Outline | Sampled) -> Sampled:
    """The samples of an outline; samples come back as they are."""
    return outline if isinstance(outline, Sampled) else Sampled(outline)


APART_MORE = 0.015
"""Lengths of the outline between two of more starts."""
STARTS, STARTS_MORE = 14, 24
"""Alignments that are refined."""
STARTS_WHOLE = 10
"""Alignments of any of several outlines with the whole of one that are refined."""
CUTS = tuple((2.0 * math.pi * k / 12, share) for share in (0.15, 0.3) for k in range(12))
"""Direction in rad, and share of the outline that is cut off there, of the parts that are tried."""
STARTS_CUT = 24
"""Alignments of parts that are refined."""
STARTS_PIECES = 96
"""Alignments of any of several outlines with pieces of one that are refined."""
PIECES = tuple((2.0 * math.pi * k / 12, share) for share in (0.35, 0.5, 0.65) for k in range(12))
"""The same of what is cut off an outline that is of several parts which touch."""


def align_wholes(a: Sampled, b: Sampled, *, more: bool = False) -> Floats:
    """(k, 9) homographies that lay the whole of one outer contour on the whole of the other."""
    wanted = (MORE_BENDS, APART_MORE, STARTS_MORE) if more else (BENDS, APART, STARTS)
    return np.ascontiguousarray(_align_wherever_begun(a.outer, b.outer, *wanted)[:, 2:])


def _align_wherever_begun(first: Floats, second: Floats, bends: Floats, apart: float, most: int) -> Floats:
    """(k, 11) see `kernels.initial_alignments`; none where samples of a thin outline cross, so that they enclose nothing."""
    if _whitening_map(first) is None or _whitening_map(second) is None:
        return np.zeros((0, 11))
    return kernels.initial_alignments(first, second, bends, COUNT, apart, most)


def align_parts(a: Sampled, b: Sampled) -> Floats:
    """(k, 9) homographies that lay what a straight cut leaves of the first outer contour on the whole of the second.

    If the second is cut or covered there, the two are alike. Of the cuts those count that leave least.
    """
    rows = []
    for angle, share in CUTS:
        depth = a.outer @ np.array([math.cos(angle), math.sin(angle)])
        part = a.outer[depth <= np.quantile(depth, 1.0 - share)]
        rows.append(_align_wherever_begun(np.ascontiguousarray(part), b.outer, BENDS[:1], APART, 4))
    found = np.concatenate(rows)
    return np.ascontiguousarray(found[np.argsort(found[:, 0], kind="stable")][:STARTS_CUT, 2:])


class Whitened(NamedTuple):
    """Outlines after the affine maps that make their areas' second moments 1, at equal steps of their lengths: their
    transforms (n, COUNT), of unit norm, and the maps (n, 3, 3) from the outline, px, to what was transformed."""

    spectra: Spectra
    maps: Floats

    @classmethod
    def of(cls, rings: Sequence[Floats], bends: Floats) -> Whitened:
        """Outlines (N, 2) px, each after perspectives (k, 2), in units of the whitened one; none of what encloses nothing."""
        samples, maps = [], []
        for ring in rings:
            to_white = _whitening_map(ring)
            if to_white is None:
                continue
            white = np.ascontiguousarray(ring @ to_white[:2, :2].T + to_white[:2, 2])
            for bend in bends:
                again, bent = to_white, white
                if bend.any():
                    depth = white @ bend + 1.0
                    bent = np.ascontiguousarray(white / depth[:, None])
                    own = _whitening_map(bent) if depth.min() >= IN_FRONT else None
                    if own is None:
                        continue
                    bent = np.ascontiguousarray(bent @ own[:2, :2].T + own[:2, 2])
                    again = own @ np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [*bend, 1.0]]) @ to_white
                at = kernels.resample(bent, COUNT, 0.0)
                samples.append(at[:, 0] + 1j * at[:, 1])
                maps.append(again)
        z = np.array(samples, dtype=np.complex128).reshape(-1, COUNT)
        z -= z.mean(axis=1, keepdims=True)
        z /= np.linalg.norm(z, axis=1, keepdims=True)
        return cls(np.fft.fft(z, axis=1), np.array(maps).reshape(-1, 3, 3))


class Starts(NamedTuple):
    """Alignments of several outlines with one, the best first.

    Attributes:
        owner: (k,) index of the first outline.
        left: (k,) share of the whitened outlines' norm by which they differ.
        homographies: (k, 9) first -> second.
    """

    owner: NDArray[np.intp]
    left: Floats
    homographies: Floats

    def of(self, index: int) -> Floats:
        """(k, 9) homographies of one of the first outlines."""
        return np.ascontiguousarray(self.homographies[self.owner == index])


def pooled_starts(firsts: Sequence[Whitened], second: Whitened, most: int, limit: float = 1.0) -> Starts:
    """The best alignments of any of several outlines with one, or with pieces of it, at any turn and first point.

    Args:
        firsts: of the first outlines.
        second: of the second one, or of pieces of it.
        most: alignments at most.
        limit: share of the norm by which they may differ.
    """
    owner = np.repeat(np.arange(len(firsts)), [len(f.maps) for f in firsts])
    a = np.concatenate([np.zeros((0, COUNT)), *(f.spectra for f in firsts)])
    maps = np.concatenate([np.zeros((0, 3, 3)), *(f.maps for f in firsts)])
    # however they are turned and wherever they begin, they are no more alike than their harmonics
    bound = np.abs(a) @ np.abs(second.spectra).T / COUNT
    order = np.argsort(-bound, axis=None)
    order = order[bound.ravel()[order] >= math.sqrt(1.0 - limit**2)]
    found: list[Row] = []
    for begin in range(0, len(order), AT_ONCE):
        i, j = np.unravel_index(order[begin : begin + AT_ONCE], bound.shape)
        if len(found) >= most and bound[i[0], j[0]] < found[most - 1][0]:
            break
        c = np.fft.ifft(a[i].conj() * second.spectra[j], axis=1)
        alike = np.abs(c)
        peak = (alike >= np.roll(alike, 1, axis=1)) & (alike > np.roll(alike, -1, axis=1))
        rows, shifts = np.nonzero(peak & (alike >= math.sqrt(1.0 - limit**2)))
        columns: list[Any] = [alike[rows, shifts], i[rows], j[rows], shifts, c[rows, shifts]]
        more: list[Row] = list(zip(*(column.tolist() for column in columns), strict=True))
        found = _begun_apart(sorted([*found, *more], key=lambda row: -row[0]), owner, most)
    at, on = (np.array([row[k] for row in found], dtype=np.intp) for k in (1, 2))
    turn = np.array([row[4] / row[0] for row in found], dtype=np.complex128)
    turns = np.zeros((len(found), 3, 3))
    turns[:, 0, 0] = turns[:, 1, 1] = turn.real
    turns[:, 1, 0], turns[:, 0, 1], turns[:, 2, 2] = turn.imag, -turn.imag, 1.0
    H = np.linalg.inv(second.maps[on]) @ turns @ maps[at]
    left = np.sqrt(np.maximum(0.0, 1.0 - np.array([row[0] for row in found]) ** 2))
    return Starts(owner[at], left, (H / H[:, 2:, 2:]).reshape(-1, 9))


def _begun_apart(rows: list[Row], owner: NDArray[np.intp], most: int) -> list[Row]:
    """The first of those of one outline on one piece that begin at nearly the same place."""
    kept: list[Row] = []
    shifts: dict[tuple[int, int], list[int]] = {}
    for row in rows:
        known = shifts.setdefault((int(owner[row[1]]), row[2]), [])
        if all(abs((row[3] - k + COUNT // 2) % COUNT - COUNT // 2) >= APART * COUNT for k in known):
            known.append(row[3])
            kept.append(row)
            if len(kept) == most:
                break
    return kept


def _whitening_map(points: Floats) -> Floats | None:
    """(3, 3) the affine map after which the area within has mean 0 and unit second moments, without a turn; None of none."""
    m = kernels.polygon_moments(points, np.array([0, len(points)], dtype=np.int64))
    if not m.minor > 0.0:
        return None
    c, s = math.cos(m.angle), math.sin(m.angle)
    a, b = 1.0 / math.sqrt(m.major), 1.0 / math.sqrt(m.minor)
    xx, xy, yy = a * c * c + b * s * s, (a - b) * c * s, a * s * s + b * c * c
    return np.array([[xx, xy, -xx * m.x - xy * m.y], [xy, yy, -xy * m.x - yy * m.y], [0.0, 0.0, 1.0]])


class EvenSamples(NamedTuple):
    """Samples of the outline: points and outward normals (n, 2); px^2, variance of a contour's points across it; px between."""

    points: Floats
    normals: Floats
    noise: float
    spacing: float


def sample_evenly(contours: list[tuple[Floats, bool, Any]]) -> EvenSamples:
    """Evenly along all contours; none where the border cuts the object."""
    lengths = [float(np.hypot(*(np.roll(p, -1, axis=0) - p).T).sum()) for p, _, _ in contours]
    spacing = max(EVEN_SPACING, sum(lengths) / MAX_SAMPLES)
    spacing = min(spacing, sum(lengths) / MIN_SAMPLES)
    points, normals, noise = [], [], 0.0
    for (p, _, clipped), length in zip(contours, lengths, strict=True):
        if length < MIN_CONTOUR_SAMPLES * spacing:
            continue
        smooth, own_noise = _without_noise(p)
        smooth = p if clipped is not None else smooth
        noise = max(noise, own_noise / (2.0 * len(p)))
        closed = np.vstack([p, p[:1]])
        even = np.vstack([smooth, smooth[:1]])
        arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])

        def point_at(t: Floats, points: Floats, arc: Floats = arc) -> Floats:
            t = t % arc[-1]
            return np.column_stack([np.interp(t, arc, points[:, 0]), np.interp(t, arc, points[:, 1])])

        t = np.linspace(0.0, arc[-1], max(MIN_CONTOUR_SAMPLES, round(length / spacing)), endpoint=False)
        chord = point_at(t + EVEN_SPACING, even) - point_at(t - EVEN_SPACING, even)
        chord /= np.hypot(*chord.T)[:, None] + 1e-9
        keep = np.ones(len(t), dtype=bool)
        if clipped is not None:
            nearest = np.clip(np.searchsorted(arc, t), 0, len(p) - 1)
            keep = ~clipped[nearest]
        points.append(point_at(t, closed)[keep])
        normals.append(np.column_stack([chord[:, 1], -chord[:, 0]])[keep])
    if not points:
        return EvenSamples(np.zeros((0, 2)), np.zeros((0, 2)), noise, spacing)
    return EvenSamples(np.vstack(points), np.vstack(normals), noise, spacing)


def _without_noise(points: Floats) -> tuple[Floats, float]:
    """(N, 2) a closed contour's points by those of its harmonics that are more than noise, and the power of noise in each.

    Of noise in its normals a disc seems to tell how far it turned.
    """
    n = len(points)
    values = np.fft.fft(points[:, 0] + 1j * points[:, 1])
    order = np.abs(np.fft.fftfreq(n, 1.0 / n))
    noise = float(np.mean(np.abs(values[order > NOISE_FROM * n]) ** 2))
    kept = (np.abs(values) ** 2 > ABOVE_NOISE * noise) | (order <= 1)
    smooth = np.fft.ifft(np.where(kept, values, 0.0))
    return np.column_stack([smooth.real, smooth.imag]), noise

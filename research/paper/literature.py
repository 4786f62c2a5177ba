# SPDX-License-Identifier: Apache-2.0
"""Other ways than the paper's to carry a grasp from outline to outline, as the literature has them.

Three of them find the motion between two outer contours from all of their points, none of which is matched beforehand, and
each within its own group of motions; a contact is the point of the outline nearest to where that motion takes it. The fourth
carries nothing: it plans again. None judges its answer, and none refuses what it can compute.

The texts of [21] and [22] were not at hand: what is here is what their titles and the paper say of them, read in their favour.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.errors import TransferError
from grasptrack.geometry.contours import Outline
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.synthesis import synthesize
from grasptrack.transfer import TransferStrategy
from grasptrack.transfer.base import Transfer
from grasptrack.typing import Floats

Complexes = NDArray[np.complex128]
MotionFinder = Callable[[Floats, Floats], Floats]
"""(3, 3) the motion from a closed contour (N, 2) px to another (M, 2) px."""

SAMPLES = 256
"""Equal steps of a contour's length in which it is sampled."""
SMOOTHED = 0.03
"""Standard deviation of the Gaussian, in lengths of the contour, without which a polygon has no affine arc length.

Of 0.005 to 0.08 the least error of four shapes with seed 7, resampled and as chains of pixels.
"""
ROUNDS = 50
STILL_PX = 1e-9
"""At most so many rounds of [21], or until no sample moves farther."""
DESCRIBED = 16
"""Harmonics that tell an outline from its half turn."""


def match_by_phase(one: Floats, other: Floats) -> Floats:
    """The similarity that the phases and sizes of the first elliptic Fourier descriptors tell.

    The first harmonic is an ellipse; its long axis has a direction and a point on the contour where it begins (F. P. Kuhl,
    C. R. Giardina, "Elliptic Fourier features of a closed contour", 1982), both but for a half turn, which the harmonics
    above decide.
    """
    c, d = (np.fft.fft(_sampled(p)) / SAMPLES for p in (one, other))
    k = np.r_[1 : DESCRIBED + 1, -DESCRIBED:0]
    begun, turned = (0.5 * np.angle([x[-1] * x[1].conj(), x[-1] * x[1]]) for x in (c, d))
    size = (abs(d[1]) + abs(d[-1])) / (abs(c[1]) + abs(c[-1]))
    found = []
    for half in (0.0, np.pi):
        shift = turned[0] - begun[0] + half
        factor = size * np.exp(1j * (turned[1] - begun[1] + half))
        left = np.abs(d[k] * np.exp(1j * k * shift) - factor * c[k])
        found.append((float(left @ left), factor))
    factor = min(found, key=lambda pair: pair[0])[1]
    moved = d[0] - factor * c[0]
    a, b = factor.real, factor.imag
    return np.array([[a, -b, moved.real], [b, a, moved.imag], [0.0, 0.0, 1.0]])


def match_by_affine_length(one: Floats, other: Floats) -> Floats:
    """The affine motion that fits best of all starts where both contours are sampled in equal steps of affine arc length.

    That length, of |x' y'' - x'' y'| to the power of a third, is the same for all affine images of a curve, but for its scale.
    """
    u, v = (_equal_affine_steps(p) for p in (one, other))
    return _best_affine(u, v)


def match_contours(one: Floats, other: Floats) -> Floats:
    """The collineation that lays one contour on the other, no point of which is matched ([21]).

    It begins with the affine motion that makes the second moments of both outlines equal, the turn being the one that fits
    best. Then all eight numbers are moved by least squares (Gauss and Newton) until the samples of the one contour lie on
    the other.
    """
    rounds = [_whitened(p) for p in (one, other)]
    turned = _best_affine(rounds[0][0], rounds[1][0], rigid=True)
    H = np.linalg.inv(rounds[1][1]) @ turned @ rounds[0][1]
    points, scale = _as_points(_sampled(one)), _to_unit(one)
    offsets = np.array([0, len(other)])
    for _ in range(ROUNDS):
        moved = apply_homography(H, points)
        _, apart, normals = _feet(other, offsets, moved)
        x = apply_homography(scale, points)
        x = np.column_stack([x, np.ones(len(x))])
        depth = x @ (H @ np.linalg.inv(scale))[2]
        by_row = [normals[:, :1] * x, normals[:, 1:] * x, -np.einsum("ij,ij->i", normals, moved)[:, None] * x[:, :2]]
        slopes = np.hstack(by_row) / depth[:, None]
        step = np.linalg.lstsq(slopes, -apart, rcond=None)[0]
        H = H + np.append(step, 0.0).reshape(3, 3) @ scale
        H = H / H[2, 2]
        if not np.isfinite(H).all():
            raise TransferError("the contours give no collineation")
        if float(np.abs(slopes @ step).max()) < STILL_PX:
            break
    return np.asarray(H, dtype=np.float64)


@dataclass(frozen=True)
class MotionMatch:
    """Carries contacts by the motion that a method finds between the outer contours; a `TransferStrategy`."""

    find: MotionFinder

    def describe(self, grasp: Grasp, view: Outline) -> tuple[Grasp, Floats]:
        """The grasp, and the contour (N, 2) px that it lies on."""
        return grasp, view.contours[0].points

    def apply(self, description: tuple[Grasp, Floats], view: Outline, prior: Floats | None = None) -> Transfer:
        """The grasp in another view; a prediction is not asked for."""
        grasp, first = description
        H = self.find(first, view.contours[0].points)
        placed = apply_homography(H, grasp.contacts)
        found = nearest_on_outline(placed, view)
        return Transfer(Grasp(found), H, None, float(np.hypot(*(found - placed).T).max()))


@dataclass(frozen=True)
class PlannedAgain:
    """Of all grasps that are stable on the outline, the one nearest to the last ([22], as its title has it).

    It knows no motion: it has to go from each view to the next.
    """

    candidates: int = 1000

    def describe(self, grasp: Grasp, view: Outline) -> Floats:
        """(k, 2) px, where the contacts are; the view tells nothing more."""
        return grasp.contacts

    def apply(self, description: Floats, view: Outline, prior: Floats | None = None) -> Transfer:
        """The nearest stable grasp, each contact beside its last place.

        Raises:
            TransferError: no grasp on the outline is stable.
        """
        planned = [g.contacts for g in synthesize(view, fingers=len(description), top=self.candidates)]
        if not planned:
            raise TransferError("no stable grasp")
        both = np.array([c for g in planned for c in (g, g[::-1])])
        found = both[np.linalg.norm(both - description, axis=2).max(axis=1).argmin()]
        return Transfer(Grasp(found), None, None, float(np.hypot(*(found - description).T).max()))


LITERATURE: dict[str, TransferStrategy] = {
    "Fourier phase": MotionMatch(match_by_phase),
    "affine arc length": MotionMatch(match_by_affine_length),
    "contour matching [21]": MotionMatch(match_contours),
}
"""By what tables call them, those that carry a grasp from the first view."""
REPLANNED = "planned again [22]"


def nearest_on_outline(places: Floats, view: Outline) -> Floats:
    """(k, 2) px, the points of an outline nearest to places (k, 2) px."""
    found = []
    for contour in view.contours:
        at, apart, _ = _feet(contour.points, np.array([0, len(contour.points)]), places)
        found.append((at, np.abs(apart)))
    nearest = np.argmin([apart for _, apart in found], axis=0)
    return np.array([found[c][0][i] for i, c in enumerate(nearest)])


def _feet(contour: Floats, offsets: NDArray[np.int64], places: Floats) -> tuple[Floats, Floats, Floats]:
    """Feet (n, 2) on a closed contour, signed distances (n,) of places (n, 2) from it, unit normals (n, 2)."""
    where = kernels.project_to_contour(contour, offsets, np.ascontiguousarray(places))[:, 1]
    i = np.floor(where).astype(np.int64) % len(contour)
    a, b = contour[i], contour[(i + 1) % len(contour)]
    feet = a + (where - np.floor(where))[:, None] * (b - a)
    along = b - a
    length = np.linalg.norm(along, axis=1)
    # Where a chain has the same point twice there is no side, and no normal but the way to the point.
    normals = np.column_stack([along[:, 1], -along[:, 0]]) / np.where(length > 0.0, length, 1.0)[:, None]
    away = places - feet
    apart = np.linalg.norm(away, axis=1)
    # Beyond a corner the distance is that to the corner and no longer that to a side.
    corner = ((where == np.floor(where)) | (length == 0.0)) & (apart > 0.0)
    normals[corner] = away[corner] / apart[corner, None]
    return feet, np.einsum("ij,ij->i", away, normals), normals


def _sampled(contour: Floats) -> Complexes:
    """(SAMPLES,) x + iy px in equal steps of length."""
    found: Complexes = kernels.resample(np.ascontiguousarray(contour), SAMPLES, 0.0) @ np.array([1.0, 1.0j])
    return found


def _as_points(z: Complexes) -> Floats:
    return np.column_stack([z.real, z.imag])


def _equal_affine_steps(contour: Floats) -> Floats:
    """(SAMPLES, 2) px of a contour made smooth, in equal steps of affine arc length."""
    k = np.fft.fftfreq(SAMPLES, 1.0 / SAMPLES)
    spectrum = np.fft.fft(_sampled(contour)) * np.exp(-0.5 * (2.0 * np.pi * SMOOTHED * k) ** 2)
    z, first, second = (np.fft.ifft(spectrum * (1j * k) ** order) for order in range(3))
    step = np.cbrt(np.abs((first.conj() * second).imag))
    length = np.append(0.0, np.cumsum(0.5 * (step + np.roll(step, -1))))
    even = np.arange(SAMPLES) * length[-1] / SAMPLES
    closed = np.append(z, z[0])
    return np.column_stack([np.interp(even, length, closed.real), np.interp(even, length, closed.imag)])


def _best_affine(u: Floats, v: Floats, rigid: bool = False) -> Floats:
    """(3, 3) affine motion, or turn, from points (n, 2) to points (n, 2) in the same order, from the start that fits best."""
    centre, target = u.mean(axis=0), v.mean(axis=0)
    spectra = np.fft.fft(u - centre, axis=0).conj()[:, :, None] * np.fft.fft(v - target, axis=0)[:, None, :]
    products = np.fft.ifft(spectra, axis=0).real  # (n, 2, 2) by shift: sum over i of u_i v_(i + shift)^T
    inverse = np.linalg.inv((u - centre).T @ (u - centre))
    if rigid:
        turns = np.column_stack([products[:, 0, 0] + products[:, 1, 1], products[:, 0, 1] - products[:, 1, 0]])
        best = turns[int(np.hypot(*turns.T).argmax())]
        a, b = best / np.hypot(*best)
        linear = np.array([[a, -b], [b, a]])
    else:
        explained = np.einsum("sij,ik,skj->s", products, inverse, products)
        linear = (inverse @ products[int(explained.argmax())]).T
    H = np.eye(3)
    H[:2, :2], H[:2, 2] = linear, target - linear @ centre
    return H


def _whitened(contour: Floats) -> tuple[Floats, Floats]:
    """Samples (SAMPLES, 2) in equal steps along the contour after the affine motion (3, 3) that makes its moments a disc's."""
    points = _as_points(_sampled(contour))
    centre, spread = _region_moments(points)
    values, axes = np.linalg.eigh(spread)
    root = axes @ np.diag(values**-0.5) @ axes.T
    A = np.eye(3)
    A[:2, :2], A[:2, 2] = root, -root @ centre
    return _as_points(_sampled(apply_homography(A, points))), A


def _region_moments(points: Floats) -> tuple[Floats, Floats]:
    """Centroid (2,) and second central moments (2, 2) of the region in a closed polygon (n, 2), over its area."""
    origin = points.mean(axis=0)
    a = points - origin
    b = np.roll(a, -1, axis=0)
    cross = a[:, 0] * b[:, 1] - b[:, 0] * a[:, 1]
    area = 0.5 * cross.sum()
    centre = ((a + b) * cross[:, None]).sum(axis=0) / (6.0 * area)
    products = [p[:, :, None] * q[:, None, :] for p, q in ((a, a), (b, b), (a, b), (b, a))]
    second = np.einsum("n,nij->ij", cross, products[0] + products[1] + 0.5 * (products[2] + products[3])) / (
        12.0 * area
    )
    return origin + centre, second - np.outer(centre, centre)


def _to_unit(contour: Floats) -> Floats:
    """(3, 3) that takes a contour to the origin and to the size of one: numbers of H of one order of magnitude."""
    centre = contour.mean(axis=0)
    size = float(np.abs(contour - centre).max())
    return np.array([[1.0 / size, 0.0, -centre[0] / size], [0.0, 1.0 / size, -centre[1] / size], [0.0, 0.0, 1.0]])

# SPDX-License-Identifier: Apache-2.0
"""The region that given contacts lie on the outline of, by a graph cut: contacts say what is object and what is not.

Beside each contact one side is the object and the other is not: a grasp from outside has the object between its contacts, one
from inside, as in a hole, beyond them. What lies at the image's border is mostly ground. OpenCV's GrabCut (Rother, Kolmogorov
and Blake, ACM Transactions on Graphics 23, 2004) cuts between the two by lightness at two scales and by how much it varies, so
that it finds faint parts and print on gravel, where edges alone enclose nothing. It is a proposal as others are: its outline is
localised on the edges beside it, and rated by them.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from grasptrack.grasp.force_closure import ON_OUTLINE
from grasptrack.segmentation.closed_edges import Planes
from grasptrack.segmentation.silhouettes import Chain, Silhouette, to_binary, trace_silhouettes
from grasptrack.typing import Bools, Floats, Pixels

CUT_SIDE = 320
"""px, the longer side of the image that is cut."""
FINE, COARSE = 1.0, 2.5
"""px, Gaussian blurs in which lightness is looked at, the coarse one also for how much it varies."""
LIGHTNESS_GAIN, VARIATION_GAIN = 2.55, 40.0
"""Grey levels for a unit of lightness, and for a factor of e in its variation."""
SEED_NEAR, SEED_FAR = 1.5, 12.0
"""px from a contact at which a seed begins and ends, of the image that is cut."""
MAX_SEED = 0.5
"""Share of the way from a contact to the contacts' middle that a seed reaches at most."""
NO_BOX = (0, 0, 0, 0)
"""GrabCut's box, where labels say what is known."""
COMPONENTS, CHANNELS = 5, 3
"""Gaussians in GrabCut's mixtures, and channels of its images."""
MIN_VARIANCE = 4.0
"""Grey levels^2, of what is as even as an image's rounding."""
ITERATIONS = 4
"""Times that mixtures are learned and the cut is made anew."""
HOLE_UNLIKE, BORDER_STEP = 2.5, 8
"""Factor by which what lies beyond the contacts is less like the image's border than what lies between them, from which they
are in a hole; and px between those of the border that are compared."""
ON_HOLE = 2.0
"""px from a hole's boundary to the contacts on it, of the image that is cut."""


def reduction_of(planes: Planes) -> int:
    """Times by which planes (H, W, C) are reduced before they are cut."""
    longer: int = max(planes.shape[:2])
    return max(1, round(longer / CUT_SIDE))


def region_at_contacts(planes: Planes, contacts: Floats, least: float) -> Silhouette | None:
    """The region of at least so many px^2 that contacts (k, 2) px lie on, of planes (H, W, C).

    Of holes only the one is kept that all of them lie on. None where neither what lies between them nor what lies beyond is a
    region with contacts on its outline.
    """
    times = reduction_of(planes)
    image = _cut_image(planes, times)
    inner, outer = _draw_seeds(image.shape[:2], (contacts - 0.5 * (times - 1)) / times)
    sides = [(inner, outer), (outer, inner)]
    if _unlike_border(image, outer) > HOLE_UNLIKE * _unlike_border(image, inner):
        sides.reverse()
    for own, other in sides:
        if not own.any():  # beyond the image's border
            continue
        region = to_binary(_cut_region(image, own, other))
        whole = cv2.resize(region, (planes.shape[1], planes.shape[0]), interpolation=cv2.INTER_LINEAR)
        for shape in trace_silhouettes(to_binary(whole > 127), least)[:1]:
            near = max(ON_HOLE * times, ON_OUTLINE * math.sqrt(shape.area))
            holes = tuple(h for h in shape.holes if _runs_through(h, contacts, ON_HOLE * times))
            if holes or _runs_through(shape.outer, contacts, near):
                return shape._replace(holes=holes)
    return None


def _runs_through(chain: Chain, contacts: Floats, near: float) -> bool:
    """Whether all contacts (k, 2) px lie beside a chain (n, 2)."""
    return all(abs(cv2.pointPolygonTest(chain, (x, y), True)) <= near for x, y in contacts.tolist())


def _cut_image(planes: Planes, times: int) -> Pixels:
    """(h, w, 3) lightness, the same from afar, and how much it varies; reduced so many times."""
    lightness = np.ascontiguousarray(planes[:, :, 0]) * LIGHTNESS_GAIN
    fine, coarse = (cv2.GaussianBlur(lightness, (0, 0), sigma) for sigma in (FINE, COARSE))
    variance = cv2.GaussianBlur(lightness**2, (0, 0), COARSE) - coarse**2
    variation = VARIATION_GAIN * np.log1p(np.sqrt(np.maximum(variance, 0.0)))
    shown = np.dstack([fine, coarse, variation])
    size = planes.shape[1] // times, planes.shape[0] // times
    small = cv2.resize(shown, size, interpolation=cv2.INTER_AREA) if times > 1 else shown
    return np.ascontiguousarray(np.clip(np.rint(small), 0, 255), dtype=np.uint8)


def _draw_seeds(size: tuple[int, ...], contacts: Floats) -> tuple[Bools, Bools]:
    """(h, w) what lies between contacts (k, 2) px beside each, and what lies beyond."""
    inner, outer = np.zeros(size, np.uint8), np.zeros(size, np.uint8)
    ways = contacts.mean(axis=0) - contacts
    lengths = np.maximum(np.hypot(*ways.T), 1.0)
    for contact, way, length in zip(contacts, ways / lengths[:, None], lengths, strict=True):
        near, far = min(SEED_NEAR, 0.5 * MAX_SEED * length), min(SEED_FAR, MAX_SEED * length)
        for seed, sign, ends in ((inner, 1.0, (near, far)), (outer, -1.0, (SEED_NEAR, SEED_FAR))):
            a, b = (np.rint(contact + sign * k * way).astype(int).tolist() for k in ends)
            cv2.line(seed, a, b, (1,))
    return inner > 0, outer > 0


def _unlike_border(image: Pixels, seeds: Bools) -> float:
    """Grey levels, at least one, by which seeds (h, w) differ from what lies at an image's border."""
    edge = np.concatenate([image[0], image[-1], image[:, 0], image[:, -1]]).astype(np.float64)[::BORDER_STEP]
    away = np.linalg.norm(image[seeds].astype(np.float64)[:, None] - edge, axis=2).min(axis=1, initial=np.inf)
    return 1.0 + float(np.median(away)) if len(away) else 1.0


def _cut_region(image: Pixels, own: Bools, other: Bools) -> Bools:
    """(h, w) the part of an image (h, w, 3) that has all seeds of its own, and none of the others."""
    border = np.ones(own.shape, np.bool_)
    border[1:-1, 1:-1] = False
    ground = (other | border) & ~own
    labels = np.full(own.shape, cv2.GC_PR_BGD, np.uint8)
    labels[ground], labels[own] = cv2.GC_BGD, cv2.GC_FGD
    mixtures = _seed_mixture(image[ground]), _seed_mixture(image[own])
    for mode, count in ((cv2.GC_EVAL_FREEZE_MODEL, 1), (cv2.GC_EVAL, ITERATIONS)):
        cv2.grabCut(image, labels, NO_BOX, *mixtures, count, mode)
    parts = cv2.connectedComponents(to_binary((labels & 1) > 0))[1]
    return np.asarray(np.isin(parts, np.unique(parts[own])) & (parts > 0))


def _seed_mixture(samples: Pixels) -> Floats:
    """(1, 65) GrabCut's mixture of samples (n, 3): as many of them in each Gaussian, in the order of their main direction."""
    values = samples.astype(np.float64)
    centred = values - values.mean(axis=0)
    along = centred @ np.linalg.svd(centred, full_matrices=False)[2][0]
    groups = np.array_split(values[np.argsort(along, kind="stable")], COMPONENTS)
    groups = [group if len(group) else values for group in groups]
    spread = MIN_VARIANCE * np.eye(CHANNELS)
    means = np.array([group.mean(axis=0) for group in groups])
    covariances = np.array([(g - m).T @ (g - m) / len(g) + spread for g, m in zip(groups, means, strict=True)])
    weights = np.full(COMPONENTS, 1.0 / COMPONENTS)
    return np.concatenate([weights, means.ravel(), covariances.ravel()])[None]

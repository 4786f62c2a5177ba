# SPDX-License-Identifier: Apache-2.0
"""From a silhouette to a candidate object: its sub-pixel contours, and how it differs from the background."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.equality import compared_by_value
from grasptrack.errors import ContourError
from grasptrack.geometry.contours import Contour, View
from grasptrack.images import PLAIN, Channel, Grey
from grasptrack.segmentation.color_projection import best_color_projection
from grasptrack.segmentation.holes import MOST, ground_within, true_hole
from grasptrack.segmentation.localization import localize_contour
from grasptrack.segmentation.normalized_gradient import Planes
from grasptrack.segmentation.silhouettes import Silhouette

MAX_SHARE = 0.9
"""A region that fills a larger share of the image is the background."""
MIN_STEP = 1.0
"""px; an object differs from the background by at least as much as its edge rises over this distance. The grain of a
table has gradients too, but the same grey on both sides."""
NEAR = 1.5
"""px; closed edges lie on the edge itself, and farther away may be the other side of a thin part."""
ONE_SIGN = 0.9
"""Where at least this share of an outline rises outward, or falls, the object is dark, or light; otherwise it is mixed."""


@compared_by_value
class Candidate(NamedTuple):
    """A candidate object.

    Attributes:
        view: its outline.
        polarity: +1 darker than its surroundings, -1 lighter, 0 where its parts differ.
        inside, outside: median grey levels on either side of the outer contour.
        probability: that it is the object that is meant.
        sure: the probability is as large as was asked for.
        rating: of its outline, 0 to 1; NaN of what was given.
        lead: logarithm of its worth over that of the best region that is plainly another one; NaN of all but the first.
        returned: share of its outline that comes back when it is displaced; NaN of all but the first.
        level: grey level of the threshold that separated it from the ground; NaN where closed edges did.
        recipe: which closing of edges finds it; -1 for a threshold.
        channel: the mixture of colours that shows it; grey levels are levels of that.
        grain: Lab units per px of the image's own slopes, as that closing saw them.
        shaded: its shadow was cut out of the silhouette, and has to be again in every image.
    """

    view: View
    polarity: int
    inside: float
    outside: float
    probability: float = 0.0
    sure: bool = False
    rating: float = math.nan
    lead: float = math.nan
    returned: float = math.nan
    level: float = math.nan
    recipe: int = -1
    channel: Channel = PLAIN
    grain: float = math.nan
    shaded: bool = False

    def _repr_png_(self) -> bytes:
        """A picture of it for notebooks, on plain ground; `gt.draw` puts it on its image."""
        from grasptrack.presentation import png_of

        return png_of(self)

    def to_dict(self) -> dict[str, Any]:
        """Its attributes by name as plain values, for JSON and data frames; what is not finite is None."""
        from grasptrack.presentation import to_dict

        return to_dict(self)

    def __repr__(self) -> str:
        """One line: what it looks like, and how probably it is meant."""
        look = {1: "dark", -1: "light"}.get(self.polarity, "mixed")
        return f"Candidate({self.view!r}, {look}, probability {self.probability:.3f}{', sure' if self.sure else ''})"


def is_plausible_object(shape: Silhouette, size: tuple[int, ...]) -> bool:
    """Whether a silhouette is not the background: neither nearly the whole image nor along three of its sides."""
    x, y, w, h = shape.box
    touched = (x <= 0) + (y <= 0) + (x + w >= size[1]) + (y + h >= size[0])
    return shape.area <= MAX_SHARE * size[0] * size[1] and touched < 3


def of_one_level(grey: Grey, shape: Silhouette, polarity: int, hidden: Grey | None) -> Candidate | None:
    """The contours of a silhouette found by a threshold, or None if it cannot be an object.

    Args:
        grey: (H, W).
        shape: the silhouette.
        polarity: +1 darker than the background, -1 lighter.
        hidden: (H, W) nonzero where pixels are ignored.
    """
    if not is_plausible_object(shape, grey.shape):
        return None
    try:
        edge = localize_contour(grey, shape.outer, hole=False, polarity=polarity, hidden=hidden)
    except ContourError:
        return None
    outer = edge.contour
    cut = 0.0 if outer.clipped is None else float(outer.clipped.mean())
    if cut > 0.5 or outer.strength is None:
        return None
    strength = outer.strength if outer.clipped is None else outer.strength[~outer.clipped]
    slope, step = float(np.median(strength)), (edge.outside - edge.inside) * polarity
    if not (slope > 0.0 and step >= MIN_STEP * slope):
        return None
    holes = [true_hole(grey, chain, edge, polarity, hidden) for chain in shape.holes[:MOST]]
    return Candidate(View([outer, *(h for h in holes if h is not None)]), polarity, edge.inside, edge.outside)


def of_closed_edges(
    image: NDArray[np.uint8], seen: Planes | None, shape: Silhouette, hidden: Grey | None
) -> Candidate | None:
    """The contours of a silhouette found by closed edges, in the mixture of colours that shows it best.

    Args:
        image: (H, W) or BGR (H, W, 3).
        seen: its planes, for finding holes; None to skip them.
        shape: the silhouette.
        hidden: (H, W) nonzero where pixels are ignored.
    """
    if not is_plausible_object(shape, image.shape):
        return None
    grey = PLAIN.grey(image)
    try:
        edge = localize_contour(grey, shape.outer, hole=False, polarity=0, hidden=hidden, reach=NEAR)
        channel = best_color_projection(image, edge.contour)
        if channel is not PLAIN:
            grey = channel.grey(image)
            edge = localize_contour(grey, shape.outer, hole=False, polarity=0, hidden=hidden, reach=NEAR)
        polarity = sign_of(grey, edge.contour)
        if polarity:
            edge = localize_contour(grey, shape.outer, hole=False, polarity=polarity, hidden=hidden, reach=NEAR)
    except ContourError:
        return None
    if edge.contour.clipped is not None and edge.contour.clipped.mean() > 0.5:
        return None
    chains = [] if seen is None else ground_within(seen, shape)
    holes = [true_hole(grey, chain, edge, polarity, hidden) for chain in chains]
    view = View([edge.contour, *(h for h in holes if h is not None)])
    return Candidate(view, polarity, edge.inside, edge.outside, channel=channel)


def sign_of(grey: Grey, outline: Contour) -> int:
    """+1 where nearly all of an outline rises outward, -1 where it falls, 0 where it is mixed."""
    ahead = np.roll(outline.points, -1, axis=0) - np.roll(outline.points, 1, axis=0)
    normals = np.column_stack([ahead[:, 1], -ahead[:, 0]]) / np.maximum(np.hypot(*ahead.T), 1e-9)[:, None]
    rise = kernels.search_along_normals(grey, outline.points, np.ascontiguousarray(normals), 2.0, 0)[:, 1]
    total = float(np.abs(rise).sum())
    share = float(rise[rise > 0.0].sum()) / total if total > 0.0 else 0.5
    return 1 if share >= ONE_SIGN else -1 if share <= 1.0 - ONE_SIGN else 0


def contains_pixel(view: View, x: float, y: float) -> bool:
    """Whether a pixel lies within the outer contour."""
    return cv2.pointPolygonTest(view.outer.points.astype(np.float32), (float(x), float(y)), False) >= 0

# SPDX-License-Identifier: Apache-2.0
"""Pictures of the pairs of Tables II to V: outlines, curvature, contacts before and after the refinement."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from grasptrack import kernels
from grasptrack.geometry.contours import View
from grasptrack.grasp.contacts import Grasp
from grasptrack.transfer import grasp_line, transfer
from grasptrack.transfer.rrp import INTERPOLATED
from grasptrack.typing import Floats
from research.paper.correspondences import Correspondences, RefusedPair
from research.paper.footage import Footage
from research.paper.panels import Panel, draw_panels
from research.paper.transfers import Refused

Picture = tuple[str, NDArray[np.uint8]]
"""A caption and a BGR image."""
Images = Mapping[tuple[str, str], list[NDArray[np.uint8]]]


def table_pictures(
    examples: Sequence[Footage],
    tilted: Sequence[Footage],
    found: Sequence[Correspondences | RefusedPair],
    images: Images,
    frame: int,
) -> Iterator[Picture]:
    """Captions and pictures.

    Args:
        examples: footage of 4 DoF for Tables III and IV; what is not rendered is left out.
        tilted: rendered footage of 6 DoF, one for each of `found`.
        found: the pairs of Tables II and V.
        images: the first image and that of `frame`, by object and motion.
        frame: of the second view.
    """
    pairs = [(f, c) for f, c in zip(tilted, found, strict=True) if isinstance(c, Correspondences)]
    for f, c in pairs:
        yield _correspondence_picture(f, c, images[f.part.name, f.motion])
    for strategy, drawn in (("rrp", _tracked_panel), ("grasp-line", _grasp_line_panel)):
        for f in examples:
            first, second = f.outlines(strategy)[0], f.outlines(strategy)[frame]
            if f.kind != "rendered" or not isinstance(first, View) or not isinstance(second, View):
                continue
            try:
                moved = transfer(Grasp(f.contacts(strategy)), first, second, strategy).grasp.contacts
            except Refused:
                continue
            panels = [
                drawn(images[f.part.name, f.motion][0], "frame 0", first, f.contacts(strategy)),
                drawn(images[f.part.name, f.motion][1], f"frame {frame}", second, moved, f.truth(strategy, frame)),
            ]
            yield _CAPTIONS[strategy].format(f.part.name), draw_panels(panels)
    for f, c in pairs:
        yield _refinement_picture(f, c, images[f.part.name, f.motion])


_CAPTIONS = {
    "rrp": "Table III, {}: the outline that the snake moved, its reference points, the grasp, true places crossed",
    "grasp-line": "Table IV, {}: the grasp line beside the axis I_min through the centroid, true places crossed",
}


def _correspondence_picture(f: Footage, c: Correspondences, images: Sequence[NDArray[np.uint8]]) -> Picture:
    panels = [
        Panel(image, title, _contour_points(view), points=points, curve=curve, marks=marks)
        for image, title, view, points, curve, marks in zip(
            images,
            ("frame 0: selected points", f"frame {c.frame}: correspondences"),
            (c.first, c.second),
            c.points,
            c.curvature,
            c.samples,
            strict=True,
        )
    ]
    caption = f"Table II, {f.part.name}: selected points and their correspondences, with the curvature of both contours"
    return caption, draw_panels(panels, "curvature along the outer contour, from its first point")


def _refinement_picture(f: Footage, c: Correspondences, images: Sequence[NDArray[np.uint8]]) -> Picture:
    truth = f.truth("homography", c.frame)
    panels = [
        Panel(images[0], "frame 0: the grasp and the selected points", _contour_points(c.first), c.points[0]),
        Panel(images[1], f"frame {c.frame}: H applied (rings), refined", _contour_points(c.second), c.points[1]),
    ]
    grasps = (f.on_silhouette, None, None), (c.refined, c.applied, truth)
    drawn = [
        Panel(p.image, p.title, p.outlines, p.points, before=before, contacts=contacts, truth=true)
        for p, (contacts, before, true) in zip(panels, grasps, strict=True)
    ]
    return f"Table V, {f.part.name}: the homography applied and refined, true places crossed", draw_panels(drawn)


def _tracked_panel(
    image: NDArray[np.uint8], title: str, view: View, contacts: Floats, truth: Floats | None = None
) -> Panel:
    dots = np.concatenate([c.points[::INTERPOLATED] for c in view.contours])
    return Panel(image, title, _contour_points(view), contacts=contacts, truth=truth, dots=dots)


def _grasp_line_panel(
    image: NDArray[np.uint8], title: str, view: View, contacts: Floats, truth: Floats | None = None
) -> Panel:
    described = grasp_line.describe(Grasp(contacts), view)
    area, *_ = kernels.polygon_moments(view.points, view.offsets)
    axis = (*described.centroid, described.theta, 1.1 * math.sqrt(area))
    return Panel(image, title, _contour_points(view), contacts=contacts, truth=truth, axis=axis)


def _contour_points(view: View) -> list[Floats]:
    return [c.points for c in view.contours]

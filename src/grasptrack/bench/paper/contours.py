# SPDX-License-Identifier: Apache-2.0
"""What the strategies see in each frame of a trajectory, made from the known motion without an image."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from grasptrack.bench.paper.objects import Motion, Part, camera_trajectory, path_homographies, sample_view
from grasptrack.bench.simulation import Camera
from grasptrack.bench.simulation.render import inside_mask
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.contacts import Grasp
from grasptrack.segmentation.silhouettes import trace_silhouettes
from grasptrack.snake.shape_space import ShapeSpace
from grasptrack.transfer import rrp
from grasptrack.typing import Floats

Kind = Literal["corresponding", "resampled", "pixel chain", "rendered"]
Seen = View | str
"""An outline, or why there is none."""

KINDS: dict[Kind, str] = {
    "corresponding": "each contour is the first one moved by the true homography, point by point, as in Section V",
    "resampled": "the same curves, sampled again at 300 points from another start; "
    "RRP on the first contour moved by the similarity that fits best, a perfect tracker of 4 DoF",
    "pixel chain": "contours are chains of whole pixels at 300 points; RRP on that tracker's samples rounded to whole "
    "pixels, with whole interp",
    "rendered": "contours are found in rendered images of 640x480 with noise: segmented for grasp line and homography, "
    "at about a point to the px, a B-spline snake of 4 DoF for RRP",
}
"""The ways in which contours come about."""


@dataclass(frozen=True)
class Footage:
    """One object along one trajectory.

    Attributes:
        part: the object.
        kind: how the contours came about, see `KINDS`.
        motion: "4 DoF" or "6 DoF".
        H: (F, 3, 3) H_current_reference, exact.
        areas: (F,) px^2 of the object.
        silhouettes: by frame, for grasp line and homography.
        tracked: by frame, point i always the same point, for RRP.
        on_silhouette, on_tracked: (2, 2) px, the grasp on the outline of the first frame; its truth is moved by H.
    """

    part: Part
    kind: Kind
    motion: Motion
    H: Floats
    areas: Floats
    silhouettes: tuple[Seen, ...]
    tracked: tuple[Seen, ...]
    on_silhouette: Floats
    on_tracked: Floats

    def outlines(self, strategy: str) -> tuple[Seen, ...]:
        """By frame, what a strategy works on."""
        return self.tracked if strategy == "rrp" else self.silhouettes

    def contacts(self, strategy: str) -> Floats:
        """(2, 2) px, the grasp in the first frame as the strategy is given it."""
        return self.on_tracked if strategy == "rrp" else self.on_silhouette

    def truth(self, strategy: str, frame: int) -> Floats:
        """(2, 2) px, where that grasp truly is in a frame."""
        return apply_homography(self.H[frame], self.contacts(strategy))


def ideal_footage(part: Part, kind: Kind, motion: Motion, frames: int, seed: int) -> Footage:
    """Contours of a kind other than "rendered"; `seed` is of the trajectory and the starts of the contours."""
    H = path_homographies(camera_trajectory(motion, frames, seed))
    exact = [transform_view(part.reference, h) for h in H]
    contacts = part.contacts, part.contacts
    if kind == "corresponding":
        silhouettes, tracked = exact, exact
    elif kind == "resampled":
        rng = np.random.default_rng((seed, 31))
        silhouettes = [exact[0], *(resample_view(view, rng) for view in exact[1:])]
        tracked = in_four_dof(part.reference, H)
    elif kind == "pixel chain":
        silhouettes = [pixel_chain_view(view) for view in exact]
        tracked = [round_to_pixels(view) for view in in_four_dof(part.reference, H)]
        contacts = Grasp(part.contacts).snapped(silhouettes[0]).contacts, nearest_points(part.contacts, tracked[0])
    else:
        raise ValueError(f'"{kind}" contours are not made without images')
    contacts = contacts[0], on_grid(contacts[1], tracked[0])
    areas = np.array([sum(c.signed_area for c in view.contours) for view in exact])
    return Footage(part, kind, motion, H, areas, tuple(silhouettes), tuple(tracked), *contacts)


def transform_view(view: View, H: Floats) -> View:
    """A view under a homography, point by point."""
    return view.transformed(H)


def resample_view(view: View, rng: np.random.Generator) -> View:
    """The same curves at as many points, in equal steps, from another start."""
    return sample_view(tuple(np.roll(c.points, -int(rng.integers(len(c))), axis=0) for c in view.contours))


def in_four_dof(reference: View, H: Floats) -> list[View]:
    """The reference moved to each frame by the similarity that comes nearest to its homography (F, 3, 3)."""
    space = ShapeSpace(reference.points)
    return [transform_view(reference, space.homography(space.state(h))) for h in H]


def pixel_chain_view(view: View) -> View:
    """Contours as a binary image shows them: chains of its pixels, thinned to the usual number of points."""
    camera = Camera()
    inside = inside_mask([c.points for c in view.contours], camera.width, camera.height)
    shape = trace_silhouettes(inside.astype(np.uint8), 30.0)[0]
    return sample_view(tuple(np.asarray(c, dtype=np.float64) for c in (shape.outer, *shape.holes)))


def round_to_pixels(view: View) -> View:
    """Every point at the middle of its pixel."""
    return View([Contour(np.rint(c.points), hole=c.hole) for c in view.contours])


def on_grid(contacts: Floats, view: View) -> Floats:
    """(k, 2) px, contacts where their RRP coordinates put them: within 2^-32 of a side of where they were given."""
    return rrp.apply(rrp.describe(Grasp(contacts), view), view).grasp.contacts


def nearest_points(contacts: Floats, view: View) -> Floats:
    """(k, 2) of the view's points the nearest to each contact (k, 2): a place with a whole interp."""
    apart = np.linalg.norm(view.points[None] - contacts[:, None], axis=2)
    return np.asarray(view.points[apart.argmin(axis=1)])

# SPDX-License-Identifier: Apache-2.0
"""What the strategies of Section V see: three objects on predefined trajectories, as contours and as rendered images."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from grasptrack import kernels
from grasptrack.errors import GraspTrackError, ObservationError, TransferError
from grasptrack.first_image import FirstImage
from grasptrack.geometry.contours import Contour, View
from grasptrack.geometry.homographies import apply_homography
from grasptrack.grasp.contacts import Grasp
from grasptrack.grasp.synthesis import synthesize
from grasptrack.images import Grey
from grasptrack.segmentation.silhouettes import trace_silhouettes
from grasptrack.snake.shape_space import ShapeSpace
from grasptrack.tracking.strategies import Snakes
from grasptrack.transfer import STRATEGIES, strategy_named
from grasptrack.typing import Floats, Pixels
from grasptrack_bench.baselines.paper import ExtractedOutlines, Seen, begin_near
from grasptrack_bench.simulation import SHAPES, Path, Pinhole, Scene, Shape, similarity_path, tilting_path
from grasptrack_bench.simulation.coverage import inside_mask

Motion = Literal["4 DoF", "6 DoF", "approach"]
MOTIONS: tuple[Motion, ...] = ("4 DoF", "6 DoF", "approach")
IN_IMAGES: tuple[Motion, ...] = ("4 DoF", "6 DoF")
"""Motions that keep the whole object in an image of 640x480."""

Images = Mapping[tuple[str, str], list[Grey]]
"""Images (H, W) by object and motion."""

OBJECTS = ("bracket", "spanner", "notched-plate")
"""A bracket, a tool and a plate: distinct axes, at least four corners, no symmetry."""
POINTS = 300
"""Of an outer contour, as in Section V."""
LEAST_POINTS = 24
"""Of a hole's contour."""
FRAMES = 100
"""Of the whole trajectory; a shorter run is its beginning, so that the motion between frames is the same."""
DISTANCE = 5.4
"""Camera to table in roots of the object's area: the root of the area is then some 130 px."""
TILT = math.radians(20.0)
"""Largest tilt of the trajectory of 6 DoF."""
APPROACH = 2.5
"""The object's scale at the end of the approach over that at its beginning."""


@dataclass(frozen=True)
class FilmedPart:
    """One object in the first view of a trajectory.

    Attributes:
        name: of its shape.
        curves: (N, 2) px each, the exact polygons in the first view, outer first.
        reference: contours of about `POINTS` points in the first view, px.
        contacts: (2, 2) px, the best grasp that all strategies can describe.
    """

    name: str
    curves: tuple[Floats, ...]
    reference: View
    contacts: Floats

    @property
    def shape(self) -> Shape:
        """Its polygons."""
        return SHAPES[self.name]()

    @property
    def opening(self) -> float:
        """px in the first view."""
        return float(np.hypot(*(self.contacts[1] - self.contacts[0])))


def camera_trajectory(motion: Motion, frames: int, seed: int) -> Path:
    """The path of the camera. Both motions share the first frame, which is frontal.

    Args:
        motion: "4 DoF" (the image moves by similarities), "6 DoF" (the camera tilts as well) or "approach" (4 DoF, the
            distance falling evenly to 1 / `APPROACH`).
        frames: the first so many frames of the path.
        seed: of the path.
    """
    whole = max(frames, FRAMES)
    turn, zoom, reach = math.radians(60.0), 0.12, 0.2
    if motion == "6 DoF":
        path = tilting_path(whole, tilt=TILT, distance=DISTANCE, reach=reach, zoom=zoom, turn=turn, seed=seed)
    else:
        path = similarity_path(whole, distance=DISTANCE, reach=reach, zoom=zoom, turn=turn, seed=seed)
    if motion == "approach":
        path = replace(path, distance=np.linspace(DISTANCE, DISTANCE / APPROACH, whole))
    return path[:frames]


def path_homographies(path: Path) -> Floats:
    """(F, 3, 3) H_current_reference of each frame, the reference being the first."""
    to_image = path.table_to_image(Pinhole())
    moved = to_image @ np.linalg.inv(to_image[0])
    return np.asarray(moved / moved[:, 2:, 2:], dtype=np.float64)


def sample_view(polygons: tuple[Floats, ...], starts: Floats | None = None) -> View:
    """Outer contour of `POINTS` points and holes as dense, equal steps along closed polygons (N, 2) px, outer first.

    They start (C,) steps from each polygon's first point; None begins there.
    """
    lengths = [float(kernels.arc_length(p)[-1]) for p in polygons]
    counts = [max(LEAST_POINTS, round(POINTS * length / lengths[0])) for length in lengths]
    counts[0] = POINTS
    begun = [0.0] * len(polygons) if starts is None else starts.tolist()
    rings = [
        kernels.resample(_begun_at(p, start * length / count), count, 0.0)
        for p, length, count, start in zip(polygons, lengths, counts, begun, strict=True)
    ]
    return View([Contour.trusted(ring, hole=i > 0) for i, ring in enumerate(rings)])


def _begun_at(polygon: Floats, along: float) -> Floats:
    """The same closed polygon with its first point so many px further along it."""
    if along == 0.0:
        return polygon
    arc = kernels.arc_length(polygon)
    along %= arc[-1]
    side = int(np.searchsorted(arc, along, side="right")) - 1
    share = (along - arc[side]) / (arc[side + 1] - arc[side])
    after = polygon[(side + 1) % len(polygon)]
    first = polygon[side] + share * (after - polygon[side])
    return np.concatenate([first[None], np.roll(polygon, -(side + 1), axis=0)])


def make_part(name: str, seed: int) -> FilmedPart:
    """An object and its grasp in the first view of the trajectories."""
    shape = SHAPES[name]()
    to_image = camera_trajectory("4 DoF", 1, seed).table_to_image(Pinhole())[0]
    curves = tuple(np.ascontiguousarray(apply_homography(to_image, p)) for p in shape.polygons)
    reference = sample_view(curves)
    return FilmedPart(name, curves, reference, describable_contacts(reference))


def describable_contacts(view: View) -> Floats:
    """(2, 2) px, the best grasp on an outline that all strategies can describe."""
    reason = "no stable grasp"
    for grasp in synthesize(view, top=10):
        try:
            for strategy in STRATEGIES:
                strategy_named(strategy).describe(grasp, view)
        except GraspTrackError as error:
            reason = str(error)
        else:
            return grasp.contacts
    raise ObservationError(reason)


Kind = Literal["corresponding", "resampled", "pixel chain", "rendered", "filmed"]

KINDS: dict[Kind, str] = {
    "corresponding": "each contour is the first one moved by the true homography, point by point, as in Section V",
    "resampled": "the true curves, sampled anew at 300 points that begin between the old ones; "
    "RRP on the first contour moved by the similarity that fits best, a perfect tracker of 4 DoF",
    "pixel chain": "every so many-th pixel of a chain of whole pixels, 300 in all, from the one nearest to where the motion "
    "takes the first beginning; RRP on that tracker's samples rounded to whole pixels; every contact, given or answered, is "
    "one of these",
    "rendered": "contours are found in rendered images of 640x480 with noise: segmented for grasp line and homography, "
    "at about a point to the px and begun where the motion takes the first beginning, a B-spline snake of 4 DoF for RRP",
}
"""The ways in which contours come about on synthetic trajectories; "filmed" are those of real images."""


TRACKED = ("rrp", "paper-rrp")
"""The strategies that work on tracked outlines; the others take what was extracted."""


@dataclass(frozen=True)
class Footage:
    """One object along one trajectory.

    Attributes:
        part: the object.
        kind: how the contours came about, see `KINDS`.
        motion: of the camera, see `camera_trajectory`.
        H: (F, 3, 3) H_current_reference, exact.
        areas: (F,) px^2 of the object.
        silhouettes: by frame, for grasp line and homography.
        tracked: by frame, point i always the same point, for RRP.
        on_silhouette, on_tracked: (2, 2) px, the grasp on the outline of the first frame; its truth is moved by H.
    """

    part: FilmedPart
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
        return self.tracked if strategy in TRACKED else self.silhouettes

    def contacts(self, strategy: str) -> Floats:
        """(2, 2) px, the grasp in the first frame as the strategy is given it."""
        return self.on_tracked if strategy in TRACKED else self.on_silhouette

    @property
    def quantised(self) -> bool:
        """Whether contacts can only be points of the contours, as on the paper's chains of pixels."""
        return self.kind == "pixel chain"

    def truth(self, strategy: str, frame: int) -> Floats:
        """(2, 2) px, where that grasp truly is in a frame."""
        return apply_homography(self.H[frame], self.contacts(strategy))


def ideal_footage(part: FilmedPart, kind: Kind, motion: Motion, frames: int, seed: int) -> Footage:
    """Contours of a kind other than "rendered"; `seed` is of the trajectory and the starts of the contours."""
    H = path_homographies(camera_trajectory(motion, frames, seed))
    exact = [part.reference.transformed(h) for h in H]
    contacts = part.contacts, part.contacts
    if kind == "corresponding":
        silhouettes, tracked = exact, exact
    elif kind == "resampled":
        rng = np.random.default_rng((seed, 31))
        silhouettes = [exact[0], *(resample_view(moved_curves(part, h), rng) for h in H[1:])]
        tracked = in_four_dof(part.reference, H)
    elif kind == "pixel chain":
        silhouettes = [pixel_chain_view(moved_curves(part, H[0]))]
        begun = silhouettes[0].outer.points[:1]
        silhouettes += [pixel_chain_view(moved_curves(part, h), apply_homography(h, begun)[0]) for h in H[1:]]
        tracked = [round_to_pixels(view) for view in in_four_dof(part.reference, H)]
        contacts = nearest_points(part.contacts, silhouettes[0]), nearest_points(part.contacts, tracked[0])
    else:
        raise ValueError(f'"{kind}" contours are not made without images')
    areas = np.array([sum(c.signed_area for c in view.contours) for view in exact])
    return Footage(part, kind, motion, H, areas, tuple(silhouettes), tuple(tracked), *contacts)


def moved_curves(part: FilmedPart, H: Floats) -> tuple[Floats, ...]:
    """(N, 2) px each, the exact polygons of an object in the view to which H (3, 3) leads from the first."""
    return tuple(apply_homography(H, curve) for curve in part.curves)


def resample_view(polygons: tuple[Floats, ...], rng: np.random.Generator) -> View:
    """Curves (N, 2) px at the usual number of points, in equal steps, from anywhere within the first step.

    What is sampled is the curve and not the contour of another view: neither knows where the other's points were. It begins
    near the other's beginning, as the paper's window about an index needs it; our own strategies do not.
    """
    return sample_view(polygons, rng.random(len(polygons)))


def in_four_dof(reference: View, H: Floats) -> list[View]:
    """The reference moved to each frame by the similarity that comes nearest to its homography (F, 3, 3)."""
    space = ShapeSpace(reference.points)
    return [reference.transformed(space.homography(space.state_near(h))) for h in H]


def pixel_chain_view(polygons: tuple[Floats, ...], begun: Floats | None = None) -> View:
    """Curves (N, 2) px as a binary image shows them: so many of its pixels, as evenly as whole ones can be taken.

    The outer one comes first; its chain begins at the pixel nearest to `begun` (2,) px, or if None at the topmost pixel.
    """
    corner = np.floor(polygons[0].min(axis=0)) - 2.0
    width, height = (np.ceil(polygons[0].max(axis=0)) + 3.0 - corner).astype(int).tolist()
    inside = inside_mask([p - corner for p in polygons], width, height)
    shape = trace_silhouettes(inside.astype(np.uint8), 30.0)[0]
    share = min(1.0, POINTS / len(shape.outer))
    rings = [(POINTS, shape.outer), *((round(share * len(hole)), hole) for hole in shape.holes)]
    contours = []
    for i, (count, chain) in enumerate(rings):
        points = np.asarray(chain, dtype=np.float64) + corner
        if i == 0 and begun is not None:
            points = begin_near(points, begun)
        taken = min(len(points), max(LEAST_POINTS, count))
        contours.append(Contour.trusted(points[np.arange(taken) * len(points) // taken], hole=i > 0))
    return View(contours)


Start = Literal["true", "tracked", "arbitrary"]
STARTS: dict[Start, str] = {
    "true": "each contour begins where the motion takes the first beginning, which is the text read in its favour, and so in "
    "every other table",
    "tracked": "at the point nearest in the image to where the last frame's began, for which no truth is needed",
    "arbitrary": "at any point, drawn evenly, as what extracts contours may begin them",
}
"""Where contours begin, on which the window about an index hangs; the text does not say."""


def begun_near(view: View, place: Floats) -> View:
    """The same outline, its outer contour begun at its point nearest to a place (2,) px."""
    outer = view.outer
    first = int(np.hypot(*(outer.points - place).T).argmin())
    cut = None if outer.clipped is None else np.roll(outer.clipped, -first)
    return View([Contour.trusted(np.roll(outer.points, -first, axis=0), clipped=cut), *view.contours[1:]])


def started(footage: Footage, start: Start, seed: int) -> Footage:
    """The same footage with its silhouettes begun by another rule than the true one, see `STARTS`."""
    rng = np.random.default_rng((seed, 43))
    seen: list[Seen] = [footage.silhouettes[0]]
    last = seen[0]
    for view in footage.silhouettes[1:]:
        if isinstance(view, View) and isinstance(last, View) and start != "true":
            points = view.outer.points
            view = begun_near(view, last.outer.points[0] if start == "tracked" else rng.choice(points))
            last = view
        seen.append(view)
    return replace(footage, silhouettes=tuple(seen))


def round_to_pixels(view: View) -> View:
    """Every point at the middle of its pixel."""
    return View([Contour.trusted(np.rint(c.points), hole=c.hole) for c in view.contours])


def nearest_points(contacts: Floats, view: View) -> Floats:
    """(k, 2) of the view's points the nearest to each contact (k, 2): a place with a whole interp."""
    apart = np.linalg.norm(view.points[None] - contacts[:, None], axis=2)
    return np.asarray(view.points[apart.argmin(axis=1)])


def rendered_footage(
    part: FilmedPart, motion: Motion, frames: int, seed: int, after: Callable[[], None] = lambda: None
) -> tuple[Footage, list[Grey]]:
    """A trajectory as images, and what was observed in them, with the first image and the one in the middle, (H, W) each."""
    return observe_scene(part, motion, Scene(part.shape, camera_trajectory(motion, frames, seed), seed=seed), after)


def observe_scene(
    part: FilmedPart, motion: Motion, scene: Scene, after: Callable[[], None] = lambda: None
) -> tuple[Footage, list[Grey]]:
    """As `rendered_footage`, of any scene of the object that begins as the trajectories do."""
    H = np.array([scene.homography(k) for k in range(len(scene))])
    kept: list[Grey] = []
    areas: list[float] = []

    def shown() -> Iterator[Grey]:
        for k, frame in enumerate(scene):
            areas.append(frame.area)
            if k in (0, middle_frame(len(scene))):
                kept.append(frame.image)
            yield frame.image
            after()

    seen = follow_outlines(shown(), H, part.contacts)
    return Footage(part, "rendered", motion, H, np.array(areas), *seen), kept


def follow_outlines(
    images: Iterator[Pixels], H: Floats, contacts: Floats
) -> tuple[tuple[Seen, ...], tuple[Seen, ...], Floats, Floats]:
    """What the strategies work on in images: outlines extracted one by one, and those that a snake of 4 DoF carries.

    Args:
        images: (H, W) or (H, W, 3) one after the other.
        H: (F, 3, 3) H_current_reference, which says where each extracted outline begins.
        contacts: (k, 2) px in the first image.

    Returns:
        Extracted and tracked outlines by frame, and the contacts on the first of each.
    """
    extracted = ExtractedOutlines()
    candidate = extracted.candidates(next(images), FirstImage())[0]
    grey = extracted.choose(candidate)
    grasp = Grasp(contacts).snapped(candidate.view)
    snake = Snakes(grasp, candidate.view, grey)
    silhouettes: list[Seen] = [candidate.view]
    tracked: list[Seen] = []
    template: View | None = None
    for image, motion in zip(images, H[1:], strict=True):
        grey, found = extracted.next(image)
        if isinstance(found, View):
            found = begun_near(found, apply_homography(motion, candidate.view.outer.points[:1])[0])
        silhouettes.append(found)
        try:
            carried = snake.carry(grey, None, None)
        except TransferError as error:
            tracked.append(str(error))
        else:
            tracked.append(carried.view)
            if template is None:
                back = np.asarray(np.linalg.inv(carried.homography), dtype=np.float64)
                template = carried.view.transformed(back)
    start: Seen = template if template is not None else "the snake followed no image"
    on_tracked = grasp.contacts if template is None else grasp.snapped(template).contacts
    return tuple(silhouettes), (start, *tracked), grasp.contacts, on_tracked


def middle_frame(frames: int) -> int:
    """The frame of the reference error: 50 of 100."""
    return frames // 2

# SPDX-License-Identifier: Apache-2.0
"""Whether tools in photos are followed that known homographies move: real metal, light and dirt, with exact truth.

The outline is drawn round the mask.
"""

from __future__ import annotations

import math
import zlib
from typing import NamedTuple

import cv2
import numpy as np

from grasptrack.demo.run import accept_limit
from grasptrack.errors import ConditioningError, GraspTrackError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.kernels import seen_area
from grasptrack.tracking.tracker import GraspTracker
from grasptrack.typing import Bools, Floats, Pixels
from grasptrack_bench.simulation.codec import Codec, through_codec
from research.studies import common
from research.studies.common import Photo

KINDS = {
    "plain": "the camera moves, turns, nears and tilts",
    "h264-30": "the same through H.264 at a constant rate factor of 30",
    "h264-36": "of 36",
    "h265-32": "through H.265 at 32",
    "blur": "faster, with the shutter open for 80 % of the time",
    "light": "the light fades, and a lamp wanders",
    "small": "at half the size",
    "jpeg": "each image a JPEG of quality 25",
    "jump": "the camera jumps",
    "cover": "another tool is drawn across",
    "pushed": "the tool is pushed over the bench by 140 px",
    "pushed-slowly": "by 35 px",
    "object-jump": "it lies elsewhere from one image to the next",
    "exchange": "another tool comes to its place",
    "mirror": "its mirror image does",
    "twin": "it leaves over one border while its equal comes in over the other",
}
ON_THE_BENCH = {"pushed", "pushed-slowly", "object-jump", "exchange", "mirror", "twin"}
"""Kinds in which the tool is cut out, and laid on the bench, which is filled in where it lay; the camera hardly moves."""
FOCAL = 800.0
"""px, of the tilts that are drawn."""
RATE = 30.0
"""Images a second."""
LEAST_SIZE = 20.0
"""px, sqrt(area), from which on a tool counts that is not found."""
NEARER = 1.12
"""By which the first image is enlarged: the photo's border stays out of view for a while."""
CODECS = {"h264": "libx264", "h265": "libx265"}


class MovedPhoto(NamedTuple):
    """Images (H, W, 3), and of each the homography (3, 3) from the photo, whether the tool lies there, and its time in s.

    `mask` is the tool's first one.
    """

    images: list[Pixels]
    ways: list[Floats]
    present: list[bool]
    mask: Pixels
    times: list[float]


def shift(x: float, y: float) -> Floats:
    """(3, 3) by so many px."""
    return np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])


def turned(angle: float) -> Floats:
    """(3, 3) by so many rad about the origin."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def tilted(angle: float, azimuth: float) -> Floats:
    """(3, 3) of a plane that leans by `angle` rad about an axis at `azimuth`."""
    lean = np.array([[1.0, 0.0, 0.0], [0.0, math.cos(angle), 0.0], [0.0, math.sin(angle) / FOCAL, 1.0]])
    return np.asarray(turned(azimuth) @ lean @ turned(-azimuth))


def smooth_way(rng: np.random.Generator, count: int, most: float) -> Floats:
    """(count,) from 0, as far as `most` at its farthest."""
    x = np.linspace(0.0, math.pi, count)
    waves = [rng.normal() * np.sin(k * x + rng.uniform(0.0, 2.0 * math.pi)) / k for k in (1, 2)]
    way = np.sum(waves, axis=0)
    way -= way[0]
    return np.asarray(most * way / max(1e-9, float(np.abs(way).max())), dtype=np.float64)


def axis_of(mask: Pixels) -> tuple[Floats, float, float]:
    """Middle (2,) px, direction in rad and standard deviation along the longest axis of a mask."""
    y, x = np.nonzero(mask)
    middle = np.array([x.mean(), y.mean()])
    values, axes = np.linalg.eigh(np.cov(np.stack([x, y])))
    return middle, math.atan2(axes[1, 1], axes[0, 1]), math.sqrt(float(values[1]))


def lay_on(ground: Floats, photo: Pixels, alpha: Floats, H: Floats) -> Floats:
    """What a mask (H, W), 0 to 1, cuts out of a photo, laid on a ground (H, W, 3) by a homography."""
    size = ground.shape[1::-1]
    paint = cv2.warpPerspective(photo, H, size, borderMode=cv2.BORDER_REPLICATE).astype(np.float64)
    share = cv2.warpPerspective(alpha, H, size).astype(np.float64)[..., None]
    return np.asarray(ground + share * (paint - ground))


def soft_mask(mask: Pixels) -> Floats:
    """(H, W) 0 to 1, with the pixels that are of both."""
    wider = cv2.dilate(mask, np.ones((3, 3), np.uint8)).astype(np.float64)
    return np.asarray(cv2.GaussianBlur(wider, (0, 0), 1.0), dtype=np.float64)


def fill_bench(photo: Pixels, mask: Pixels) -> Pixels:
    """A photo without what its mask shows."""
    around = cv2.dilate(mask, np.ones((15, 15), np.uint8))
    return np.asarray(cv2.inpaint(photo, around, 7, cv2.INPAINT_TELEA), np.uint8)


def draw_scene(photo: Photo, guest: Photo, kind: str, count: int, seed: int) -> MovedPhoto:
    """So many images of one kind; the guest is what covers a tool, or takes its place."""
    rng = np.random.default_rng((seed, zlib.crc32(f"{photo.name}{kind}".encode())))
    image, mask, (height, width) = photo.image, whole_part(photo.truth), photo.truth.shape
    middle, along, length = axis_of(mask)
    centre = np.array([width, height]) / 2.0
    calm = kind in ON_THE_BENCH
    lively = 3.0 if kind == "blur" else 0.12 if calm else 1.0
    turns = smooth_way(rng, count, (0.03 if calm else rng.uniform(0.1, 0.8)) * (1.5 if kind == "blur" else 1.0))
    nears = np.abs(smooth_way(rng, count, 0.03 if calm else rng.uniform(0.1, 0.5)))
    tilts = np.abs(smooth_way(rng, count, 0.03 if calm else rng.uniform(0.1, 0.5)))
    x, y = smooth_way(rng, count, 25.0 * lively), smooth_way(rng, count, 20.0 * lively)
    azimuth, half = rng.uniform(0.0, 2.0 * math.pi), count // 2
    if kind == "jump":
        x[half:] += rng.choice([-1.0, 1.0]) * 90.0
        y[half:] += rng.choice([-1.0, 1.0]) * 60.0
        turns[half:] += rng.uniform(0.4, 1.5)
    inward = math.atan2(*(centre - middle)[::-1]) + rng.uniform(-0.6, 0.6)
    way, spin = np.array([math.cos(inward), math.sin(inward)]), rng.uniform(-1.0, 1.0)
    pace = np.clip((np.arange(count) - 4.0) / (count - 6.0), 0.0, 1.0)

    def camera(t: float) -> Floats:
        now = [float(np.interp(t, np.arange(count), each)) for each in (x, y, nears, turns, tilts)]
        to = centre + 0.6 * (middle - centre) + now[:2]
        grown = np.diag([NEARER * (1.0 + now[2])] * 2 + [1.0])
        return np.asarray(shift(*to) @ tilted(now[4], azimuth) @ turned(now[3]) @ grown @ shift(*-middle))

    def object_way(i: int) -> Floats:
        if kind in ("pushed", "pushed-slowly"):
            far, turn = (140.0, spin) if kind == "pushed" else (35.0, 0.3 * spin)
            return np.asarray(shift(*(middle + pace[i] * far * way)) @ turned(pace[i] * turn) @ shift(*-middle))
        if kind == "object-jump" and i >= half:
            return np.asarray(shift(*(middle + 80.0 * way)) @ turned(1.5 * spin) @ shift(*-middle))
        return shift(*(pace[i] * (width - 80.0) * way)) if kind == "twin" else np.eye(3)

    alpha = soft_mask(mask)
    filled = image
    if kind in ON_THE_BENCH:
        filled = fill_bench(image, mask)
    other = whole_part(guest.truth)
    there, other_along, other_length = axis_of(other)
    gone = count // 3 if kind in ("exchange", "mirror") else count

    def exposed(t: float, i: int) -> Floats:
        H = camera(t)
        ground = cv2.warpPerspective(filled, H, (width, height), borderMode=cv2.BORDER_REFLECT_101).astype(np.float64)
        if kind == "cover" and i >= 6:
            at = apply_homography(H, middle[None])[0] + way * (1.0 - 2.0 * (i - 6.0) / (count - 8.0)) * 420.0
            return lay_on(ground, guest.image, soft_mask(other), shift(*at) @ turned(inward + 1.2) @ shift(*-there))
        if i >= gone:
            if i < gone + 3:
                return ground
            flip = turned(along) @ np.diag([1.0, -1.0, 1.0]) @ turned(-along)
            grown = turned(along - other_along) @ np.diag([length / other_length] * 2 + [1.0])
            if kind == "mirror":
                return lay_on(ground, image, alpha, H @ shift(*middle) @ flip @ shift(*-middle))
            return lay_on(ground, guest.image, soft_mask(other), H @ shift(*middle) @ grown @ shift(*-there))
        if kind in ON_THE_BENCH:
            ground = lay_on(ground, image, alpha, H @ object_way(i))
        if kind == "twin":
            ground = lay_on(ground, image, alpha, H @ shift(*(-(width - 80.0) * way)) @ object_way(i))
        return ground

    scale = 0.5 if kind == "small" else 1.0
    shrink = np.array([[scale, 0.0, 0.5 * (scale - 1.0)], [0.0, scale, 0.5 * (scale - 1.0)], [0.0, 0.0, 1.0]])
    noise, images, Y, X = rng.uniform(1.0, 3.0), list[Pixels](), *np.mgrid[:height, :width]
    for i in range(count):
        times = i + np.linspace(-0.4, 0.4, 9) if kind == "blur" else np.array([float(i)])
        shot = np.mean([exposed(float(t), i) for t in times], axis=0)
        if kind == "light":
            lamp = (X - width * (0.2 + 0.6 * i / count)) ** 2 + (Y - height * (0.5 + 0.3 * math.sin(i / 5.0))) ** 2
            shot = shot * (0.55 + 0.45 * math.cos(i / 6.0)) + 90.0 * np.exp(-lamp / (2.0 * 90.0**2))[..., None]
        if kind == "small":
            shot = cv2.resize(shot, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
        taken = np.clip(np.rint(shot + rng.normal(0.0, noise, shot.shape)), 0, 255).astype(np.uint8)
        if kind == "jpeg":
            coded = cv2.imencode(".jpg", taken, [cv2.IMWRITE_JPEG_QUALITY, 25])[1]
            taken = np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR), np.uint8)
        images.append(taken)
    if kind[:4] in CODECS:
        images = through_codec(images, Codec(CODECS[kind[:4]], float(kind[5:])))
    ways = [np.asarray(shrink @ camera(float(i)) @ object_way(i)) for i in range(count)]
    first = cv2.warpPerspective(255 * mask, ways[0], images[0].shape[1::-1])
    seconds = [i / RATE for i in range(count)]
    return MovedPhoto(images, ways, [i < gone for i in range(count)], (first > 127).astype(np.uint8), seconds)


def whole_part(truth: Bools) -> Pixels:
    """(H, W) 1 on the largest part of a mask."""
    _, labels, told, _ = cv2.connectedComponentsWithStats(truth.astype(np.uint8))
    return np.asarray(labels == 1 + int(np.argmax(told[1:, cv2.CC_STAT_AREA])), np.uint8)


def follow_tool(scene: MovedPhoto) -> dict[str, int]:
    """Counts of one sequence: images that show the tool, those of them that are answered rightly, and all that are wrong."""
    told = dict.fromkeys(("begun", "images", "right", "wrong"), 0)
    edges, _ = cv2.findContours(scene.mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    drawn = cv2.approxPolyDP(max(edges, key=cv2.contourArea), 2.0, True)[:, 0]
    tracker, (height, width) = GraspTracker(outline=drawn), scene.mask.shape
    begun = outline = np.zeros((0, 2))
    for i, (image, way, present, time) in enumerate(
        zip(scene.images, scene.ways, scene.present, scene.times, strict=True)
    ):
        try:
            result = tracker.update(image, time)
        except GraspTrackError:
            return told
        if i == 0:
            if result.contacts is None or result.view is None:
                return told
            begun, outline, told["begun"] = result.contacts, result.view.outer.points, 1
        H = way @ np.linalg.inv(scene.ways[0])
        try:
            there, area = apply_homography(H, begun), abs(seen_area(H, np.ascontiguousarray(outline)))
        except ConditioningError:
            continue
        x, y = there.T
        inside = area >= LEAST_SIZE**2 and bool(((x >= 0.0) & (y >= 0.0) & (x < width) & (y < height)).all())
        told["images"] += present and inside
        if result.contacts is not None:
            off = float(np.hypot(*(result.contacts - there).T).max())
            right = present and off <= accept_limit(area)
            told["right"] += right and inside
            told["wrong"] += not right
    return told


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__, kinds=",".join(KINDS), frames=24, seed=1)
    parser.add_argument("--each", type=int, default=1, help="take every so many-th photo, ...")
    parser.add_argument("--from", dest="start", type=int, default=0, help="... from this one on")
    asked, photos = common.parse_with_photos(parser)
    common.begin_section("Photos of tools, moved")
    taken = list(range(asked.start, len(photos), asked.each))
    common.add_paragraph(f"{len(taken)} photos, each in {asked.frames} images of every kind.")
    runs = []
    for kind in asked.kinds.split(","):
        rng = np.random.default_rng((asked.seed, zlib.crc32(kind.encode())))
        guests = [(k + 1 + int(rng.integers(max(1, len(photos) - 1)))) % len(photos) for k in taken]
        drawn = zip(taken, guests, strict=True)
        each = [follow_tool(draw_scene(photos[k], photos[g], kind, asked.frames, asked.seed)) for k, g in drawn]
        runs.append((kind, KINDS[kind], each))
    add_counts_table(runs)
    common.write_sections(asked.output)


def add_counts_table(kinds: list[tuple[str, str, list[dict[str, int]]]]) -> None:
    """Show the counts of each kind's sequences, and of all: name, what happens, and what `follow_tool` found."""
    everything = [run for _, _, runs in kinds for run in runs]
    rows = []
    for kind, happens, runs in [*kinds, ("all", "", everything)]:
        begun, images, right, wrong = (sum(run[key] for run in runs) for key in ("begun", "images", "right", "wrong"))
        rows.append((kind, happens, len(runs), begun, images, f"{100.0 * right / max(1, images):.1f}", wrong))
    common.add_table(("kind", "what happens", "sequences", "begun", "images", "located, %", "wrong"), rows)


if __name__ == "__main__":
    main()

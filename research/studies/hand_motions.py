# SPDX-License-Identifier: Apache-2.0
"""Whether tools in photos are followed under the motions of real hands: a benchmark's truth moves the photo, tool and bench.

The paths are those of 280 films of planar objects (P. Liang et al., "Planar Object Tracking Benchmark in the Wild", 2021): the
four corners of each object in every second image of 30 a second. They are good to about 2 px of 1280; what they move is exact.
Their file is annotation.zip of github.com/liangp/liangp.github.io, data/pot280, to be unpacked.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from grasptrack.errors import InputError
from grasptrack.geometry.homographies import apply_homography
from grasptrack.typing import Floats, Ints
from grasptrack_bench.pot import POINTS, read_corners
from research.studies import common
from research.studies.common import Photo
from research.studies.moved_photos import (
    RATE,
    MovedPhoto,
    add_counts_table,
    axis_of,
    fill_bench,
    follow_tool,
    lay_on,
    soft_mask,
    whole_part,
)

KINDS = ("far and near", "turned", "tilted", "motion blur", "covered", "out of view", "anyhow")
"""What the films of an object were made for, in their order; what covers the objects is not drawn."""
FILM_SCALE = 2.0
"""px of the films' 1280 a pixel of the photos."""
MOST_SHOTS = 9
"""Moments of an exposure that are drawn at most, one a pixel of its way."""
UNIT: Floats = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])


def homography_of(first: Floats, corners: Floats) -> Floats:
    """(3, 3) that carries four corners to others."""
    return np.asarray(cv2.getPerspectiveTransform(first.astype(np.float32), corners.astype(np.float32)), np.float64)


def draw_motion(photo: Photo, at: Ints, path: Floats, share: float, seed: int) -> MovedPhoto:
    """A photo moved as corners (n, 4, 2) px were at images (n,) of a film, the shutter open for a share of 1/30 s."""
    rng = np.random.default_rng(seed)
    mask, (height, width) = whole_part(photo.truth), photo.truth.shape
    middle = apply_homography(homography_of(UNIT, path[0]), np.array([[0.5, 0.5]]))[0]
    to_film = np.diag([FILM_SCALE, FILM_SCALE, 1.0])
    to_film[:2, 2] = middle - FILM_SCALE * axis_of(mask)[0]
    bench, alpha, noise = fill_bench(photo.image, mask).astype(np.uint8), soft_mask(mask), rng.uniform(1.0, 3.0)

    def camera(corners: Floats) -> Floats:
        H = np.linalg.inv(to_film) @ homography_of(path[0], corners) @ to_film
        return np.asarray(H / H[2, 2])

    images = []
    for i, corners in enumerate(path):
        before, after = max(0, i - 1), min(len(path) - 1, i + 1)
        speed = (path[after] - path[before]) / max(1, int(at[after] - at[before]))
        far = share * float(np.abs(speed).max()) / FILM_SCALE
        moments = np.linspace(-0.5 * share, 0.5 * share, int(np.clip(np.ceil(far) + 1.0, 2.0, MOST_SHOTS)))
        shots = []
        for t in moments if far > 0.0 else moments[:1]:
            H = camera(corners + t * speed)
            ground = cv2.warpPerspective(bench, H, (width, height), borderMode=cv2.BORDER_REFLECT_101)
            shots.append(lay_on(ground.astype(np.float64), photo.image, alpha, H))
        shot = np.mean(shots, axis=0)
        images.append(np.clip(np.rint(shot + rng.normal(0.0, noise, shot.shape)), 0, 255).astype(np.uint8))
    ways = [camera(corners) for corners in path]
    first = cv2.warpPerspective(255 * mask, ways[0], (width, height))
    shown = [True] * len(images)
    return MovedPhoto(images, ways, shown, (first > 127).astype(np.uint8), (at / RATE).tolist())


def main() -> None:
    """Run and print."""
    parser = common.create_parser(__doc__)
    parser.add_argument("--paths", type=Path, required=True, help="folder with the files of annotation.zip")
    parser.add_argument("--frames", type=int, default=60, help="images of a sequence at most")
    parser.add_argument("--every", type=int, default=1, help="of the known images, 15 a second, take every so many-th")
    parser.add_argument("--exposure", type=float, default=0.5, help="share of 1/30 s")
    parser.add_argument("--seed", type=int, default=1, help="draws the photo of each film")
    parser.add_argument("--each", type=int, default=1, help="take every so many-th film, ...")
    parser.add_argument("--from", dest="start", type=int, default=0, help="... from this one on")
    asked, photos = common.parse_with_photos(parser)
    films = sorted(asked.paths.glob(f"*{POINTS}"))
    if not films:
        raise InputError(f'"{asked.paths}" holds no V01_1{POINTS}: unpack annotation.zip there')
    taken, rng = films[asked.start :: asked.each], np.random.default_rng(asked.seed)
    counts: dict[str, list[dict[str, int]]] = {kind: [] for kind in KINDS}
    for film in taken:
        corners = read_corners(film)
        known = np.flatnonzero(~np.isnan(corners).any(axis=(1, 2)))[:: asked.every][: asked.frames]
        photo = photos[int(rng.integers(len(photos)))]
        moved = draw_motion(photo, known, corners[known], asked.exposure, asked.seed)
        counts[KINDS[int(film.name.removesuffix(POINTS)[-1]) - 1]].append(follow_tool(moved))
    common.begin_section(f"Motions of real hands, {RATE / 2.0 / asked.every:g} images a second")
    common.add_paragraph(
        f"{len(taken)} of {len(films)} films, each in {asked.frames} images at most, the shutter open for {asked.exposure:g} of"
        " 1/30 s. Which tool: drawn."
    )
    add_counts_table([(kind, "", runs) for kind, runs in counts.items() if runs])
    common.write_sections(asked.output)


if __name__ == "__main__":
    main()

# SPDX-License-Identifier: Apache-2.0
"""The user's own segmentation: one mask for every frame, matched by file name or by order."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import SourceError
from grasptrack.images import part_instances
from grasptrack.io.base import Frame, Source
from grasptrack.io.images import images_in, images_matching, is_image_file, read_image

Mask = NDArray[np.uint8]


class Masks:
    """Masks for the frames of one source.

    Where the stems of the masks' names are those of the frames' files, they are matched by name, and masks without a
    frame are passed over. Else the n-th mask in natural order belongs to the n-th frame, and there must be as many.
    """

    def __init__(self, spec: str, paths: list[Path], source: Source | None = None) -> None:
        self.spec = spec
        self._paths = paths
        self._by_stem: dict[str, Path] | None = None
        if source is None:
            return
        if source.live:
            raise SourceError("masks cannot be matched to a live source: record the images first")
        names = source.names[source.first :]
        stems = [Path(name).stem for name in names]
        known = {p.stem: p for p in paths}
        missing = [name for name, stem in zip(names, stems, strict=True) if stem not in known]
        if stems and len(missing) < len(stems):
            if missing:
                raise SourceError(
                    f'masks "{spec}": none for frame "{missing[0]}" ({len(missing)} missing)', missing=missing
                )
            self._by_stem = known
        elif source.exact and source.count != len(paths):
            raise SourceError(
                f'masks "{spec}": {len(paths)} masks for {source.count} frames; give one for each', masks=len(paths)
            )

    def __len__(self) -> int:
        return len(self._paths)

    def __iter__(self) -> Iterator[Path]:
        return iter(self._paths)

    def mask_for(self, frame: Frame) -> Mask:
        """(H, W) uint8, 255 where the frame's mask has an object, else 0."""
        if self._by_stem is not None:
            path = self._by_stem.get(Path(frame.name).stem)
        else:
            path = self._paths[frame.index] if frame.index < len(self._paths) else None
        if path is None:
            raise SourceError(
                f'masks "{self.spec}": none for frame {frame.index}; there are {len(self._paths)}', frame=frame.index
            )
        found = read_mask(path, parted=True)
        if found.shape != frame.image.shape[:2]:
            raise SourceError(
                f'mask "{path.name}" is {found.shape[1]}x{found.shape[0]} px, but frame {frame.index} is '
                f"{frame.image.shape[1]}x{frame.image.shape[0]}",
                frame=frame.index,
                shape=found.shape,
            )
        return found


def open_masks(spec: str | os.PathLike[str], source: Source | None = None) -> Masks:
    """Masks in a folder, of a glob, or in one file, for the frames of a source."""
    text = os.fspath(spec)
    path = Path(text)
    if path.is_dir():
        return Masks(text, images_in(path), source)
    if path.is_file() and is_image_file(path):
        return Masks(text, [path], source)
    if any(c in text for c in "*?["):
        return Masks(text, images_matching(text), source)
    raise SourceError(f'masks "{text}": no such folder of images', path=text)


def read_mask(path: str | os.PathLike[str], *, parted: bool = False) -> Mask:
    """(H, W) uint8 from a mask file: 255 where it is not black and not transparent, else 0.

    A JPEG's blacks are not quite black: there, the brighter half of the scale counts. `parted` keeps instances that touch,
    each of a value or a colour of its own, apart (`images.part_instances`).
    """
    file = Path(path)
    image = read_image(file)
    blurred = file.suffix.lower() in (".jpg", ".jpeg")
    planes = image[:, :, None] if image.ndim == 2 else image
    shown = np.any(planes[:, :, :3] > (127 if blurred else 0), axis=2)
    if planes.shape[2] == 4:
        shown = shown & (planes[:, :, 3] > 0)
    if not parted or blurred:
        return np.where(shown, np.uint8(255), np.uint8(0))
    labels = planes[:, :, 0].astype(np.float64)
    for k in range(1, min(planes.shape[2], 3)):
        labels = labels * 65536.0 + planes[:, :, k]
    return part_instances(np.where(shown, labels, 0.0))

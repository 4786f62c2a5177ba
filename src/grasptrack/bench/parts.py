# SPDX-License-Identifier: Apache-2.0
"""Parts for scenes: built-in outlines, silhouettes of the user's, photos with masks."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path

from grasptrack.bench.scenes import Part
from grasptrack.bench.simulation import SHAPES, part_of_photo, shape_from_mask
from grasptrack.errors import InputError
from grasptrack.io.images import images_in, images_matching, read_image
from grasptrack.io.masks import open_masks, read_mask
from grasptrack.segmentation.images import to_bgr


def built_in(names: Sequence[str] = ()) -> list[Part]:
    """Parts by the names of their outlines; all of them where none is named.

    Raises:
        InputError: a name that is none.
    """
    for name in names:
        if name not in SHAPES:
            raise InputError(f'unknown shape "{name}"; choose from {", ".join(SHAPES)}', name=name)
    return [Part(SHAPES[name]()) for name in names or SHAPES]


def parts_from_silhouettes(spec: str | os.PathLike[str]) -> list[Part]:
    """A part for each image of a folder or pattern: what is not black is material.

    Raises:
        SourceError: nothing there, or an image that cannot be read.
        InputError: an image without a silhouette.
    """
    parts = []
    for path in open_masks(spec):
        try:
            parts.append(Part(shape_from_mask(read_mask(path) > 0, path.stem)))
        except ValueError as error:
            raise InputError(f'"{path}" is no silhouette: {error}', path=str(path)) from error
    return _check_distinct_names(parts, spec)


def parts_from_photos(spec: str | os.PathLike[str], masks: str | os.PathLike[str]) -> list[Part]:
    """A part for each photo of a folder or pattern, with the texture that it has there.

    Args:
        spec: of the photos.
        masks: of their masks, which have the photos' names, whatever their suffix.

    Raises:
        SourceError: nothing there, or an image that cannot be read.
        InputError: a photo without mask, or a mask of another size or without an object.
    """
    of = {path.stem: path for path in open_masks(masks)}
    parts = []
    for path in _image_paths(spec):
        if path.stem not in of:
            raise InputError(
                f'masks "{masks}": none for photo "{path.name}"; give one of the same name', path=str(path)
            )
        image, mask = to_bgr(read_image(path)), read_mask(of[path.stem]) > 0
        if mask.shape != image.shape[:2]:
            raise InputError(f'mask "{of[path.stem].name}" has another size than its photo', path=str(path))
        try:
            parts.append(Part(*part_of_photo(image, mask, path.stem)))
        except ValueError as error:
            raise InputError(f'the mask of "{path.name}" shows no object: {error}', path=str(path)) from error
    return _check_distinct_names(parts, spec)


def _image_paths(spec: str | os.PathLike[str]) -> list[Path]:
    return images_in(Path(spec)) if Path(spec).is_dir() else images_matching(os.fspath(spec))


def _check_distinct_names(parts: list[Part], spec: object) -> list[Part]:
    names = [part.shape.name for part in parts]
    again = next((name for name in names if names.count(name) > 1), None)
    if again is not None:
        raise InputError(f'"{spec}" has more than one part named "{again}"; parts need names of their own', name=again)
    return parts

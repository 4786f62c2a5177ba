# SPDX-License-Identifier: Apache-2.0
"""The flat objects in an image seen for the first time: many proposals, one choice, and what a person says of it.

Thresholds propose regions of one grey level, closed edges those of several, a segmenter what it knows. One worth
orders all (`grasptrack.segmentation.choice`), and the likeliest become sub-pixel contours.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

from numpy.typing import ArrayLike, NDArray

from grasptrack import arguments
from grasptrack.errors import ObservationError
from grasptrack.first_image import DEFAULT_SURE, FIRST_IMAGE_CHECKS, FirstImage
from grasptrack.images import as_scene, to_bgr, to_mask
from grasptrack.segmentation.candidate import Candidate, numbered_candidate, remove_nested
from grasptrack.segmentation.candidate_search import CandidateSearch
from grasptrack.segmentation.proposals import MIN_EXTENT, OutlineProposal
from grasptrack.segmentation.segmenters import OneMask, Segmenter, segmenter_for
from grasptrack.segmentation.several_frames import ask_more_frames
from grasptrack.typing import Pixels

TINY_EXTENT = 5
"""px across; less is noise, and not said to be too small."""


@arguments.checked(
    image=arguments.array(unbounded=True),
    **FIRST_IMAGE_CHECKS,
    mask=arguments.optional(arguments.array(unbounded=True)),
    more=arguments.several,
    sure=arguments.number,
    first_look_ms=arguments.optional(arguments.number),
)
def first_look(
    image: NDArray[Any],
    object_at: ArrayLike | None = None,
    *,
    not_at: ArrayLike | None = None,
    box: Sequence[float] | None = None,
    outline: ArrayLike | None = None,
    ignore: NDArray[Any] | None = None,
    mask: NDArray[Any] | None = None,
    segmenter: Any = None,
    background: NDArray[Any] | None = None,
    more: Iterable[NDArray[Any]] = (),
    sure: float = DEFAULT_SURE,
    first_look_ms: float | None = None,
) -> list[Candidate]:
    """What in an image may be the object that is meant, the likeliest first; nested ones stay, each region is there once.

    Args:
        image: 8 or 16 bit, grey, BGR or BGRA.
        object_at: (x, y) px of the object that is meant, or several such, all on it.
        not_at: (x, y) px, or several such, none on it.
        box: left, top, width and height of it, px.
        outline: (n, 2) px of a rough polygon round it. It is moved onto the edges beside it, and kept where there are none.
        ignore: (H, W) nonzero where nothing belongs to the scene.
        mask: (H, W) nonzero on objects: your own segmentation, which takes the image's place.
        segmenter: as `segmenter_for` takes it: "classical" (default), "onnx:FILE", a name, an object or a function.
        background: an image of the same bench without the object, from the same place up to a few px; the light may differ.
        more: images that follow, from a camera that moves: while nothing is sure and no person has said which object is meant,
            up to four are asked. What lies on the bench gains, reflections lose.
        sure: probability, 0 or more and below 1, from which a candidate is called sure: larger asks more often and errs
            less; 0 takes the first without a question.
        first_look_ms: work that the own search may do, ms on the machine of the benchmarks; None is no bound but that of the
            search itself. No clock is read: the same image gives the same answer. A segmenter's net is not counted.

    Returns:
        Candidates with `view`, `probability` and `sure`.

    Raises:
        ObservationError: no object, or none there.
        InputError: hints, a mask or a background that do not fit the image, a segmenter that cannot be had.
    """
    said = FirstImage.of(
        object_at,
        not_at=not_at,
        box=box,
        outline=outline,
        ignore=ignore,
        background=background,
        more=more,
        sure=sure,
        first_look_ms=first_look_ms,
    )
    return look_for(image, said, segmenter_for(segmenter), mask)


def look_for(
    image: NDArray[Any], said: FirstImage, segmenter: Segmenter | None = None, mask: NDArray[Any] | None = None
) -> list[Candidate]:
    """As `first_look`, with what a person says in one record, which need not fit the image.

    Args and errors as of `first_look`.
    """
    scene = to_bgr(image)
    said = said.within(scene.shape)
    if mask is not None:
        scene, said = as_scene(to_mask(mask, scene.shape[:2], "mask")), replace(said, masked=True)
    return [c._replace(sure=c.probability >= said.sure) for c in find_candidates(scene, said, segmenter)]


def find_objects(
    image: NDArray[Any],
    said: FirstImage | None = None,
    *,
    mask: NDArray[Any] | None = None,
    segmenter: Segmenter | None = None,
) -> list[Candidate]:
    """All flat objects in an image, none within another: the one that is meant first, then the likeliest.

    Args:
        image: as of `first_look`.
        said: which object is meant.
        mask: as of `first_look`.
        segmenter: proposes regions beside the own search.

    Raises:
        ObservationError, InputError: as `first_look`; or there are fewer candidates than the number that was taken.
    """
    said = FirstImage() if said is None else said
    meant = others = look_for(image, said, segmenter, mask)
    if said.is_pointed_at:
        try:
            others = look_for(image, said.of_no_object(), segmenter, mask)
        except ObservationError:
            others = []
    return remove_nested([numbered_candidate(meant, said.number), *others])


def find_candidates(
    colours: Pixels, said: FirstImage | None = None, segmenter: Segmenter | None = None
) -> list[Candidate]:
    """As `first_look`, of an image (H, W) or BGR (H, W, 3) of 8 bits, and of what is said that fits it."""
    said = FirstImage() if said is None else said
    look = CandidateSearch(colours, said, segmenter)
    found = look.best_candidates()
    if not found:
        raise _no_object_error(look.meant, said)
    if said.is_pointed_at or said.masked or isinstance(segmenter, OneMask):
        return found
    later = replace(said, not_at=(), background=None, more=())  # they are of the first image
    return ask_more_frames(found, colours, said.more, lambda seen: find_candidates(seen, later, segmenter), said.sure)


def _no_object_error(meant: list[OutlineProposal], said: FirstImage) -> ObservationError:
    """Why there is no object."""
    where = said.place_in_words()
    extent = max((p.silhouette.longer_side for p in meant if p.silhouette.longer_side < MIN_EXTENT), default=0)
    if extent >= TINY_EXTENT:
        text = f"the object{where} is {extent} px across; at least {MIN_EXTENT} px are needed"
        return ObservationError(text, extent=extent)
    return ObservationError(f"no object stands out{where or ' in the image'}", object_at=said.object_at, box=said.box)

# SPDX-License-Identifier: Apache-2.0
"""Where regions come from beside this package's own search: one protocol for nets, a user's function, other packages.

`segmenter_for` turns what a user names into a segmenter: "classical" (nothing beside the own search), a name that is
registered as an entry point `grasptrack.segmenters`, or "NAME:FILES" of one that is made from files, as our nets are
(`grasptrack.nets`); an object that follows the protocol, or one with `segment(image)`, or a function of an image, that
returns one mask.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple, Protocol, cast, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from grasptrack.errors import InputError
from grasptrack.first_image import FirstImage
from grasptrack.images import to_mask
from grasptrack.plugins import load_plugin, plugin_names
from grasptrack.typing import Floats32, Pixels

CLASSICAL = "classical"
FULL = 255.0
"""What a mask has where it is set."""


class Region(NamedTuple):
    """One region that may be the object.

    Attributes:
        mask: (H, W) nonzero on it, or how likely each pixel belongs to it, 0 to 1 in floats.
        probability: that it is the object, as far as the segmenter knows.
        is_vote: it is one of several maps of the same thing, which are averaged; otherwise regions are alternatives, of which
            one may be right.
    """

    mask: NDArray[Any]
    probability: float = 1.0
    is_vote: bool = False

    def as_map(self, size: tuple[int, ...]) -> Floats32:
        """(H, W) 0 to 1, how likely each pixel belongs to it."""
        mask = np.asarray(self.mask)
        if not np.issubdtype(mask.dtype, np.floating):
            return np.asarray(to_mask(mask, tuple(size), "segmenter's mask") / FULL, dtype=np.float32)
        if mask.shape != tuple(size):
            raise InputError(
                f"a segmenter's mask is {mask.shape}, but the image is {size[1]}x{size[0]} px", shape=mask.shape
            )
        return np.asarray(np.clip(np.nan_to_num(mask), 0.0, 1.0), dtype=np.float32)


@runtime_checkable
class Segmenter(Protocol):
    """Proposes regions of an image. They pass through the same sub-pixel localisation as all others."""

    def regions(self, image: Pixels, hints: FirstImage) -> Sequence[Region]:
        """Regions that may be the object, the likeliest first."""


@runtime_checkable
class MaskSegmenter(Protocol):
    """Your own segmentation, a network or a model of the object, in the place of this one."""

    def segment(self, image: NDArray[Any]) -> NDArray[Any]:
        """(H, W) nonzero on objects, of an image (H, W) or (H, W, 3)."""


@runtime_checkable
class SegmenterMaker(Protocol):
    """A registered name under which a segmenter is made when it is asked for.

    `usage` says what has to stand behind the name and a colon, for messages; it is empty where nothing may.
    """

    usage: str

    def make(self, argument: str) -> Segmenter:
        """The segmenter; of what stands behind the colon."""


class OneMask:
    """A user's function of an image, or an object's `segment`, as a segmenter of one region."""

    def __init__(self, segment: Callable[[NDArray[Any]], NDArray[Any]]) -> None:
        self._segment = segment

    def segment(self, image: NDArray[Any]) -> NDArray[Any]:
        """(H, W) nonzero on objects."""
        return np.asarray(self._segment(image))

    def regions(self, image: Pixels, hints: FirstImage) -> Sequence[Region]:
        """See Segmenter."""
        return [Region(self.segment(image))]


def asked_regions(segmenter: Segmenter, image: Pixels, hints: FirstImage) -> list[Region]:
    """What a segmenter proposes."""
    given: Any = segmenter.regions(image, hints)
    found = list(given) if isinstance(given, Iterable) else [given]
    if not all(isinstance(each, Region) for each in found):
        raise InputError("a segmenter's regions(image, hints) must return a sequence of Region, [] where there is none")
    return found


def region_maps(regions: Sequence[Region], size: tuple[int, ...]) -> tuple[list[Floats32], list[Floats32]]:
    """Maps (H, W), 0 to 1, in which regions are looked for, and those that a region may agree with: the mean of all votes, and
    each alternative times its probability.
    """
    shown: list[Floats32] = []
    votes: list[Floats32] = []
    alternatives: list[Floats32] = []
    for region in regions:
        shown.append(region.as_map(size))
        weighted = shown[-1] * np.float32(np.clip(region.probability, 0.0, 1.0))
        (votes if region.is_vote else alternatives).append(weighted)
    if votes:
        mean = np.mean(votes, axis=0).astype(np.float32)
        alternatives.append(mean)
        if len(votes) > 1:
            shown.append(mean)
    return shown, alternatives


def segmenter_for(what: Any) -> Segmenter | None:
    """The segmenter that a user means; None where the own search is all."""
    if what is None or (isinstance(what, str) and what == CLASSICAL):
        return None
    if isinstance(what, str):
        what = _named_segmenter(what)
    if isinstance(what, type):
        what = what()
    if isinstance(what, Segmenter):
        return what
    if isinstance(what, MaskSegmenter):
        return OneMask(what.segment)
    if callable(what):
        return OneMask(cast(Callable[[NDArray[Any]], NDArray[Any]], what))
    raise InputError(f"a segmenter has regions(image, hints) or segment(image), or is a function; not {what!r}")


def _named_segmenter(text: str) -> Any:
    """What is registered under a name, made of what stands behind the colon."""
    name, colon, argument = text.partition(":")
    found = load_plugin("grasptrack.segmenters", name)
    if isinstance(found, SegmenterMaker) and bool(found.usage) is bool(colon):
        return found.make(argument)
    if found is None or colon or isinstance(found, SegmenterMaker):
        choices = ", ".join([CLASSICAL, *_segmenter_names()])
        raise InputError(f'unknown segmenter "{text}"; choose from {choices}', name=text)
    return found


def _segmenter_names() -> Iterator[str]:
    for name in plugin_names("grasptrack.segmenters"):
        try:
            usage = getattr(load_plugin("grasptrack.segmenters", name), "usage", "")
        except InputError:
            usage = ""
        yield f"{name}:{usage}" if usage else name

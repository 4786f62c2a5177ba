# SPDX-License-Identifier: Apache-2.0
"""What verbs say of a choice of the object that is not sure: one line, and a picture of the candidates, numbered."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from grasptrack.segmentation.candidate import Candidate

PICTURE = "candidates.png"


def note_candidates(
    candidates: Sequence[Candidate], image: NDArray[Any] | None, output: Path, sure: float, *, meant: bool
) -> list[str]:
    """The line for a choice that is not sure, having written the picture; nothing where it is, or where a person has chosen.

    Args:
        candidates: those that a person would tell apart, the likeliest first.
        image: in which they lie; None where there was none.
        output: folder of the picture; one of an earlier run is removed.
        sure: probability from which a choice is sure.
        meant: a person has chosen.
    """
    picture = output / PICTURE
    picture.unlink(missing_ok=True)
    if meant or image is None or not candidates or candidates[0].probability >= sure:
        return []
    from grasptrack.segmentation.candidate import describe_candidate
    from grasptrack.view.draw import write_candidates

    write_candidates(picture, image, candidates)
    told = f"the object was chosen with a probability of {100.0 * candidates[0].probability:.0f} %, which is not sure"
    others = "; ".join(f"{n} lies {describe_candidate(c, candidates[0])}" for n, c in enumerate(candidates[1:], 2))
    also = f" ({others})" if others else ""
    return [
        f"{told}: {picture} shows what else it may be{also}; --choose N takes another, --object or --outline say it"
    ]

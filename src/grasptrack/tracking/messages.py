# SPDX-License-Identifier: Apache-2.0
"""Codes and figures as sentences: nothing else is decided by them, and nothing is decided by a sentence."""

from collections.abc import Mapping
from dataclasses import dataclass, field

SENTENCES = {
    # searching
    "no-object": "",
    "object-gone": "the object that needs a new grasp is not where it was",
    "no-grasp": "no stable grasp",
    "waiting": "no object lies whole in view yet, and its choice sure",
    "no-description": "no grasp that the strategy can carry",
    # lost: the codes of `decision`
    "not-found": "the object was not found in this image",
    "not-there": "its place may show something else, or nothing",
    "other-place": "the object fits elsewhere as well",
    "uncertain": "what is seen does not fix every contact",
    "other-shape": "another shape: the outline differs from the object's",
    "other-surface": "another surface: the object does not show what it showed before",
    "apart": "a contact's edge or surface lies elsewhere, or ground shows there or between: it may have left the object",
    "outline-open": "no view since the first one shows the edge under a contact: it may lie beside the object",
    "image-fixed": "what is seen stands still in the image while something else moves on: it may be no part of the object",
    "ambiguous": "the outline fits itself in more than one way, and nothing tells them apart: ambiguous",
    "lookalike": "something just like the object was seen, and which of them this is cannot be told: ambiguous",
    # lost: of a strategy by itself
    "no-transfer": "the strategy did not find its outline in this image",
    "strategy-off": "the strategy puts a contact elsewhere than the outline and the surface do",
    "off-outline": "",
    # of parts that are looked for in one image
    "turned-over": "the part lies turned over: its other side is seen",
    "which-part": "two parts, or both sides of one, explain this outline, and which of them it is cannot be told",
    # tracked
    "contact-unseen": "a contact has moved unseen for a while: that it moved with the rest is a guess",
    "not-flat": "the object is not flat: a contact on a lower edge is off",
    "not-pinhole": "the views fit no camera with square pixels",
    "tilt-open": "no view has told yet how the object's plane is tilted",
    # unstable
    "not-closing": "",
    "open-margin": "what is not known of the plane's tilt and of the outline leaves open whether the grasp closes",
    "slips": "the contacts may be too far off for the grasp to close",
}
"""What is said with each code; nothing where a step's own words say it all."""

FIGURES = {
    "edges": "{:.0%} of the outline shows its edge",
    "sigma": "standard deviation {:.1f} px",
    "distance": "{:.1f} px off",
    "tolerance": "{:.1f} px would be wrong",
    "choice": "the likeliest is it with {:.0%}",
    "aspect": "they fit pixels {:.2f} times as wide as high",
    "thickness": "it is {:.0%} as thick as large",
    "chance": "the chance that it closes is {:.0%}",
}
"""How the figures are told that help a reader; others are left out."""


@dataclass(frozen=True)
class StatusReason:
    """Why there is no grasp, why it is not located, or why it is not stable.

    Attributes:
        code: one of `SENTENCES`; empty when there is nothing to say.
        figures: numbers that go with it, by name.
        detail: the words of the step that refused, such as a strategy's.
    """

    code: str = ""
    figures: Mapping[str, float] = field(default_factory=dict)
    detail: str = ""

    @property
    def sentence(self) -> str:
        """For people."""
        told = [self.detail] if self.detail else []
        told += [FIGURES[name].format(value) for name, value in self.figures.items() if name in FIGURES]
        start = SENTENCES[self.code] if self.code else ""
        return ": ".join(part for part in (start, ", ".join(told)) if part)

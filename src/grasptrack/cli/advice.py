# SPDX-License-Identifier: Apache-2.0
"""What to try where a run lost its object: by the reasons that it gave."""

from __future__ import annotations

from collections.abc import Mapping

REMEDIES = {
    "no-object": "say which object is meant (--object x,y, --box or --outline), or let a net look: --segmenter u2netp",
    "object-gone": "keep the object in view while another grasp is chosen, or leave out --resynthesize",
    "no-grasp": "give contacts of your own (--grasp), a larger --friction if it is true, or a hand that opens wider",
    "no-description": "use --strategy auto, which carries every grasp",
    "not-found": "bring the object back into view, or move less from one image to the next; it is looked for in every image",
    "not-there": "take away what stands before it; the gripper's own fingers belong into --ignore FILE",
    "other-place": "wait until what fits as well is out of view, or choose another object in the first image",
    "uncertain": "come nearer, or choose contacts where the outline bends (--grasp): on a straight edge they can slide",
    "other-shape": "look at the first outline in overlay.mp4: where it is wrong, give --outline, --object or a mask",
    "apart": "a part that opens or comes apart needs a grasp on one piece of it; take away what covers its edge",
    "outline-open": "look at the first outline in overlay.mp4: say which is meant (--outline, a mask), or give --grasp",
    "other-surface": "avoid glare and hard shadows; where the object was exchanged, start anew",
    "ambiguous": "put a mark on the object that tells its turn, or keep the ground's texture in view",
    "lookalike": "keep equal parts apart, and start while only one of them is in view, or all are at rest",
    "no-transfer": "use --strategy auto, which needs neither peaks of curvature nor the whole outline",
    "strategy-off": "use --strategy auto: this strategy of the paper is not exact for this motion",
    "off-outline": "use --strategy auto: this strategy of the paper is not exact for this motion",
    "false-edge": "start with another first image, or give the outline there: --outline, or a mask",
    "contact-unseen": "take away what stands before the contacts, or choose contacts that stay in view (--grasp)",
    "not-pinhole": "say how wide a pixel is for its height (--pixel-aspect), or give a calibration (--camera)",
    "tilt-open": "let the camera tilt by ten degrees once, so that views differ",
    "not-closing": "choose contacts that face each other (--grasp), or let another grasp be chosen: --resynthesize",
    "open-margin": "let the camera look at the object from another side, or choose a grasp with more margin",
    "slips": "come nearer: contacts become surer",
}
"""By the codes of `tracking.messages:SENTENCES`."""
MANY = 0.2
"""Share of frames after which advice is given."""
MOST = 2
"""Pieces of advice that are given at once."""


def advice_for(codes: Mapping[str, int], frames: int) -> list[str]:
    """What to try, the most frequent reason first; none where few frames were lost.

    Args:
        codes: frames by the code of their reason.
        frames: all of them.
    """
    counted = sorted((n, code) for code, n in codes.items() if code in REMEDIES)
    if not frames or sum(n for n, _ in counted) <= MANY * frames:
        return []
    told = [f"{n} of {frames} frames ({code}): {REMEDIES[code]}" for n, code in reversed(counted) if n > 0.05 * frames]
    return told[:MOST]

# SPDX-License-Identifier: Apache-2.0
"""What a user would otherwise pick, behind the one interface of `grasptrack_bench.method`."""

from __future__ import annotations

from grasptrack_bench.baselines.direct import Ecc, ViSP, why_not
from grasptrack_bench.baselines.features import Klt, Sift
from grasptrack_bench.baselines.paper import Otsu, PaperGraspLine, PaperHomography, PaperRRP
from grasptrack_bench.method import Maker

__all__ = ["PEERS", "available_baselines", "missing_baselines"]

PEERS: dict[str, Maker] = {
    peer.name: peer for peer in (Ecc, Klt, Sift, Otsu, ViSP, PaperRRP, PaperGraspLine, PaperHomography)
}
"""All peers by name, those too that need what is not installed: they say so in every frame."""


def missing_baselines() -> dict[str, str]:
    """Why some peers cannot be used here, by name."""
    reason = why_not()
    return {ViSP.name: reason} if reason else {}


def available_baselines() -> dict[str, Maker]:
    """The peers that can be used here, by name."""
    lacking = missing_baselines()
    return {name: maker for name, maker in PEERS.items() if name not in lacking}

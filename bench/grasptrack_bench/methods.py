# SPDX-License-Identifier: Apache-2.0
"""Every method that can be measured, by name: this tracker's strategies, its peers, and what other packages register.

A package adds a method of its own by the entry point `grasptrack.methods`: a `Maker`, called with a `TrackingStart`.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, get_args

from numpy.typing import NDArray

from grasptrack.errors import GraspError, InputError, StrategyError
from grasptrack.plugins import load_plugin, plugin_names
from grasptrack.tracking.numbers import DEFAULT_RISK
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.tracker import GraspTracker
from grasptrack.typing import StrategyName
from grasptrack_bench import baselines
from grasptrack_bench.method import Maker, Method, MethodStart

OURS = ("auto", "rrp", "grasp-line", "homography")
"""Strategies of the tracker that are measured where none is named, in the order of tables."""


class TrackerMethod:
    """The tracker itself, told of the contacts as `--grasp` would tell it, of a pixel of the object as `--object`, of its
    outline as `--outline`.
    """

    def __init__(self, start: MethodStart, strategy: str, risk: float = DEFAULT_RISK) -> None:
        self._refused = ""
        self._frame = -1
        self._tracker: GraspTracker | None = None
        outline = start.outline[0] if start.by_hand else None
        try:
            self._tracker = GraspTracker(
                strategy=strategy, grasp=start.contacts, object_at=start.object_at, outline=outline, risk=risk
            )
        except StrategyError as error:
            self._refused = str(error)

    def update(self, image: NDArray[Any], time: float | None) -> TrackResult:
        """The tracker's answer; contacts that it refuses from the first leave it searching for good."""
        self._frame += 1
        if self._tracker is not None and not self._refused:
            try:
                return self._tracker.update(image, time=time)
            except GraspError as error:
                self._refused = str(error)
        return TrackResult(self._frame, time, "searching", self._refused)


def method_makers(names: Sequence[str], risk: float = DEFAULT_RISK) -> dict[str, Maker]:
    """Makers of methods, in the order of their names.

    Args:
        names: of the methods.
        risk: probability below which answers of the tracker may be wrong. Its peers know none.
    """
    found: dict[str, Maker] = {}
    for name in names:
        if name in get_args(StrategyName):
            found[name] = _tracker_maker(name, risk)
        elif name in baselines.PEERS:
            missing = baselines.missing_baselines()
            if name in missing:
                raise InputError(f'method "{name}" cannot be used here: {missing[name]}', method=name)
            found[name] = baselines.PEERS[name]
        elif name in plugin_names("grasptrack.strategies"):
            found[name] = _tracker_maker(name, risk)
        elif (maker := load_plugin("grasptrack.methods", name)) is not None:
            found[name] = maker
        else:
            others = plugin_names("grasptrack.strategies") + plugin_names("grasptrack.methods")
            choices = ", ".join((*get_args(StrategyName), *baselines.PEERS, *others))
            raise InputError(f'unknown method "{name}"; choose from {choices}', method=name)
    return found


def _tracker_maker(strategy: str, risk: float) -> Maker:
    def make_tracker(start: MethodStart) -> Method:
        return TrackerMethod(start, strategy, risk)

    return make_tracker

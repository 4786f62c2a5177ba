# SPDX-License-Identifier: Apache-2.0
"""The simulated hand as a source and an arm of `grasptrack live`: a world whose time goes on with the clock on the wall."""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping

import numpy as np

from grasptrack.errors import InputError, SourceError
from grasptrack.io.arms import SILENCE, Order, Report
from grasptrack.io.base import Image, Source
from grasptrack.io.live import LiveSource, parse_address, take_number, take_patience
from grasptrack.servo.goal import Goal
from grasptrack.typing import Floats
from grasptrack_bench.approach.trial import ABOVE, grasp_axis_angle
from grasptrack_bench.physics.gripper import make_gripper
from grasptrack_bench.physics.world import PERIOD_S, World
from grasptrack_bench.simulation import SHAPES

SHAPE, SEED = "spanner", 2.0


class LetGoError(Exception):
    """Closing is broken off: nobody lets the hand move any more."""


class SimulatedHand:
    """A world that is played in the thread of its camera, and the arm that moves it.

    Args:
        shape: name of the part.
        seed: of the world.

    Attributes:
        goal: the open fingertips, where its images show them.
        missed: images that it dropped: none.
    """

    def __init__(self, shape: str, seed: int) -> None:
        if shape not in SHAPES:
            raise SourceError(f'"sim:{shape}": there is no part of this name; there are {", ".join(sorted(SHAPES))}')
        self._shape, self._seed = SHAPES[shape](), seed
        self._lock = threading.Lock()
        self.restart()

    def restart(self) -> None:
        """Another world, the same as at the start."""
        axis = grasp_axis_angle(self._shape, make_gripper(2))
        world = World(self._shape, seed=self._seed, images="planar", axis=axis)
        tips, opening = world.fingertips()
        apart = float(np.linalg.norm(np.diff(world.hand.tips(opening)[:2], axis=0)))
        with self._lock:
            self._world, self.missed = world, 0
            self.goal: Goal | None = Goal.fingertips(tips, apart, beyond_m=-ABOVE)
            self._due = self._at = self._ordered = time.perf_counter()
            self._pose, self._order = world.pose(), Order(np.zeros(6))
            self._reports: list[Report] = []
            self._closes = self._opens = False

    # --- as a camera, in its thread ----------------------------------------------------------------

    def read(self) -> tuple[Image, float | None] | None:
        """The next image, (480, 640), after a period of control."""
        self._wait_period()
        with self._lock:
            closes, opens = self._closes, self._opens
            self._closes = self._opens = False
        if closes:
            self._close_hand()
        elif opens:
            self._world.open()
        self._world.move(self._twist())
        image = self._world.image()
        if self._world.touches() and not closes:
            self._tell(Report(touched=True))
        self._note_pose()
        return image, None  # where the machine is too slow, the world's time is not that of the wall

    def close(self) -> None:
        """Nothing is held open."""

    def _wait_period(self) -> None:
        self._due = max(self._due + PERIOD_S, time.perf_counter())
        time.sleep(self._due - time.perf_counter() if self._due > time.perf_counter() else 0.0)

    def _twist(self) -> Floats:
        """What it was told last (6,), and nothing where that is too long ago, as of any arm."""
        with self._lock:
            fresh = time.perf_counter() - self._ordered < SILENCE
            return self._order.twist if fresh and self._order.enabled else np.zeros(6)

    def _close_hand(self) -> None:
        """Feel for the table and close, as fast as the wall's clock goes; broken off where nobody lets it move."""

        def go_on() -> None:
            self._note_pose()
            with self._lock:
                enabled = self._order.enabled and time.perf_counter() - self._ordered < SILENCE
            if not enabled:
                raise LetGoError
            self._wait_period()

        self._world.watch = go_on
        try:
            self._tell(Report(held=self._world.close(None)))
        except LetGoError:
            self._tell(Report(held=False))
        finally:
            self._world.watch = None

    def _note_pose(self) -> None:
        with self._lock:
            self._pose, self._at = self._world.pose(), time.perf_counter()

    def _tell(self, report: Report) -> None:
        with self._lock:
            self._reports.append(report)

    # --- as an arm -----------------------------------------------------------------------------------

    def why_not(self) -> str:
        """Why it cannot be moved."""
        late = time.perf_counter() - self._at
        return f"the simulation has stood for {late:.1f} s" if late > 1.0 else ""

    def hand_pose(self) -> tuple[Floats | None, float]:
        """(4, 4) of the hand, and when."""
        with self._lock:
            return self._pose, self._at

    def send_order(self, order: Order) -> None:
        """For the periods that follow."""
        with self._lock:
            self._order, self._ordered = order, time.perf_counter()
            self._closes, self._opens = self._closes or order.close, self._opens or order.open

    def take_reports(self) -> list[Report]:
        """What it told since the last call."""
        with self._lock:
            told, self._reports = self._reports, []
            return told


class SimulatedSource(LiveSource):
    """The images of a hand's camera: sim:SHAPE?seed=N; each playing is another hand at the same start.

    Attributes:
        hand: of the present playing.
    """

    def __init__(self, spec: str, fps: float | None, settings: Mapping[str, str] | None) -> None:
        shape, told = parse_address(spec, settings)
        seed, patience = int(take_number(told, "seed", SEED)), take_patience(told)
        if told:
            raise SourceError(f'"{spec}" has no setting {", ".join(told)}; it has seed and wait', spec=spec)
        self.hand, self._is_new = SimulatedHand(shape or SHAPE, seed), True
        super().__init__(spec, "camera", "the simulated camera", self._open_hand, fps, patience)

    def _open_hand(self) -> SimulatedHand:
        if not self._is_new:
            self.hand.restart()
        self._is_new = False
        return self.hand


def open_simulation(spec: str, fps: float | None, settings: Mapping[str, str] | None) -> Source:
    """The entry point of the source."""
    return SimulatedSource(spec, fps, settings)


def simulated_arm(url: str, source: Source) -> SimulatedHand:
    """The entry point of the arm: the hand whose camera the source is."""
    if not isinstance(source, SimulatedSource):
        raise InputError(f'"{url}" moves the simulated hand: give its images as SOURCE, as sim:{SHAPE}', url=url)
    return source.hand

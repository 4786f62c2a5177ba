# SPDX-License-Identifier: Apache-2.0
"""A session that follows every instance of parts on file, while people look on and choose one of them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from grasptrack.errors import GraspTrackError, InputError
from grasptrack.io.base import Source
from grasptrack.live import commands as told
from grasptrack.live.inbox import Arrival, Ended
from grasptrack.live.loop import SessionLoop
from grasptrack.live.settings import SceneSettings
from grasptrack.live.state import Shown
from grasptrack.segmentation.candidate import contains_pixel
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.scene import SceneResult, SceneTracker

NOTHING: dict[str, Any] = dict.fromkeys(("result", "last", "chosen", "scene"))
"""What is shown of parts, where none is followed."""


class SceneSession(SessionLoop):
    """Follows every instance of parts on file. What is told of the one that is chosen stands as of a single object.

    The first image is looked at until it is known what lies there, which takes seconds; so does each further look.

    Args:
        source: nobody else reads it.
        settings: of the tracker.
        output: the run's folder; an earlier run's files in it are replaced.
        options: what the user asked for, for run.json.
        pace: play files at their own rate; without, as fast as they are tracked.
    """

    has_parts = True

    def __init__(
        self,
        source: Source,
        settings: SceneSettings,
        output: Path,
        *,
        options: Mapping[str, Any] | None = None,
        pace: bool = True,
    ) -> None:
        self._settings = settings
        self._tracker: SceneTracker | None = None
        shown = Shown(live=source.live, count=source.count)
        super().__init__(source, output, settings.make_tracker().fingers, shown, options or {}, ".mp4", pace)

    # --- images ----------------------------------------------------------------------------------

    def _look_at(self, image: int, arrival: Arrival) -> None:
        begins = self._tracker is None
        if self._tracker is None:
            self._tracker = self._settings.make_tracker()
            self._set_shown(phase="looking", image=image, arrival=arrival, **NOTHING)
        try:
            scene = self._tracker.update(arrival.frame.image, time=arrival.frame.time)
        except GraspTrackError as error:
            self._tracker = None
            self._set_shown(phase="failed", image=image, arrival=arrival, notice=self._note(str(error)), **NOTHING)
            return
        if begins and not scene.results:
            self._tracker = None
            note = self._note(f"none of {', '.join(self._settings.names)} is found in this image")
            self._set_shown(phase="choosing", notice=note)
            return
        # what is easiest to grasp is found first
        self._show_scene(image, arrival, scene, min(scene.results) if begins else self._shown.chosen)

    def _show_scene(self, image: int, arrival: Arrival, scene: SceneResult, chosen: int | None) -> None:
        result = scene.results.get(chosen or 0)
        if result is None:
            chosen = None
        else:
            self.curves.add(result)
        self._set_shown(
            phase="ended" if self._over else "tracking",
            image=image,
            arrival=arrival,
            scene=scene,
            chosen=chosen,
            result=result,
            last=self._find_last(result),
        )
        if image > self._recorded:
            self._recorded = image
            self._run.write_frame(arrival.frame, scene)
            self._recordings.add(arrival.frame, scene, str)

    def _find_last(self, result: TrackResult | None) -> TrackResult | None:
        """What was told of an instance when it was located last."""
        last = self._shown.last
        if result is None or result.located:
            return result
        return last if last is not None and last.instance_id == result.instance_id else None

    def _on_end(self, end: Ended) -> None:
        self._over = True
        if end.error:
            self._tracker = None
            self._set_shown(phase="failed", notice=self._note(end.error))
        elif self._shown.phase in ("tracking", "opening"):
            said = end.note or ("" if self._images else "the source has no image")
            self._set_shown(phase="ended", notice=self._note(said) if said else self._shown.notice)

    # --- words -----------------------------------------------------------------------------------

    def _obey_command(self, command: told.Command) -> None:
        match command:
            case told.Choose(number):
                self._choose(number)
            case told.Pick(x=x, y=y):
                views = {number: r.view for number, r in self._results().items() if r.view is not None}
                here = [number for number, view in views.items() if contains_pixel(view, x, y)]
                if not here:
                    raise InputError("no part lies there: click one that has a number, or look again")
                self._choose(min(here, key=lambda number: views[number].outer.area))
            case told.Rechoose():
                self._look_again()
            case told.Restart():
                self._tracker = None
                self._start_player()
                self._set_shown(phase="opening", paused=False, **NOTHING)
            case _:
                super()._obey_command(command)

    def _results(self) -> Mapping[int, TrackResult]:
        return {} if self._shown.scene is None else self._shown.scene.results

    def _choose(self, number: int) -> None:
        result = self._results().get(number)
        if result is None:
            raise InputError(f"there is no part {number}")
        self._set_shown(chosen=number, result=result, last=self._find_last(result))

    def _look_again(self) -> None:
        """Look for parts that are not followed; where none is, in the next image, or in this one of a file that has ended."""
        if self._tracker is not None:
            new = len(self._tracker.look())
            line = "1 more part is found" if new == 1 else f"{new or 'no'} more parts are found"
            self._set_shown(notice=self._note(line))
        elif self._over and self._shown.arrival is not None:
            self._look_at(self._shown.image, replace(self._shown.arrival, run=self._playing))
        else:
            self._set_shown(phase="opening", paused=False, **NOTHING)

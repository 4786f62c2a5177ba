# SPDX-License-Identifier: Apache-2.0
"""A session: source, tracker and what people say of it, in one thread. It knows nothing of the web.

Images come through an inbox, and so does everything that a person or a helper says: one thread owns all
state. What it shows is an immutable `Shown`, handed to listeners, which must not wait.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from grasptrack.errors import GraspTrackError, InputError
from grasptrack.first_image import FirstImage
from grasptrack.grasp.contacts import Grasp
from grasptrack.io.base import Source
from grasptrack.io.recording import tracking_options
from grasptrack.io.results import RunSummary
from grasptrack.live import commands as told
from grasptrack.live.advisor import (
    Failure,
    HoverOutline,
    Proposal,
    Verdict,
    WireDesk,
    WireState,
    judge_object,
    outline_under,
    propose_object,
)
from grasptrack.live.inbox import Arrival, Ended
from grasptrack.live.loop import SessionLoop
from grasptrack.live.servo_desk import ServoDesk
from grasptrack.live.settings import Settings, shared_segmenter
from grasptrack.live.state import ServoMoment, Shown
from grasptrack.servo.goal import Goal
from grasptrack.tracking.result import TrackResult
from grasptrack.tracking.tracker import GraspTracker

CONTACTS = 3
"""Contacts that grasps.csv has columns for at least: the number of fingers may be changed on the page."""
CORNERS = 200
"""Corners of an outline that is handed to another tracker, about."""
GOAL = "goal.json"
CLEARED: dict[str, Any] = dict.fromkeys(("result", "proposal", "verdict", "wire", "hover"))
"""What is shown of an object, when none is chosen."""


class LiveSession(SessionLoop):
    """Tracks a source while people look on and tell it what they want.

    Args:
        source: nobody else reads it.
        settings: of the tracker.
        output: the run's folder; an earlier run's files in it are replaced.
        meant: what is said of the first image; an object that it names is followed at once. Background, ignored pixels and the
            search's bounds count for every image in which an object is to be chosen.
        at_once: follow the likeliest object of the first image without a person's word.
        options: what the user asked for, for run.json.
        record_as: suffix of recordings: ".mp4", or one that `grasptrack.io.recording.create_recording` takes.
        pace: play files at their own rate; without, as fast as they are tracked.
        servo: moves an arm by what is followed; None moves none.
    """

    def __init__(
        self,
        source: Source,
        settings: Settings,
        output: Path,
        *,
        meant: FirstImage | None = None,
        at_once: bool = False,
        options: Mapping[str, Any] | None = None,
        record_as: str = ".mp4",
        pace: bool = True,
        servo: ServoDesk | None = None,
    ) -> None:
        self._settings = replace(settings, segmenter=shared_segmenter(settings.segmenter))
        self.can_hover = settings.segmenter is not None
        self._options = dict(options or {})
        self._first_meant, self._at_once = meant or FirstImage(), at_once
        self._nothing_meant = self._first_meant.of_no_object()
        fingers = max(CONTACTS, settings.fingers, len(self._first_meant.grasp or ()))
        shown = Shown(meant=self._nothing_meant, live=source.live, count=source.count)
        shown = replace(shown, friction=settings.friction, fingers=settings.fingers, unit=settings.unit)
        super().__init__(source, output, fingers, shown, options or {}, record_as, pace)
        self.servo = servo
        self._desk = WireDesk()
        self._tracker: GraspTracker | None = None
        self._grasps_before, self._grasps = 0, 0
        self._question = 0
        self._chosen_in = 0  # number of the image in which the object was chosen
        self._follow_when_ready = False

    def start(self) -> None:
        """Begin, in threads of its own."""
        if self.servo is not None:
            self.add_listener(self.servo.take_moment)
            self.servo.start(lambda moment: self._inbox.tell(moment, bounded=False))
        super().start()

    def stop(self) -> RunSummary | None:
        """Have the arm stand, end, and make the files whole; may be called again."""
        if self.servo is not None:
            self.servo.stop()
        return super().stop()

    def _take_answer(self, what: Any) -> bool:
        match what:
            case Proposal():
                self._on_proposal(what)
            case Verdict():
                if what.question == self._question:
                    self._set_shown(verdict=what)
            case WireState():
                self._set_shown(wire=what, notice=self._note(what.error) if what.error else self._shown.notice)
            case HoverOutline():
                self._set_shown(hover=what)
            case ServoMoment():
                self._set_shown(servo=what)
            case Failure():
                looking = self._shown.phase == "looking"
                self._set_shown(phase="choosing" if looking else self._shown.phase, notice=self._note(what.line))
            case _:
                return False
        return True

    # --- images ----------------------------------------------------------------------------------

    def _look_at(self, image: int, arrival: Arrival) -> None:
        if self._tracker is None:
            is_first = image == self._first_image
            meant = self._first_meant if is_first else self._nothing_meant
            self._propose_object(image, meant, follow=is_first and (self._at_once or meant.says_anything))
            return
        try:
            result = self._tracker.update(arrival.frame.image, time=arrival.frame.time)
        except GraspTrackError as error:
            self._tracker = None
            self._set_shown(phase="failed", image=image, arrival=arrival, result=None, notice=self._note(str(error)))
            return
        self._show_result(image, arrival, result)

    def _show_result(self, image: int, arrival: Arrival, result: TrackResult, **changed: Any) -> None:
        if result.grasp_id is not None:
            result = replace(result, grasp_id=self._grasps_before + result.grasp_id)
            self._grasps = max(self._grasps, result.grasp_id or 0)
        phase = "ended" if self._over else "tracking"
        self.curves.add(result)
        last = result if result.located else self._shown.last
        self._set_shown(phase=phase, image=image, arrival=arrival, result=result, last=last, **changed)
        if image > self._recorded:
            self._recorded = image
            self._run.write_frame(arrival.frame, result)
            self._recordings.add(arrival.frame, result, lambda: self._options_again(image))

    def _options_again(self, image: int) -> str:
        """Options that track a recording again alike which begins with an image; none, where tracking began before it."""
        if image != self._chosen_in:
            return ""
        return tracking_options({**self._options, **self._settings.tracking_options(self._shown.meant), "sure": 0})

    def _on_end(self, end: Ended) -> None:
        self._over = True
        if end.error:
            self._tracker, self._question = None, self._question + 1  # what is being looked for comes too late
            self._set_shown(phase="failed", notice=self._note(end.error))
        elif self._shown.phase in ("tracking", "opening"):
            self._tracker = None
            said = end.note or ("the source has no image" if not self._images else "")
            self._set_shown(phase="ended", notice=self._note(said) if said else self._shown.notice)

    # --- choosing --------------------------------------------------------------------------------

    def _propose_object(self, image: int, meant: FirstImage, *, follow: bool = False) -> None:
        """Hold an image, and have an object and a grasp looked for in it."""
        arrival = self._kept.get_image(image)
        self._tracker, self._follow_when_ready = None, follow
        if self._source.live:
            self._inbox.keep_images()
        self._question += 1
        question, settings = self._question, self._settings
        cleared = dict.fromkeys(("result", "proposal", "verdict"))
        self._set_shown(phase="looking", image=image, arrival=arrival, meant=meant, paused=False, **cleared)
        self._advisor.add_job(lambda: propose_object(question, image, arrival, meant, settings), "propose")

    def _on_proposal(self, proposal: Proposal) -> None:
        if proposal.question != self._question:
            return
        meant = proposal.meant
        sure = meant.is_settled or (meant.names_object and proposal.is_sure(meant.sure))
        if proposal.tracker is not None and (self._follow_when_ready or (sure and proposal.candidates)):
            self._follow_proposal(proposal)
            return
        self._follow_when_ready = False
        note = self._note(proposal.error) if proposal.error else self._shown.notice
        if self._source.live and not proposal.candidates and not meant.says_anything and not proposal.error:
            self._inbox.newest_only()
            self._set_shown(phase="opening", result=proposal.result, notice=note)  # the next image may show an object
            return
        self._set_shown(phase="choosing", proposal=proposal, result=proposal.result, notice=note)
        question, scene = proposal.question, proposal.scene
        if scene is not None:
            self._advisor.add_job(lambda: judge_object(question, scene), "judge")

    def _follow_proposal(self, proposal: Proposal) -> None:
        """Go on with a tracker that has seen the image in which the object was chosen."""
        assert proposal.tracker is not None and proposal.result is not None
        self._question += 1  # a verdict that is on its way comes too late
        self._tracker, self._grasps_before = proposal.tracker, self._grasps
        self._chosen_in = proposal.image
        self._show_result(
            proposal.image, self._kept.get_image(proposal.image), proposal.result, proposal=None, wire=None, hover=None
        )

    # --- words -----------------------------------------------------------------------------------

    def _obey_command(self, command: told.Command) -> None:
        match command:
            case told.Pick(image, x, y, on):
                here = self._meant_in(image)
                self._propose_object(image, here.with_pixel((x, y), on))
            case told.Box(image, x, y, width, height):
                off = self._meant_in(image).not_at
                self._propose_object(image, replace(self._nothing_meant, not_at=off, box=(x, y, width, height)))
            case told.Contacts(image, points):
                self._propose_object(image, replace(self._nothing_meant, grasp=Grasp(points)))
            case told.Outline(image, points):
                self._propose_object(image, replace(self._nothing_meant, outline=np.array(points)))
            case told.Choose(number):
                self._choose_candidate(number)
            case told.Start():
                self._start_tracking()
            case told.Restart():
                self._restart_source()
            case told.Rechoose():
                self._choose_again()
            case told.Friction(value):
                self._set_friction(value)
            case told.Fingers(count):
                self._set_fingers(count)
            case told.Wire():
                arrival = self._kept.get_image(command.image)
                key = "wire-hover" if command.step == "hover" else ""
                self._advisor.add_job(lambda: self._desk.take_step(command, arrival), key)
            case told.Hover() if self.can_hover:
                arrival, settings = self._kept.get_image(command.image), self._settings
                self._advisor.add_job(lambda: outline_under(command, arrival, settings), "hover")
            case told.Fingertips():
                self._set_goal(command.servo_goal())
            case told.Teach():
                result = self._shown.result
                if result is None or not result.located:
                    raise InputError("the grasp is not located in this image: it can be no goal")
                self._set_goal(Goal.taught(result))
            case told.Anew():
                if self.servo is None:
                    raise InputError("there is no servo: grasptrack live takes one with --servo")
                self.servo.begin_anew()
            case _:
                super()._obey_command(command)

    def _set_goal(self, goal: Goal) -> None:
        goal.save(self._output / GOAL)
        self._add_file(GOAL)
        if self.servo is not None:
            self.servo.set_goal(goal)
        self._set_shown(notice=self._note(f"{GOAL} is written: Goal.load reads it"))

    def _meant_in(self, image: int) -> FirstImage:
        """What was said of an image before."""
        shown = self._shown
        return shown.meant if shown.phase in ("looking", "choosing") and shown.image == image else self._nothing_meant

    def _choose_candidate(self, number: int) -> None:
        proposal = self._shown.proposal
        if proposal is None or number > len(proposal.candidates):
            there = 0 if proposal is None else len(proposal.candidates)
            raise InputError(f"there is no candidate {number}: there are {there}")
        if number == 1 and proposal.tracker is not None:
            proposal.tracker.object_sure = True  # a person said so
            result = None if proposal.result is None else replace(proposal.result, object_sure=True)
            self._follow_proposal(replace(proposal, result=result))
            return
        self._propose_object(proposal.image, replace(proposal.meant, number=number), follow=True)

    def _start_tracking(self) -> None:
        proposal = self._shown.proposal
        if self._shown.phase == "looking":
            self._follow_when_ready = True
        elif self._shown.phase != "choosing" or proposal is None or proposal.tracker is None:
            raise InputError("there is nothing to start: choose an object first")
        elif proposal.candidates:
            self._choose_candidate(1)
        else:
            self._follow_proposal(proposal)  # it looks for the object in the images that follow

    def _restart_source(self) -> None:
        again = self._shown.meant if self._shown.image == self._first_image else self._first_meant
        self._first_meant = self._nothing_meant if self._source.live else again
        self._tracker = None
        self._start_player()
        self._set_shown(phase="opening", paused=False, **CLEARED)

    def _choose_again(self) -> None:
        self._tracker, self._question = None, self._question + 1
        if self._source.live and self._shown.phase not in ("ended", "failed"):
            self._inbox.newest_only()
            self._set_shown(phase="opening", paused=False, meant=self._nothing_meant, **CLEARED)
        else:
            self._propose_object(self._shown.image, self._nothing_meant)

    def _set_friction(self, value: float) -> None:
        self._settings = replace(self._settings, friction=value)
        self._set_shown(friction=value)
        if self._tracker is not None:
            self._tracker.friction = value
        elif self._shown.phase in ("choosing", "looking"):
            self._propose_object(self._shown.image, self._shown.meant)

    def _set_fingers(self, count: int) -> None:
        self._settings.make_tracker(self._nothing_meant)  # as it is now, it is known to be good
        settings = replace(self._settings, fingers=count)
        settings.make_tracker(self._nothing_meant)
        self._settings = settings
        shown = self._shown
        self._set_shown(fingers=count)
        if shown.phase in ("choosing", "looking"):
            self._propose_object(shown.image, replace(shown.meant, grasp=None))
        elif self._tracker is not None and shown.result is not None and shown.result.located and shown.result.view:
            outline = shown.result.view.outer.points
            corners = outline[:: max(1, len(outline) // CORNERS)]
            self._propose_object(shown.image, replace(self._nothing_meant, outline=corners))
        elif self._tracker is not None:
            self._set_shown(
                notice=self._note("the number of fingers counts from the next choice on: the object is not located now")
            )

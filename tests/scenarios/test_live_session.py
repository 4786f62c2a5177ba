# SPDX-License-Identifier: Apache-2.0
"""A session without a page: what each command does, what its files hold, and that nothing outlives it."""

import errno
import json
import threading
import time
from collections.abc import Generator
from pathlib import Path
from types import SimpleNamespace

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasptrack import Goal, GraspTracker, open_source
from grasptrack.first_image import FirstImage
from grasptrack.io.base import Frame, Image
from grasptrack.io.limits import HELD, limit_megapixels
from grasptrack.live import commands as told
from grasptrack.live import loop
from grasptrack.live.inbox import FASTEST, SLOWEST, _PlaybackClock
from grasptrack.live.session import GOAL, LiveSession
from grasptrack.live.settings import Settings
from grasptrack.tracking.result import TrackResult
from recordings import plate, plates, rows, square
from tiny_onnx import write_pair
from watched import (
    PATIENCE,
    FedCamera,
    camera_session,
    plate_session,
    reached,
    record_and_start,
    session_on,
    threads_left,
    threads_of_ours,
    two_plates,
    until,
)

ON_PLATE = (150.0, 100.0)


def test_it_answers_as_the_tracker_does_and_writes_what_track_writes(tmp_path: Path) -> None:
    with plate_session(tmp_path, 12, at_once=True) as session:
        reached(session, "ended", image=12)
    tracker, expected = GraspTracker(), []
    for frame in open_source(str(tmp_path / "in"), fps=25.0):
        expected.append(tracker.update(frame.image, time=frame.time))
    found = rows(tmp_path / "run")
    assert [row["status"] for row in found] == [r.status for r in expected] == ["tracked"] * 12
    for row, result in zip(found, expected, strict=True):
        assert result.contacts is not None
        assert [float(row[name]) for name in ("x1", "y1", "x2", "y2")] == pytest.approx(
            result.contacts.ravel(), abs=1e-4
        )
    assert [row["frame"] for row in found] == [str(k) for k in range(12)] and "x3" in found[0]
    log = json.loads((tmp_path / "run" / "run.json").read_text())
    assert log["ended"] == "finished" and log["frames"] == 12


def test_it_waits_with_a_verdict_until_it_is_told_to_start(tmp_path: Path) -> None:
    with plate_session(tmp_path, 6) as session:
        shown = until(session, lambda s: s.verdict is not None)
        assert (shown.phase, shown.image) == ("choosing", 1) and shown.verdict.level == "good"
        assert shown.proposal is not None and shown.proposal.is_sure(0.9)
        session.send_command(told.Start())
        shown = reached(session, "ended", image=6)
        assert shown.result is not None and shown.result.object_sure
    assert len(rows(tmp_path / "run")) == 6


def test_a_click_follows_the_object_in_the_image_that_was_clicked(tmp_path: Path) -> None:
    with plate_session(tmp_path, 8) as session:
        reached(session, "choosing")
        session.send_command(told.Pick(1, *ON_PLATE))
        reached(session, "ended", image=8)
    assert [row["frame"] for row in rows(tmp_path / "run")] == [str(k) for k in range(8)]


def test_candidates_are_numbered_where_it_is_not_sure_and_a_number_takes_one(tmp_path: Path) -> None:
    with camera_session(tmp_path, *[two_plates()] * 3) as (session, _):
        shown = reached(session, "choosing")
        assert shown.proposal is not None and len(shown.proposal.candidates) >= 2
        assert not shown.proposal.is_sure(0.9)
        second = shown.proposal.candidates[1].view.outer.points.mean(axis=0)
        session.send_command(told.Choose(2))
        shown = reached(session, "tracking")
        assert shown.result is not None and shown.result.view is not None and shown.result.object_sure
        assert shown.result.view.outer.points.mean(axis=0) == pytest.approx(second, abs=2.0)


@pytest.mark.parametrize("word", [True, False], ids=["said", "at once"])
def test_taking_the_first_candidate_is_a_persons_word_and_beginning_at_once_is_none(tmp_path: Path, word: bool) -> None:
    with camera_session(tmp_path, two_plates(), at_once=not word) as (session, camera):
        if word:
            reached(session, "choosing")
            session.send_command(told.Choose(1))
        for image in (1, 2):
            shown = reached(session, "tracking", image=image)
            assert shown.result is not None and shown.result.object_sure is word
            camera.images.put(two_plates())


def test_pixels_for_and_against_add_up_on_one_image(tmp_path: Path) -> None:
    with camera_session(tmp_path, two_plates(), meant=FirstImage(sure=0.9999)) as (session, _):
        reached(session, "choosing")
        session.send_command(told.Pick(1, 340.0, 100.0))
        until(session, lambda s: s.phase == "choosing" and s.meant.object_at)
        session.send_command(told.Pick(1, 30.0, 30.0, on=False))
        shown = until(session, lambda s: s.phase == "choosing" and s.meant.not_at)
        assert shown.meant == FirstImage(object_at=((340.0, 100.0),), not_at=((30.0, 30.0),), sure=0.9999)
        assert shown.proposal is not None
        assert shown.proposal.candidates[0].view.outer.points[:, 0].min() > 240.0


def test_contacts_are_moved_to_the_outline_and_followed(tmp_path: Path) -> None:
    with plate_session(tmp_path, 6) as session:
        shown = reached(session, "choosing")
        assert shown.proposal is not None and shown.result is not None and shown.result.contacts is not None
        near = shown.result.contacts + np.array([[1.5, -1.0], [-1.0, 1.5]])
        session.send_command(told.Contacts(1, tuple((x, y) for x, y in near.tolist())))
        shown = reached(session, "ended", image=6)
    first = rows(tmp_path / "run")[0]
    contacts = np.array([[float(first["x1"]), float(first["y1"])], [float(first["x2"]), float(first["y2"])]])
    view = shown.result.view if shown.result is not None else None
    assert view is not None and np.abs(contacts - near).max() < 4.0 and not np.allclose(contacts, near)


def test_a_box_an_outline_and_a_wire_say_which_object(tmp_path: Path) -> None:
    with camera_session(tmp_path, two_plates()) as (session, _):
        reached(session, "choosing")
        session.send_command(told.Box(1, 260.0, 50.0, 180.0, 140.0))
        shown = until(session, lambda s: s.phase in ("choosing", "tracking") and s.meant.box is not None)
        assert shown.result is not None and shown.result.view is not None
        box_outline = shown.result.view.outer.points
        assert box_outline[:, 0].min() > 240.0
        for x, y in box_outline[:: len(box_outline) // 4][:4]:
            session.send_command(told.Wire(1, "add", x, y))
        session.send_command(told.Wire(1, "close"))
        shown = until(session, lambda s: s.wire is not None and s.wire.closed)
        assert shown.wire is not None and shown.wire.path is not None and len(shown.wire.points) == 4
        session.send_command(told.Outline(1, tuple((x, y) for x, y in shown.wire.path.tolist())))
        shown = until(session, lambda s: s.phase == "tracking" and s.meant.outline is not None)
        assert shown.result is not None and shown.result.view is not None
        middle = shown.result.view.outer.points.mean(axis=0)
        assert middle == pytest.approx(box_outline.mean(axis=0), abs=3.0)


def test_a_pause_holds_the_image_and_a_camera_goes_on_with_the_newest(tmp_path: Path) -> None:
    with camera_session(tmp_path, plate(), at_once=True) as (session, camera):
        reached(session, "tracking", image=1)
        session.send_command(told.Pause(True))
        reached(session, "tracking", paused=True)
        for k in range(5):
            camera.images.put(plate((160.0 + k, 120.0)))
        assert not session.wait_for(lambda s: s.image > 1, 0.3)
        session.send_command(told.Pause(False))
        shown = reached(session, "tracking", image=2)
        assert shown.arrival is not None and shown.arrival.frame.name == "frame 5"


def test_a_step_is_one_image_and_speed_is_that_of_a_file(tmp_path: Path) -> None:
    source = open_source(str(plates(tmp_path / "in", 12)), fps=5.0)
    session = LiveSession(source, Settings(), tmp_path / "run", at_once=True)
    session.start()
    try:
        reached(session, "tracking")
        session.send_command(told.Forward())
        until(session, lambda s: "pause first" in s.notice[1])
        session.send_command(told.Pause(True))
        here = until(session, lambda s: s.paused).image
        for k in range(1, 4):
            session.send_command(told.Forward())
            assert until(session, lambda s, k=k: s.image == here + k).paused
        session.send_command(told.Tempo(10.0))
        session.send_command(told.Pause(False))
        shown = reached(session, "ended")
        assert shown.arrival is not None and shown.arrival.place == 11
        assert (shown.count, shown.speed) == (12, 10.0)
    finally:
        session.stop()


@given(st.floats(SLOWEST, FASTEST), st.floats(0.0, 1.0))
def test_an_image_is_due_sooner_by_the_speed(speed: float, gap: float) -> None:
    clock = _PlaybackClock(SimpleNamespace(fps=None))
    clock.wait_for(Frame(0, 0.0, np.zeros((1, 1), np.uint8), ""), speed)
    wait = clock.wait_for(Frame(1, gap, np.zeros((1, 1), np.uint8), ""), speed)
    assert 0.0 <= wait <= gap / speed


def test_what_moves_while_a_person_chooses_is_caught_up_with(tmp_path: Path) -> None:
    """A square that turns by 90 degrees meanwhile would be ambiguous for who sees only the newest image."""
    with camera_session(tmp_path, square(0.0)) as (session, camera):
        first = reached(session, "choosing").result
        turns = np.radians(np.arange(6.0, 97.0, 6.0))
        for angle in turns:
            camera.images.put(square(float(angle)))
        assert not session.wait_for(lambda s: s.image > 1, 0.3)
        session.send_command(told.Start())
        last = reached(session, "tracking", image=1 + len(turns)).result
    assert first is not None and first.contacts is not None
    assert last is not None and last.contacts is not None
    turn = np.array([[np.cos(turns[-1]), -np.sin(turns[-1])], [np.sin(turns[-1]), np.cos(turns[-1])]])
    middle = np.array([160.0, 120.0])
    np.testing.assert_allclose(last.contacts, (first.contacts - middle) @ turn.T + middle, atol=0.5)
    assert len(rows(tmp_path)) == 1 + len(turns)


def test_an_old_image_cannot_be_clicked_and_the_line_says_so(tmp_path: Path) -> None:
    with plate_session(tmp_path, 3, at_once=True) as session:
        reached(session, "ended")
        session.send_command(told.Pick(99, *ON_PLATE))
        shown = until(session, lambda s: s.notice[0] > 0)
        assert "image 99" in shown.notice[1] and shown.phase == "ended"


def test_a_file_is_played_again_from_its_start(tmp_path: Path) -> None:
    with plate_session(tmp_path, 4) as session:
        reached(session, "choosing")
        session.send_command(told.Start())
        reached(session, "ended", image=4)
        session.send_command(told.Restart())
        shown = reached(session, "choosing", image=5)
        assert shown.arrival is not None and shown.arrival.frame.name == "000.png"
        session.send_command(told.Start())
        shown = reached(session, "ended", image=8)
        assert shown.result is not None and shown.result.grasp_id == 2
    assert [row["grasp_id"] for row in rows(tmp_path / "run")] == ["1"] * 4 + ["2"] * 4


def test_friction_is_judged_at_once_and_fingers_give_another_grasp(tmp_path: Path) -> None:
    with camera_session(tmp_path, plate(), at_once=True) as (session, camera):
        before = reached(session, "tracking", image=1).result
        session.send_command(told.Friction(0.9))
        camera.images.put(plate((161.0, 120.0)))
        shown = reached(session, "tracking", image=2, friction=0.9)
        assert shown.result is not None and shown.result.analysis is not None and before is not None
        assert before.analysis is not None and shown.result.analysis.margin > before.analysis.margin + 0.1
        session.send_command(told.Fingers(3))
        shown = until(session, lambda s: s.result is not None and s.result.grasp_id == 2)
        assert shown.result is not None and shown.result.contacts is not None and len(shown.result.contacts) == 3
        camera.images.put(plate((162.0, 120.0)))
        reached(session, "tracking", image=3)
    last = rows(tmp_path)[-1]
    assert last["x3"] != "" and last["grasp_id"] == "2"


def test_a_number_of_fingers_that_the_strategy_cannot_carry_is_told(tmp_path: Path) -> None:
    with plate_session(tmp_path, 3, settings=Settings(strategy="grasp-line")) as session:
        reached(session, "choosing")
        session.send_command(told.Fingers(3))
        shown = until(session, lambda s: s.notice[0] > 0)
        assert "grasp-line" in shown.notice[1] and shown.fingers == 2 and shown.phase == "choosing"


def test_recordings_are_whole_videos_in_the_runs_folder(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    earlier = tmp_path / "run" / "recording-001.mp4"
    earlier.write_bytes(b"of an earlier session")
    with plate_session(tmp_path, 10) as session:
        record_and_start(session)
        shown = reached(session, "ended")
        assert shown.recording == "recording-002.mp4"
        session.send_command(told.Record(False))
        shown = until(session, lambda s: "recording-002.mp4" in s.files)
        assert shown.recording == "" and "10 images" in shown.notice[1]
    with av.open(str(tmp_path / "run" / "recording-002.mp4")) as container:
        assert sum(1 for _ in container.decode(video=0)) == 10
    assert earlier.read_bytes() == b"of an earlier session"


def test_a_recording_for_foxglove_is_a_source_again(tmp_path: Path) -> None:
    pytest.importorskip("foxglove")
    pytest.importorskip("rosbags")
    with plate_session(tmp_path, 5, record_as=".mcap") as session:
        record_and_start(session)
        reached(session, "ended")
        session.send_command(told.Record(False))
        until(session, lambda s: "recording-001.mcap" in s.files)
    again = [frame.image for frame in open_source(str(tmp_path / "run" / "recording-001.mcap"))]
    first = [frame.image for frame in open_source(str(tmp_path / "in"))]
    assert len(again) == 5 and all(np.array_equal(a.squeeze(), b) for a, b in zip(again, first, strict=True))


class Gated:
    """A recording that writes nothing before its gate is opened, and then breaks where it shall."""

    def __init__(self, path: Path, error: Exception | None = None) -> None:
        self.path, self.error, self.gate = path, error, threading.Event()
        self.images: list[int] = []

    def write(self, frame: Frame, result: TrackResult) -> None:
        assert self.gate.wait(PATIENCE)
        if self.error is not None:
            raise self.error
        self.images.append(frame.index)

    def close(self) -> None:
        self.path.touch()


def test_a_camera_is_tracked_on_where_a_recording_does_not_keep_up(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gated = Gated(tmp_path / "recording-001.mcap")
    monkeypatch.setattr(loop, "create_recording", lambda path, **_: gated)
    camera = FedCamera()
    with session_on(camera, tmp_path, at_once=True, record_as=".mcap") as session:
        camera.images.put(plate((160.0, 120.0)))
        reached(session, "tracking", image=1)
        session.send_command(told.Record(True))
        until(session, lambda s: s.recording)
        count = HELD + 8
        for k in range(2, count + 2):
            camera.images.put(plate((160.0 + 0.1 * k, 120.0)))
            reached(session, "tracking", image=k)
        assert session.shown.dropped in (6, 7)  # as of the image before; one may be in the writer's hands
        gated.gate.set()
    (figures,) = json.loads((tmp_path / "run.json").read_text())["recordings"]
    assert figures["name"] == "recording-001.mcap" and figures["images"] == len(gated.images)
    assert figures["images"] + figures["dropped"] == count and figures["dropped"] in (6, 7, 8)


def test_a_file_waits_for_its_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    gated = Gated(tmp_path / "run" / "recording-001.mcap")
    monkeypatch.setattr(loop, "create_recording", lambda path, **_: gated)
    with plate_session(tmp_path, HELD + 8, record_as=".mcap") as session:
        record_and_start(session)
        until(session, lambda s: s.image >= HELD)
        assert not session.wait_for(lambda s: s.phase == "ended", 0.3)
        gated.gate.set()
        reached(session, "ended", image=HELD + 8)
    assert gated.images == list(range(HELD + 8))
    assert json.loads((tmp_path / "run" / "run.json").read_text())["recordings"][0]["dropped"] == 0


def test_a_recording_that_finds_no_room_is_told_and_tracking_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    gated = Gated(tmp_path / "run" / "recording-001.mcap", OSError(errno.ENOSPC, "No space left on device"))
    gated.gate.set()
    monkeypatch.setattr(loop, "create_recording", lambda path, **_: gated)
    with plate_session(tmp_path, 5, record_as=".mcap") as session:
        record_and_start(session)
        shown = until(session, lambda s: s.phase == "ended" and not s.recording)
        line = '"recording-001.mcap" cannot be written: No space left on device; 0 images of it can be read'
        assert shown.notice[1] == line


def test_a_recording_that_cannot_be_begun_is_told_and_tracking_goes_on(tmp_path: Path) -> None:
    with plate_session(tmp_path, 4, record_as=".nothing") as session:
        reached(session, "choosing")
        session.send_command(told.Record(True))
        until(session, lambda s: s.notice[0] == 1)
        session.send_command(told.Start())
        reached(session, "ended", image=4)


def test_fingertips_become_a_goal_that_the_servo_reads(tmp_path: Path) -> None:
    with plate_session(tmp_path, 2) as session:
        reached(session, "choosing")
        points = ((100.25, 200.5), (220.0, 201.0))
        session.send_command(told.Fingertips(points, 0.085, 0.004, False))
        until(session, lambda s: GOAL in s.files)
        expected = Goal.fingertips(points, 0.085, beyond_m=0.004, symmetric=False)
        assert Goal.load(tmp_path / "run" / GOAL) == expected
        assert session.written_file(GOAL) == tmp_path / "run" / GOAL
        session.send_command(told.Fingertips(points, -1.0))
        until(session, lambda s: "positive" in s.notice[1])


def test_a_source_that_breaks_off_leaves_what_was_computed_and_can_be_begun_again(tmp_path: Path) -> None:
    given = (plate(), plate((161.0, 120.0)), "camera fed was unplugged")
    with camera_session(tmp_path, *given, at_once=True) as (session, camera):
        shown = reached(session, "failed")
        assert shown.notice[1] == "camera fed was unplugged"
        session.send_command(told.Restart())
        reached(session, "opening")
        camera.images.put(plate())
        reached(session, "tracking")
    log = json.loads((tmp_path / "run.json").read_text())
    assert rows(tmp_path) and log["ended"] in ("failed", "interrupted")


def test_what_was_said_of_a_cameras_first_image_does_not_count_of_another_one(tmp_path: Path) -> None:
    meant = FirstImage(object_at=((340.0, 100.0),))
    with camera_session(tmp_path, two_plates(), meant=meant) as (session, camera):
        shown = reached(session, "tracking")
        assert shown.meant == meant
        camera.images.put("unplugged")
        reached(session, "failed")
        session.send_command(told.Restart())
        camera.images.put(two_plates())
        assert reached(session, "choosing").meant == FirstImage()


def test_images_of_another_size_end_it_in_one_line(tmp_path: Path) -> None:
    with camera_session(tmp_path, plate(), at_once=True) as (session, camera):
        reached(session, "tracking")
        camera.images.put(plate(size=(200, 300)))
        assert "all frames must have one size" in reached(session, "failed").notice[1]


def test_an_empty_bench_is_looked_at_until_an_object_lies_there(tmp_path: Path) -> None:
    with camera_session(tmp_path, np.full((240, 320), 200, np.uint8)) as (session, camera):
        shown = until(session, lambda s: s.phase == "opening" and s.result is not None)
        assert shown.result is not None and shown.result.status == "searching"
        camera.images.put(plate())
        shown = reached(session, "choosing")
        assert shown.proposal is not None and shown.proposal.candidates
    assert rows(tmp_path) == []


@pytest.mark.slow
def test_what_a_net_takes_for_the_object_is_shown_under_the_pointer(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime")
    from grasptrack.segmentation.segmenters import segmenter_for

    encoder, decoder = write_pair(tmp_path, "sam")
    camera = FedCamera()
    camera.images.put(plate())
    settings = Settings(segmenter=segmenter_for(f"sam:{encoder},{decoder}"))
    with session_on(camera, tmp_path / "run", settings) as session:
        assert session.can_hover
        reached(session, "choosing")
        session.send_command(told.Hover(1, *ON_PLATE))
        shown = until(session, lambda s: s.hover is not None)
        assert shown.hover is not None and shown.hover.image == 1


def test_nothing_outlives_a_session(tmp_path: Path) -> None:
    before = threads_of_ours()
    for k in range(3):
        with plate_session(tmp_path / str(k), 3) as session:
            reached(session, "choosing")
            session.send_command(told.Record(True))
            session.send_command(told.Start())
        assert session.stop() is session.summary
    assert threads_left(before) == set()


def test_a_session_that_was_never_begun_can_be_stopped(tmp_path: Path) -> None:
    before = threads_of_ours()
    session = LiveSession(open_source(str(plates(tmp_path / "in", 2))), Settings(), tmp_path / "run")
    session.stop()
    assert json.loads((tmp_path / "run" / "run.json").read_text())["ended"] == "interrupted"
    assert threads_left(before) == set()


def test_the_limit_of_size_holds_in_its_threads(tmp_path: Path) -> None:
    limit_megapixels(0.05)
    try:
        with plate_session(tmp_path, 2) as session:
            assert "megapixels" in reached(session, "failed").notice[1]
    finally:
        limit_megapixels(None)


def test_a_source_that_waits_for_a_device_is_left_at_once(tmp_path: Path) -> None:
    class Waiting(FedCamera):
        def __init__(self) -> None:
            super().__init__()
            self.on_wait = lambda: None

        def _read_images(self) -> Generator[tuple[Image, float | None, str], None, None]:
            yield plate(), 0.0, "frame 0"
            while True:
                self.on_wait()
                time.sleep(0.02)

    before = threads_of_ours()
    with session_on(Waiting(), tmp_path) as session:
        reached(session, "choosing")
    assert threads_left(before) == set()


def test_a_full_disk_is_told_in_a_line_and_ends_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    with plate_session(tmp_path, 3) as session:
        reached(session, "choosing")
        monkeypatch.setattr(session._run, "write_frame", full)
        session.send_command(told.Start())
        assert "No space left on device" in reached(session, "failed").notice[1]
    assert json.loads((tmp_path / "run" / "run.json").read_text())["ended"] == "failed"

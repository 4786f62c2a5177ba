# SPDX-License-Identifier: Apache-2.0
"""Sessions of the live page for tests: on folders of drawn images, and on a source that tests feed image by image."""

import threading
import time
from collections.abc import Generator, Iterator
from contextlib import contextmanager
from pathlib import Path
from queue import SimpleQueue
from typing import Any

import numpy as np

from grasptrack import Part, first_look, synthesize
from grasptrack.errors import SourceError
from grasptrack.io.base import Image, Source
from grasptrack.io.sources import open_source
from grasptrack.live import commands as told
from grasptrack.live.loop import SessionLoop
from grasptrack.live.scene_session import SceneSession
from grasptrack.live.session import LiveSession
from grasptrack.live.settings import SceneSettings, Settings
from grasptrack.live.state import Shown
from recordings import plate, plates
from scenery import L_PLATE, drawn

PATIENCE = 40.0
"""s; machines that run tests are slow now and then, and no test passes by waiting."""


class FedCamera(Source):
    """A live source whose images a test puts in; None ends it, a string breaks it off with that line."""

    kind = "camera"
    live = True

    def __init__(self) -> None:
        super().__init__("camera:fed")
        self.images: SimpleQueue[np.ndarray | str | None] = SimpleQueue()

    def _read_images(self) -> Generator[tuple[Image, float | None, str], None, None]:
        index = 0
        while True:
            image = self.images.get()
            if image is None:
                return
            if isinstance(image, str):
                raise SourceError(image)
            yield image, 0.04 * index, f"frame {index}"
            index += 1


@contextmanager
def session_on(source: Source, output: Path, settings: Settings | None = None, **more: Any) -> Iterator[LiveSession]:
    """A session that runs, and is stopped at the end."""
    session = LiveSession(source, settings or Settings(), output, **{"pace": False, **more})
    session.start()
    try:
        yield session
    finally:
        if isinstance(source, FedCamera):
            source.images.put(None)
        session.stop()


@contextmanager
def camera_session(output: Path, *images: np.ndarray | str, **more: Any) -> Iterator[tuple[LiveSession, FedCamera]]:
    """A session on a camera that has given images, and breaks off with a string."""
    camera = FedCamera()
    for image in images:
        camera.images.put(image)
    with session_on(camera, output, **more) as session:
        yield session, camera


def record_and_start(session: LiveSession) -> None:
    """Once it waits for a person's choice."""
    reached(session, "choosing")
    session.send_command(told.Record(True))
    session.send_command(told.Start())


def plate_session(folder: Path, count: int = 12, **more: Any) -> Any:
    """A session on a folder of images in which a plate moves."""
    return session_on(open_source(plates(folder / "in", count), fps=25.0), folder / "run", **more)


def reached(session: SessionLoop, phase: str, **more: Any) -> Shown:
    """The moment in which a session is in a phase, with other attributes as given."""

    def wanted(shown: Shown) -> bool:
        return shown.phase == phase and all(getattr(shown, name) == value for name, value in more.items())

    assert session.wait_for(wanted, PATIENCE), f"{session.shown.phase}, {session.shown.notice}"
    return session.shown


def until(session: SessionLoop, wanted: Any) -> Shown:
    """The moment that is as wanted."""
    assert session.wait_for(wanted, PATIENCE), f"{session.shown.phase}, {session.shown.notice}"
    return session.shown


def two_plates(size: tuple[int, int] = (240, 480)) -> np.ndarray:
    """Two equal plates side by side: which is meant cannot be known."""
    one, other = plate((130.0, 120.0), 0.2, size), plate((350.0, 120.0), 0.2, size)
    return np.asarray(np.minimum(one, other))


PLACES = ((130.0, 120.0), (420.0, 330.0))
"""px, of two parts."""


def ell_part() -> Part:
    """A part as an image of it alone teaches it."""
    image = drawn(L_PLATE, centres=((160.0, 120.0),), angle=0.0, seed=7)
    view = first_look(image)[0].view
    return Part.of(image, view, synthesize(view, 2, top=1), name="ell")


def tray(*places: tuple[float, float]) -> np.ndarray:
    """(H, W) a part at each place."""
    return drawn(*[L_PLATE] * len(places), centres=places, angle=0.0, size=(480, 640), contrast=85.0, noise=2.0, seed=3)


def shifted(k: int) -> np.ndarray:
    """Two parts that move by a few px from image to image."""
    return tray(*((x + 2.0 * k, y + k) for x, y in PLACES))


@contextmanager
def scene_on(output: Path, *images: np.ndarray) -> Iterator[tuple[SceneSession, FedCamera]]:
    """A session on a camera that has given images."""
    camera = FedCamera()
    for image in images:
        camera.images.put(image)
    session = SceneSession(camera, SceneSettings([ell_part()]), output, pace=False)
    session.start()
    try:
        yield session, camera
    finally:
        camera.images.put(None)
        session.stop()


def threads_left(before: set[str]) -> set[str]:
    """Names of threads that were not there before and do not end; one that is at work ends when it is done."""
    end = time.monotonic() + PATIENCE
    while threads_of_ours() - before and time.monotonic() < end:
        time.sleep(0.05)
    return threads_of_ours() - before


def threads_of_ours() -> set[str]:
    """Names of the threads of sessions that go on."""
    return {t.name for t in threading.enumerate() if t.name.startswith("grasptrack-") and t.is_alive()}

# SPDX-License-Identifier: Apache-2.0
"""The pictures of the gallery: each status, strategy and kind of source, and the live page, as the program draws them."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from html import escape
from http.server import BaseHTTPRequestHandler, HTTPServer
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

import grasptrack as gt
from grasptrack.io.recording import create_recording
from grasptrack.io.video import VideoWriter
from grasptrack.live.server import PageServer
from grasptrack.live.session import LiveSession
from grasptrack.live.settings import Settings
from grasptrack.tracking.follower import AUTO
from grasptrack.tracking.strategies import PAPER
from grasptrack.transfer import STRATEGIES
from grasptrack.typing import Pixels
from grasptrack.view.style import Picture
from research.studies import common
from research.studies.moving_picture import covered_scene
from research.studies.reason_pictures import STAGED, Staged, case_of, from_suite, picture_of

Drawn = tuple[Picture, str] | None
"""A picture, and what is said below it; None where there is none."""
ENOUGH = 20
"""Images, of which the last one is shown."""
PAGE_SIZE, PAGE_SHOWN = (1400, 900), 960
"""px of the browser's window, and the width of its picture."""
PAGE_IMAGES, PAGE_RATE, PAGE_WAIT_MS = 200, 25.0, 3000
STATUSES: dict[str, Callable[[], Staged]] = {
    "searching": STAGED["no-grasp"],
    "tracked": lambda: from_suite("hammer-head", "print"),
    "unstable": STAGED["not-closing"],
    "lost": lambda: Staged(((frame.image, frame.time) for frame in covered_scene(60)), {}),
}
"""Scenes in which each is to be seen."""


# --- statuses and strategies ----------------------------------------------------------------------


def first_with_status(status: str) -> Drawn:
    """The first frame of a status, of "tracked" one further on."""
    staged, last = STATUSES[status](), None
    tracker = gt.GraspTracker(**{"fingers": 2, **staged.options})
    for k, (image, time) in enumerate(staged.images):
        result = tracker.update(image, time=time)
        last = result.view if result.located else last
        if result.status == status and (status != "tracked" or k >= ENOUGH // 2):
            return picture_of(image, result, last), describe_result(result)
    return None


def describe_result(result: gt.TrackResult) -> str:
    """What is told, in a line."""
    if result.located and not result.reason:
        return f"{result.status}, margin {result.margin_deg:.1f} degrees, confidence {result.confidence:.3f}"
    return f"{result.status}, {result.reason}"


def last_of_frames(frames: Iterator[tuple[Pixels, float | None]], strategy: str = AUTO) -> Drawn:
    """The last of some frames."""
    tracker, found, last = gt.GraspTracker(fingers=2, strategy=strategy), None, None
    for image, time in islice(frames, ENOUGH):
        result = tracker.update(image, time=time)
        last = result.view if result.located else last
        found = picture_of(image, result, last), describe_result(result)
    return found


# --- sources --------------------------------------------------------------------------------------


def scene_images(shape: str, disturbance: str) -> list[Pixels]:
    """The images of a scene."""
    return [frame.image for frame in islice(case_of(shape, disturbance, 5, ENOUGH).scene(), ENOUGH)]


def write_photos(folder: Path) -> str:
    """A folder of photos."""
    for k, image in enumerate(scene_images("spanner", "clean-6dof")):
        cv2.imwrite(str(folder / f"{k:03}.png"), image)
    return str(folder)


def write_film(folder: Path) -> str:
    """A video, as H.264."""
    writer = VideoWriter(folder / "video.mp4", 25.0)
    for image in scene_images("bottle", "hand-camera"):
        writer.write(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 else image)  # type: ignore[arg-type]
    writer.close()
    return str(folder / "video.mp4")


def write_mcap(folder: Path) -> str:
    """A recording of the program's own."""
    recording, tracker = create_recording(folder / "run.mcap"), gt.GraspTracker(fingers=2)
    source = gt.open_source(write_photos(folder), fps=25.0)
    for frame in source:
        recording.write(frame, tracker.update(frame.image, time=frame.time))
    recording.close()
    return str(folder / "run.mcap")


@contextmanager
def serve_stream(_folder: Path) -> Iterator[str]:
    """Motion JPEG over HTTP, as phones serve it."""
    images = [cv2.imencode(".jpg", image)[1].tobytes() for image in scene_images("ring-wrench", "jpeg")]
    over = threading.Event()

    class StreamHandler(BaseHTTPRequestHandler):
        """One client that is sent the images in turn, there and back."""

        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
            self.end_headers()
            while not over.is_set():
                for data in (*images, *reversed(images)):
                    head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
                    self.wfile.write(head.encode() + data + b"\r\n")
                    if over.wait(0.1):
                        return

        def log_message(self, format: str, *args: object) -> None:
            """Say nothing."""

    with HTTPServer(("127.0.0.1", 0), StreamHandler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_port}/video"
        finally:
            over.set()
            server.shutdown()


SOURCES: dict[str, Callable[[Path], AbstractContextManager[str]]] = {
    "photos": lambda folder: nullcontext(write_photos(folder)),
    "video.mp4": lambda folder: nullcontext(write_film(folder)),
    "http://192.168.0.5:8080/video": serve_stream,
    "run.mcap": lambda folder: nullcontext(write_mcap(folder)),
    "sim:spanner": lambda _: nullcontext("sim:spanner"),
}
"""What can be had without a device, by how it is named on the command line."""


def last_of_source(name: str) -> Drawn:
    """What is tracked in a source that is opened as every verb opens it."""
    with tempfile.TemporaryDirectory() as made, SOURCES[name](Path(made)) as spec, gt.open_source(spec) as source:
        return last_of_frames((np.asarray(frame.image), frame.time) for frame in source)


# --- the page -------------------------------------------------------------------------------------


def page_picture(shape: str) -> Drawn:
    """The live page in a browser, as it follows a scene; None where there is no browser."""
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        return None
    with tempfile.TemporaryDirectory() as made:
        folder = Path(made)
        (folder / "photos").mkdir()
        for k, image in enumerate(frame.image for frame in case_of(shape, "clean-6dof", 5, PAGE_IMAGES).scene()):
            cv2.imwrite(str(folder / "photos" / f"{k:03}.png"), image)
        source = gt.open_source(str(folder / "photos"), fps=PAGE_RATE)
        session = LiveSession(source, Settings(), folder / "run", at_once=True)
        server = PageServer(session)
        session.start()
        server.start()
        try:
            session.wait_for(lambda shown: shown.image >= PAGE_IMAGES // 2, PAGE_IMAGES / PAGE_RATE)
            asked = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
            asked += [f"--user-data-dir={folder}/profile", f"--screenshot={folder}/page.png"]
            asked += [f"--window-size={PAGE_SIZE[0]},{PAGE_SIZE[1]}", f"--virtual-time-budget={PAGE_WAIT_MS}"]
            subprocess.run([browser, *asked, server.url], capture_output=True, check=False)
        finally:
            server.stop()
            session.stop()
        found = cv2.imread(str(folder / "page.png"))
    if found is None:
        return None
    size = (PAGE_SHOWN, round(PAGE_SHOWN * found.shape[0] / found.shape[1]))
    return np.asarray(cv2.resize(found, size, interpolation=cv2.INTER_AREA), np.uint8), "grasptrack live photos --start"


# --- the pages ------------------------------------------------------------------------------------

SECTIONS: dict[str, dict[str, Callable[[], Drawn]]] = {
    "The live page": {"live": partial(page_picture, "hammer-head")},
    "Statuses": {status: partial(first_with_status, status) for status in STATUSES},
    "Strategies": {
        strategy: lambda strategy=strategy: last_of_frames(  # type: ignore[misc]
            from_suite("key", "clean-6dof").images, strategy=strategy
        )
        for strategy in (AUTO, *STRATEGIES, PAPER)
    },
    "Sources": {name: partial(last_of_source, name) for name in SOURCES},
}
"""What is shown: sections, names, and what makes the picture and its caption."""


def figure_of(name: str, picture: Picture, caption: str, folder: Path, quality: int) -> str:
    """Write a picture; its entry on the page, which lies beside the folder of images."""
    file = "".join(c if c.isalnum() else "-" for c in name.partition("://")[0].lower()) + ".webp"
    cv2.imwrite(str(folder / file), picture, [cv2.IMWRITE_WEBP_QUALITY, quality])
    text = escape(caption if caption.startswith(name) else f"{name}: {caption}")
    return f'<figure><img src="../images/gallery/{file}" alt="{text}" loading="lazy"><figcaption>{text}</figcaption></figure>'


def main() -> None:
    """Run the study."""
    parser = common.create_parser(__doc__)
    parser.add_argument("--sections", default=",".join(SECTIONS), help="sections to draw [all]")
    parser.add_argument("--quality", type=int, default=75, help="of WebP, 1 to 100 [75]")
    parser.add_argument("--pictures", type=Path, default=Path("gallery"), help="folder to write to [gallery]")
    asked = parser.parse_args()
    asked.pictures.mkdir(parents=True, exist_ok=True)
    common.begin_section("As the program draws them")
    for title in asked.sections.split(","):
        figures = []
        for name, draw in SECTIONS[title].items():
            found = draw()
            if found is None:
                print(f"{name}: no picture")
                continue
            figures.append(figure_of(name, *found, asked.pictures, asked.quality))
        common.add_paragraph("\n".join([f"### {title}\n", '<div class="gallery">', *figures, "</div>"]))
    common.write_sections(asked.output)


if __name__ == "__main__":
    main()

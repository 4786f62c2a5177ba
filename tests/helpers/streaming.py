# SPDX-License-Identifier: Apache-2.0
"""Servers on loopback that show a moving plate: MJPEG over HTTP, and video by UDP or RTSP; each can be cut."""

import socket
import socketserver
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction
from http.server import BaseHTTPRequestHandler

import av
import cv2
import numpy as np

from recordings import plate

RATE = 30


def shown(step: int) -> np.ndarray:
    """(H, W) the plate at a time."""
    phase = 0.05 * step
    return plate((160.0 + 12.0 * np.sin(phase), 118.0 + 8.0 * np.cos(phase)), 0.2 + 0.1 * np.sin(0.5 * phase))


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    with socket.socket(socket.AF_INET, kind) as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


class _Quiet(socketserver.ThreadingTCPServer):
    daemon_threads = True
    allow_reuse_address = True

    def handle_error(self, request: object, client_address: object) -> None:
        """Clients that go away are what is tested."""


@contextmanager
def serving(
    port: int, handler: type[socketserver.BaseRequestHandler], over: threading.Event
) -> Iterator[threading.Event]:
    """Answers on loopback until `over`, which ends every connection."""
    with _Quiet(("127.0.0.1", port), handler) as server:
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True).start()
        try:
            yield over
        finally:
            over.set()
            server.shutdown()


@contextmanager
def mjpeg_server(port: int, start: int = 0) -> Iterator[threading.Event]:
    """Serves a stream at /stream; the event, once set, ends every connection."""
    over = threading.Event()
    began = time.monotonic()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
            self.end_headers()
            while not over.is_set():
                step = start + int((time.monotonic() - began) * RATE)
                data = cv2.imencode(".jpg", shown(step), [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
                head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(data)}\r\n\r\n"
                self.wfile.write(head.encode() + data + b"\r\n")
                over.wait(1.0 / RATE)

        def log_message(self, format: str, *args: object) -> None:
            """Say nothing."""

    with serving(port, Handler, over):
        yield over


@contextmanager
def pushed_video(url: str, form: str, options: dict[str, str] | None = None) -> Iterator[None]:
    """Sends H.264 to an address, over and over, while nobody may listen yet."""
    over = threading.Event()

    def send() -> None:
        while not over.is_set():
            try:
                with av.open(url, "w", format=form, options=options or {}, timeout=2.0) as container:
                    _encode(container, over)
            except (av.FFmpegError, OSError):
                over.wait(0.05)

    thread = threading.Thread(target=send, daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join(5.0)


def _encode(container: av.container.OutputContainer, over: threading.Event) -> None:
    stream = container.add_stream("libx264", rate=RATE, options={"preset": "ultrafast", "tune": "zerolatency"})
    stream.width, stream.height, stream.pix_fmt = 320, 240, "yuv420p"
    stream.codec_context.gop_size = 10
    step = 0
    while not over.is_set():
        frame = av.VideoFrame.from_ndarray(cv2.cvtColor(shown(step), cv2.COLOR_GRAY2BGR), format="bgr24")
        frame.pts, frame.time_base = step, Fraction(1, RATE)
        container.mux(stream.encode(frame))
        step += 1
        over.wait(1.0 / RATE)

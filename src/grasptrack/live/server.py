# SPDX-License-Identifier: Apache-2.0
"""The page's server: files of the page, files of the run, and a WebSocket for each browser that looks on.

A browser is sent the newest moment alone, and the next one when it has drawn the one before: a slow one sees fewer
images, and the tracker never waits.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import secrets
import socket
import struct
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import AsyncIterator, Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.resources import files
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from grasptrack.errors import InputError
from grasptrack.live.commands import LARGEST, Keep, Press, Release, command_of, hold_command_of, parse_message
from grasptrack.live.frames import Painter
from grasptrack.live.guard import TAKEN_AT_ONCE, Door, Guard
from grasptrack.live.loop import SessionLoop
from grasptrack.live.servo_desk import ServoDesk
from grasptrack.live.state import CurvePoint, Shown

_SCRIPTS = ("app", "connection", "picture", "servo", "tools", "charts")
PAGE = {"index.html": "text/html", "style.css": "text/css", "icon.svg": "image/svg+xml"}
PAGE |= {f"{script}.js": "text/javascript" for script in _SCRIPTS}
TYPES = {".csv": "text/csv", ".json": "application/json", ".mp4": "video/mp4", ".png": "image/png"}
MOST_CLIENTS = 16
AHEAD = 2
"""Messages that a browser may not have drawn yet when it is sent the next."""
LEAST_GAP = 0.03
"""s between two messages: a camera's 30 images/s are all shown, and of a file's 500 no more than an eye follows."""
CHUNK = 1 << 16
ELSEWHERE = "192.0.2.1"
"""An address of no machine, kept for documents."""
ADDRESS_OF = 0x8915
"""Linux's SIOCGIFADDR; elsewhere it fails."""
FORGIVEN = 100
"""Messages of one browser that may be malformed before it is sent away."""
ASKED_EVERY = 0.04
"""s between two questions whether the button is still held."""
GONE = "the page that held the button was closed, or its connection is lost"
RELEASED = {
    "released": "the button was let go of",
    "blur": "the page that held the button lost the focus",
    "hidden": "the page that held the button was hidden",
}
"""What a page says of why."""


class PageServer:
    """Serves a session's page in a thread of its own.

    Args:
        session: that is shown.
        host: address to bind.
        port: 0 takes a free one.
        token: that requests have to know; None makes one.
        name: under which others reach this machine, for `urls`; None takes its addresses.
        listener: what `bind_socket` gave for this address, where it was to be known to be free before the session.

    Attributes:
        urls: under which the page can be reached, with the token; `url` is the first of them.
        hub: its `round_trips` are s from when an image came out of its source until a browser said that it is drawn.
    """

    def __init__(
        self,
        session: SessionLoop,
        host: str = "127.0.0.1",
        port: int = 0,
        token: str | None = None,
        name: str | None = None,
        listener: Door | None = None,
    ) -> None:
        self._socket = bind_socket(host, port) if listener is None else listener
        self.port: int = self._socket.getsockname()[1]
        self.token = secrets.token_urlsafe(24) if token is None else token
        self._socket.token = self.token
        self.hub = Hub(session)
        app = Guard(make_application(session, self.hub), self.token, self._socket.let_in)

        async def sweep() -> None:
            self._socket.sweep()

        config = uvicorn.Config(
            app,
            lifespan="off",
            log_config=None,
            log_level="critical",
            access_log=False,
            server_header=False,
            ws_max_size=LARGEST,
            ws_per_message_deflate=False,
            proxy_headers=False,  # the connection is known by its own address
            loop="asyncio",  # others accept without asking the door
            backlog=TAKEN_AT_ONCE,
            timeout_graceful_shutdown=1,
            callback_notify=sweep,
            timeout_notify=1,
        )
        self._server = uvicorn.Server(config)
        sockets: list[socket.socket] = [self._socket]
        self._thread = threading.Thread(target=self._server.run, args=(sockets,), name="grasptrack-page", daemon=True)
        names = (name,) if name else reached_at(host, self._socket.getsockname()[0])
        shown = (f"[{each}]" if ":" in each else each for each in names)
        self.urls = [f"http://{each}:{self.port}/?token={self.token}" for each in shown]
        self.url = self.urls[0]

    def start(self) -> None:
        """Begin to serve, and wait until it does."""
        self._thread.start()
        until = time.monotonic() + 10.0
        while not self._server.started and self._thread.is_alive() and time.monotonic() < until:
            time.sleep(0.01)

    def stop(self) -> None:
        """Close all connections; may be called again."""
        self._server.should_exit = True
        if self._thread.ident is not None:
            self._thread.join(5.0)
        self.hub.close()
        self._socket.close()


class Hub:
    """Wakes browsers' senders when there is something new, and costs nothing where nobody looks on."""

    def __init__(self, session: SessionLoop) -> None:
        self.session = session
        self.clients = 0
        self.round_trips: deque[float] = deque(maxlen=4096)
        self._painter = Painter()
        self._encoder = ThreadPoolExecutor(1, "grasptrack-encoder")
        self._loop: asyncio.AbstractEventLoop | None = None
        self._waiting: set[asyncio.Event] = set()
        self._unlisten: Callable[[], None] | None = None

    def add_client(self) -> bool:
        """A browser comes; False where there are too many."""
        if self.clients >= MOST_CLIENTS:
            return False
        self.clients += 1
        if self._unlisten is None:
            self._loop = asyncio.get_running_loop()
            self._unlisten = self.session.add_listener(self._on_moment)
        return True

    def remove_client(self) -> None:
        """A browser goes."""
        self.clients -= 1
        if not self.clients and self._unlisten is not None:
            self._unlisten()
            self._unlisten = None

    async def next_moment(self, after: int) -> Shown:
        """The newest moment, once it is not that of a number."""
        while self.session.shown.number == after:
            event = asyncio.Event()
            self._waiting.add(event)
            try:
                if self.session.shown.number == after:  # what came between is not missed
                    with contextlib.suppress(asyncio.TimeoutError):
                        await asyncio.wait_for(event.wait(), 1.0)
            finally:
                self._waiting.discard(event)
        return self.session.shown

    async def encode_message(self, shown: Shown, has: int, curves: Sequence[CurvePoint]) -> bytes:
        """What a browser is sent; made off the tracker's thread and off the server's."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._encoder, self._painter.message_for, shown, has, curves)

    def close(self) -> None:
        """Encode no more."""
        self._encoder.shutdown(cancel_futures=True)

    def _on_moment(self, shown: Shown) -> None:
        """In the session's thread: wake who waits, if anybody does."""
        if self._waiting and self._loop is not None:
            with contextlib.suppress(RuntimeError):  # the server has ended
                self._loop.call_soon_threadsafe(self._wake_clients)

    def _wake_clients(self) -> None:
        for event in self._waiting:
            event.set()


def make_application(session: SessionLoop, hub: Hub) -> Starlette:
    """The page, the run's files and the WebSocket, unguarded."""
    parts = {name: (files("grasptrack.live") / "page" / name).read_bytes() for name in PAGE}

    async def send_page(request: Request) -> Response:
        name = request.path_params.get("name", "index.html")
        if name not in parts:
            raise HTTPException(404)
        return Response(parts[name], media_type=PAGE[name])

    async def run_file(request: Request) -> Response:
        name = request.path_params["name"]
        path = session.written_file(name)
        if path is None:
            raise HTTPException(404)
        return _file_response(path)

    async def serve_socket(socket: WebSocket) -> None:
        await socket.accept()
        if not hub.add_client():
            await socket.close(1013, "too many pages look on")
            return
        try:
            await Conversation(socket, session, hub).run_both()
        finally:
            hub.remove_client()

    async def refuse_request(request: Request, error: Exception) -> Response:
        status = error.status_code if isinstance(error, HTTPException) else 500
        line = {404: "there is no such page", 405: "pages are only read"}.get(status, "this request cannot be answered")
        return PlainTextResponse(line + "\n", status)

    async def serve_hold(socket: WebSocket) -> None:
        await socket.accept()
        if session.servo is None:
            await socket.close(1008, "there is no servo")
            return
        await Holding(socket, session.servo).run_both()

    routes = [
        Route("/", send_page),
        Route("/page/{name}", send_page),
        Route("/files/{name}", run_file),
        WebSocketRoute("/socket", serve_socket),
        WebSocketRoute("/hold", serve_hold),
    ]
    return Starlette(routes=routes, exception_handlers={HTTPException: refuse_request, Exception: refuse_request})


class Talk(ABC):
    """One browser at a WebSocket: something is sent, and messages come in."""

    def __init__(self, socket: WebSocket) -> None:
        self._socket = socket
        self._malformed = 0

    async def run_both(self) -> None:
        """Until one side ends it."""
        tasks = [asyncio.create_task(self._send_messages()), asyncio.create_task(self._receive_messages())]
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    @abstractmethod
    async def _send_messages(self) -> None:
        """For ever."""

    @abstractmethod
    def _obey_message(self, content: dict[str, Any]) -> None:
        """What came; an InputError is told."""

    async def _receive_messages(self) -> None:
        with contextlib.suppress(WebSocketDisconnect):
            while True:
                message = await self._socket.receive()
                if message["type"] == "websocket.disconnect":
                    return
                text = message.get("text")
                try:
                    self._obey_message(parse_message(text if text is not None else message.get("bytes") or b""))
                except InputError as error:
                    self._malformed += 1
                    if self._malformed > FORGIVEN:
                        await self._socket.close(1008, "too many malformed messages")
                        return
                    await self._socket.send_text(json.dumps({"error": str(error)}))


class Conversation(Talk):
    """The newest moments go out, commands come in."""

    def __init__(self, socket: WebSocket, session: SessionLoop, hub: Hub) -> None:
        super().__init__(socket)
        self._session, self._hub = session, hub
        self._sent: dict[int, Shown | None] = {}  # what is not drawn yet; None where the image is an old one
        self._drawn = asyncio.Event()

    async def _send_messages(self) -> None:
        number, image, charted = 0, 0, 0
        session = self._session
        hello = {"hover": session.can_hover, "source": session.source_name, "servo": session.servo is not None}
        hello["parts"] = session.has_parts
        await self._socket.send_text(json.dumps({"hello": hello}))
        while True:
            shown = await self._hub.next_moment(number)
            charted, curves = self._session.curves.points_since(charted)
            message = await self._hub.encode_message(shown, image, curves)
            self._sent[shown.number] = shown if shown.image != image else None
            number, image = shown.number, shown.image
            self._drawn.clear()
            began = time.monotonic()
            await self._socket.send_bytes(message)
            await asyncio.sleep(max(LEAST_GAP - (time.monotonic() - began), 0.0))
            while len(self._sent) >= AHEAD:
                await self._drawn.wait()
                self._drawn.clear()

    def _obey_message(self, content: dict[str, Any]) -> None:
        if content.get("do") == "drawn":
            self._on_drawn(content.get("number"))
            return
        self._session.send_command(command_of(content))

    def _on_drawn(self, number: Any) -> None:
        if isinstance(number, bool) or not isinstance(number, int):
            raise InputError("drawn.number is the number of the moment")
        if number not in self._sent:
            return
        shown = self._sent[number]
        self._sent = {other: s for other, s in self._sent.items() if other > number}
        self._drawn.set()
        if shown is not None and shown.arrival is not None:
            self._hub.round_trips.append(time.perf_counter() - shown.arrival.at)


class Holding(Talk):
    """A page's button that lets the arm move: while it is held the page is asked, again and again, whether it still is.

    What counts is when a question was sent whose answer has come: a late network cannot make a button that was let go of look
    held for longer.
    """

    def __init__(self, socket: WebSocket, desk: ServoDesk) -> None:
        super().__init__(socket)
        self._desk = desk
        self._asked: dict[int, float] = {}
        self._pressed = asyncio.Event()

    async def run_both(self) -> None:
        """Until it ends, and with it what is held."""
        try:
            await super().run_both()
        finally:
            self._desk.switch.let_go(GONE, self)

    async def _send_messages(self) -> None:
        number = 0
        while True:
            await self._pressed.wait()
            while self._desk.switch.holder is self:
                number += 1
                self._asked[number] = time.perf_counter()
                await self._socket.send_text(json.dumps({"held": number}))
                await asyncio.sleep(ASKED_EVERY)
            self._pressed.clear()
            self._asked.clear()
            await self._socket.send_text(json.dumps({"held": 0}))

    def _obey_message(self, content: dict[str, Any]) -> None:
        match hold_command_of(content):
            case Press():
                self._desk.press_switch(self)
                self._pressed.set()
            case Keep(number):
                if number in self._asked:
                    self._desk.keep_held(self, self._asked[number])
                    self._asked = {other: at for other, at in self._asked.items() if other > number}
            case Release(why):
                self._desk.switch.let_go(RELEASED[why], self)


def bind_socket(host: str, port: int) -> Door:
    """A socket that listens."""
    try:
        family, kind, proto, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listener = Door(family, kind, proto)
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen()
    except (OSError, OverflowError, UnicodeError) as error:
        why = getattr(error, "strerror", None) or str(error)
        raise InputError(
            f"the page cannot be served at {host}, port {port}: {why}; choose others with --host and --port",
            host=host,
            port=port,
        ) from None
    return listener


def reached_at(host: str, bound: str) -> list[str]:
    """Addresses of this machine at which a socket that is bound to one, or to all of them, is reached; the likeliest first."""
    if bound not in ("0.0.0.0", "::"):
        return [host]
    found = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        with contextlib.suppress(OSError):
            asking.connect((ELSEWHERE, 9))  # sends nothing: the system says from where it would
            found.append(asking.getsockname()[0])
        with contextlib.suppress(ImportError, OSError):
            import fcntl

            for _, interface in socket.if_nameindex():
                with contextlib.suppress(OSError):
                    told = fcntl.ioctl(asking.fileno(), ADDRESS_OF, struct.pack("256s", interface.encode()[:15]))
                    found.append(socket.inet_ntoa(told[20:24]))
    return [each for each in dict.fromkeys(found) if not each.startswith("127.")] or ["127.0.0.1"]


def _file_response(path: Path) -> Response:
    """A file as it is now: one that grows, as grasps.csv does, is cut where it ends at this moment."""
    size = path.stat().st_size

    async def pieces() -> AsyncIterator[bytes]:
        left = size
        with path.open("rb") as stream:
            while left > 0 and (piece := stream.read(min(CHUNK, left))):
                left -= len(piece)
                yield piece

    headers = {"content-length": str(size), "content-disposition": f'attachment; filename="{path.name}"'}
    return StreamingResponse(pieces(), headers=headers, media_type=TYPES.get(path.suffix, "application/octet-stream"))

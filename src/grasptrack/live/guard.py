# SPDX-License-Identifier: Apache-2.0
"""Who may talk to the page: who has the token, no other site's scripts on anybody's behalf, and no more than have room."""

from __future__ import annotations

import errno
import hmac
import re
import socket
import time
from collections import Counter
from collections.abc import Awaitable, Callable, MutableMapping
from contextlib import suppress
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]
Address = tuple[str, int]

HEADERS = (
    (
        b"content-security-policy",
        b"default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; connect-src 'self'; "
        b"base-uri 'none'; form-action 'none'; frame-ancestors 'self' http://localhost:* http://127.0.0.1:*",
    ),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
)
"""With every answer. Notebooks on the same machine may show the page in a frame."""
MOST_CONNECTIONS = 256
SHARE = 4
"""The run keeps all but one in so many of the descriptors that a process may have."""
QUEUE = 4096
"""Connections that may wait in the kernel, where it allows so many: one that it drops comes again only after a second."""
TAKEN_AT_ONCE = 8
"""Connections that are taken before it is looked again what those have sent that are there."""
REFUSED_AT_ONCE = 256
PEEKED = 1 << 14
"""Bytes of a request's start, in which its address and cookies are."""
PATIENCE = 10.0
"""s within which a connection shows the token."""
SWEPT_AFTER = 0.005
"""s for which it is not looked again what is closed: to look costs as much as to accept."""
PAUSE = 0.05
"""s in which nothing is taken where the process has no descriptor left."""
_NO_ROOM = (errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM)


class Door(socket.socket):
    """A listening socket that leaves descriptors to the run, and places to who knows the token.

    Who has not shown it is a stranger. Where all places are taken, of the strangers at the address that has most the first
    goes for who comes, and each goes after a while: showing the token takes a moment, and whoever keeps connections open
    without it keeps nobody out.

    Attributes:
        token: by which, while all places are taken, requests are told from a flood of others before anybody reads them.
    """

    token = ""

    def __init__(self, *kind: int) -> None:
        super().__init__(*kind)
        self._open: dict[Address, socket.socket] = {}
        self._strangers: dict[Address, float] = {}  # when each came, the first one first
        self._swept = 0.0
        self._most = min(MOST_CONNECTIONS, _most_descriptors() // SHARE)

    def listen(self, backlog: int = 0) -> None:
        """Let connections wait; who serves asks for as many as are to be taken at once."""
        super().listen(QUEUE)

    def accept(self) -> tuple[socket.socket, Any]:
        """The next connection that there is a place for."""
        if time.monotonic() > self._swept + SWEPT_AFTER:
            self.sweep()
        for _ in range(REFUSED_AT_ONCE):
            try:
                link, address = super().accept()
            except OSError as error:
                if error.errno not in _NO_ROOM:
                    raise
                self.sweep(0.0)
                time.sleep(PAUSE)  # else it would be asked for again at once, and in vain
                break
            if len(self._open) >= self._most:
                if not self._strangers or len(self._open) >= 2 * self._most or self._is_refused(link):
                    link.close()
                    continue
                crowd = Counter(host for host, _ in self._strangers).most_common(1)[0][0]
                # it is open for a moment still
                self._send_away(next(each for each in self._strangers if each[0] == crowd))
            key = str(address[0]), int(address[1])
            self._open[key], self._strangers[key] = link, time.monotonic()
            return link, address
        raise BlockingIOError

    def _is_refused(self, link: socket.socket) -> bool:
        """Whether a request has come that does not hold the token."""
        link.setblocking(False)
        try:
            return self.token.encode() not in link.recv(PEEKED, socket.MSG_PEEK)
        except BlockingIOError:
            return False
        except OSError:
            return True

    def let_in(self, address: Address) -> None:
        """Who has a connection has shown the token."""
        self._strangers.pop(address, None)

    def sweep(self, patience: float | None = None) -> None:
        """Send strangers away that came so many s ago, PATIENCE if not told, and forget what is closed."""
        self._swept = time.monotonic()
        self._open = {address: link for address, link in self._open.items() if link.fileno() >= 0}
        due = self._swept - (PATIENCE if patience is None else patience)
        for address, came in list(self._strangers.items()):
            if came <= due or address not in self._open:
                self._send_away(address)

    def _send_away(self, address: Address) -> None:
        """The server reads the end of it, and closes it."""
        del self._strangers[address]
        if address in self._open:
            with suppress(OSError):
                self._open[address].shutdown(socket.SHUT_RDWR)


def _most_descriptors() -> int:
    """Descriptors that this process may have."""
    try:
        import resource
    except ImportError:  # as on Windows
        return SHARE * MOST_CONNECTIONS
    most = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    return SHARE * MOST_CONNECTIONS if most == resource.RLIM_INFINITY else most


class Guard:
    """Lets requests through to an application, or refuses them with one line.

    The token is compared in constant time. It alone says who is let in, under whatever name and port the page is reached, as
    through a tunnel: a site whose name is made to lead here (DNS rebinding) has none. Origin is checked, so that no
    other site can use what the browser knows.

    Args:
        app: the application.
        token: that every request has to know, in the query or in the cookie that the page then sets.
        let_in: called with the address of who has shown it.
    """

    def __init__(self, app: App, token: str, let_in: Callable[[Address], None]) -> None:
        self._app, self._token, self._let_in = app, token, let_in

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request or WebSocket."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {key.lower(): value.decode("latin-1") for key, value in scope["headers"]}
        has_cookie = self._has_cookie(headers)
        if has_cookie or self._is_token(
            parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[-1]
        ):
            self._let_in(scope["client"])
        else:
            await _send_refusal(
                scope, receive, send, "the token is missing or wrong: use the address that grasptrack live printed"
            )
            return
        origin = headers.get(b"origin")
        if origin is not None and not _same_origin(origin, headers.get(b"host", "")):
            await _send_refusal(scope, receive, send, "another site may not use this page")
            return

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                extra = list(HEADERS)
                if not has_cookie:
                    text = f"{cookie_name(headers)}={self._token}; HttpOnly; SameSite=Strict; Path=/"
                    extra.append((b"set-cookie", text.encode("ascii")))
                message = {**message, "headers": [*message.get("headers", []), *extra]}
            await send(message)

        await self._app(scope, receive, send_guarded)

    def _is_token(self, given: str) -> bool:
        return hmac.compare_digest(given.encode("utf-8", "replace"), self._token.encode())

    def _has_cookie(self, headers: dict[bytes, str]) -> bool:
        try:
            found = SimpleCookie(headers.get(b"cookie", "")).get(cookie_name(headers))
        except CookieError:
            return False
        return found is not None and self._is_token(found.value)


def cookie_name(headers: dict[bytes, str]) -> str:
    """Name of the cookie: of the port that the browser sees, for browsers give one port's cookies to another one."""
    match = re.search(r":(\d{1,5})$", headers.get(b"host", ""), re.ASCII)
    return f"grasptrack-{match[1] if match else 80}"


def _same_origin(origin: str, host: str) -> bool:
    try:
        parts = urlsplit(origin)
    except ValueError:
        return False
    return parts.scheme in ("http", "https") and parts.netloc.lower() == host.lower()


async def _send_refusal(scope: Scope, receive: Receive, send: Send, line: str) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008, "reason": line})
        return
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"connection", b"close"), *HEADERS]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": f"{line}\n".encode()})

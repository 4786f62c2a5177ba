# SPDX-License-Identifier: Apache-2.0
"""Who may talk to the page: the machine itself, or who has the token; and no other site's scripts on anybody's behalf."""

from __future__ import annotations

import hmac
import ipaddress
import re
import socket
from collections.abc import Awaitable, Callable, MutableMapping
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

LOOPBACK = ("127.0.0.1", "::1", "localhost")
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


class Guard:
    """Lets requests through to an application, or refuses them with one line.

    Host is checked, so that a site whose name is made to lead here (DNS rebinding) cannot read the page; Origin is
    checked, so that no other site can open the WebSocket; the token is compared in constant time.

    Args:
        app: the application.
        host: address that the server is bound to.
        port: its port.
        token: that every request has to know, in the query or in the cookie that the page then sets; None asks for none.
    """

    def __init__(self, app: App, host: str, port: int, token: str | None) -> None:
        self._app, self._host, self._port, self._token = app, host, port, token
        self.cookie = f"grasptrack-{port}"

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request or WebSocket."""
        if scope["type"] not in ("http", "websocket"):
            await self._app(scope, receive, send)
            return
        headers = {key.lower(): value.decode("latin-1") for key, value in scope["headers"]}
        refusal = self._refusal_reason(scope, headers)
        if refusal:
            await _send_refusal(scope, receive, send, refusal)
            return
        sets_cookie = self._token is not None and not self._has_cookie(headers)

        async def send_guarded(message: Message) -> None:
            if message["type"] == "http.response.start":
                extra = list(HEADERS)
                if sets_cookie:
                    text = f"{self.cookie}={self._token}; HttpOnly; SameSite=Strict; Path=/"
                    extra.append((b"set-cookie", text.encode("ascii")))
                message = {**message, "headers": [*message.get("headers", []), *extra]}
            await send(message)

        await self._app(scope, receive, send_guarded)

    def _refusal_reason(self, scope: Scope, headers: dict[bytes, str]) -> str:
        """Why a request is refused, in one line; empty where it is not."""
        host = headers.get(b"host", "")
        if not self._knows_host(host):
            return "this page is not served under that name: use the address that grasptrack live printed"
        origin = headers.get(b"origin")
        if origin is not None and not _same_origin(origin, host):
            return "another site may not use this page"
        if self._token is None or self._has_cookie(headers):
            return ""
        given = parse_qs(scope.get("query_string", b"").decode("latin-1")).get("token", [""])[-1]
        return (
            ""
            if self._is_token(given)
            else "the token is missing or wrong: use the address that grasptrack live printed"
        )

    def _knows_host(self, text: str) -> bool:
        """Whether a Host header names this server."""
        match = re.fullmatch(r"(\[[0-9A-Fa-f:.%]+\]|[^:\[\]/@\s]+)(?::(\d{1,5}))?", text)
        if match is None or int(match[2] or 80) != self._port:
            return False
        name = match[1].strip("[]").lower()
        if name in LOOPBACK or name == self._host.lower():
            return True
        if self._token is None:
            return False
        return _is_address(name) or name in (socket.gethostname().lower(), socket.getfqdn().lower())

    def _is_token(self, given: str) -> bool:
        return self._token is not None and hmac.compare_digest(given.encode("utf-8", "replace"), self._token.encode())

    def _has_cookie(self, headers: dict[bytes, str]) -> bool:
        try:
            found = SimpleCookie(headers.get(b"cookie", "")).get(self.cookie)
        except CookieError:
            return False
        return found is not None and self._is_token(found.value)


def _same_origin(origin: str, host: str) -> bool:
    try:
        parts = urlsplit(origin)
    except ValueError:
        return False
    return parts.scheme in ("http", "https") and parts.netloc.lower() == host.lower()


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


async def _send_refusal(scope: Scope, receive: Receive, send: Send, line: str) -> None:
    if scope["type"] == "websocket":
        await receive()
        await send({"type": "websocket.close", "code": 1008, "reason": line})
        return
    headers = [(b"content-type", b"text/plain; charset=utf-8"), *HEADERS]
    await send({"type": "http.response.start", "status": 403, "headers": headers})
    await send({"type": "http.response.body", "body": f"{line}\n".encode()})

"""Access control: only requests to this host, from its own pages, with the token in their path, reach the server.

The loopback address alone protects nothing: other sites can make a browser send requests here, and can let a name of theirs
resolve to 127.0.0.1 (DNS rebinding). So the Host header must be ours, an Origin header too, and a WebSocket must have one.
"""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

NAMES = ("127.0.0.1", "localhost")
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


def new_token() -> str:
    return secrets.token_urlsafe(24)


class AccessMiddleware:
    """ASGI middleware: the application gets only requests below `/<token>/`, without the token in their path."""

    def __init__(self, app: App, port: int, token: str) -> None:
        self._app = app
        self._prefix = f"/{token}"
        self._hosts = {f"{name}:{port}" for name in NAMES}
        self._origins = {f"http://{host}" for host in self._hosts}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] not in ("http", "websocket"):
            return await self._app(scope, receive, send)
        refused = self.refusal(scope)
        if refused is None:
            inner = {**scope, "path": scope["path"][len(self._prefix) :]}
            return await self._app(inner, receive, send)
        if scope["type"] == "websocket":
            return await send({"type": "websocket.close", "code": 1008, "reason": refused})
        body = f"403: {refused}\n".encode()
        headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(body)).encode())]
        await send({"type": "http.response.start", "status": 403, "headers": headers})
        await send({"type": "http.response.body", "body": body})

    def refusal(self, scope: Scope) -> str | None:
        """Why a request is refused; None for one that is allowed."""
        headers = [(key.lower(), value.decode("latin-1")) for key, value in scope["headers"]]
        hosts = [value for key, value in headers if key == b"host"]
        origins = [value for key, value in headers if key == b"origin"]
        if len(hosts) != 1 or hosts[0] not in self._hosts:
            return "this server answers requests to the local host only"
        if len(origins) > 1 or not set(origins) <= self._origins or (scope["type"] == "websocket" and not origins):
            return "this server answers its own pages only"
        prefix = scope["path"][: len(self._prefix)].encode()
        known = secrets.compare_digest(prefix, self._prefix.encode())
        if not known or scope["path"][len(self._prefix) :][:1] != "/":
            return "open the address that raybench view printed: it holds the token"
        return None

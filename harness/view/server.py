"""The server of `raybench view`. It binds to the loopback address and answers its own pages only (see `middleware`)."""

from __future__ import annotations

import asyncio
import contextlib
import re
import socket
import uuid
import webbrowser
from collections.abc import AsyncIterator
from importlib.resources import files
from pathlib import Path

import uvicorn
from markupsafe import escape
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import FileResponse, PlainTextResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket

from engines.errors import ConfigError, UnknownName
from engines.registry import engine_names
from harness.view.library import Library
from harness.view.messages import MAX_REQUEST_BYTES, error_message
from harness.view.middleware import HEADERS, AccessMiddleware, new_token
from harness.view.options import ViewOptions
from harness.view.render_slots import MAX_TABS, RenderSlots
from harness.view.session import Session
from harness.view.worker_pool import WorkerPool

PAGES = ("view", "race", "dahlquist")
TYPES = {".html": "text/html", ".js": "text/javascript", ".css": "text/css"}
REPORT_ASSETS = ("report.css", "theme.js", "colours.js", "decode.js")
REPORT_POLICY = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data:"
)
"""A report is a self-contained file: its scripts may run, but not send requests to this server."""
PING_SECONDS = 20.0


class Server:
    """The pages, sockets and workers of one `raybench view`."""

    def __init__(self, options: ViewOptions) -> None:
        self._options = options
        self.library = Library(options.folder)
        self._scene = self.library.name_of(options.scene)
        self._workers, self._slots = WorkerPool(options.allow_imports), RenderSlots()
        self._tabs: set[Session] = set()
        self._assets = _assets()

    def app(self) -> Starlette:
        routes = [
            Route("/", self._page),
            Route("/{name}", self._page),
            Route("/reports/{name}/report.html", self._report),
            WebSocketRoute("/socket/{page}", self._socket),
        ]
        return Starlette(routes=routes, lifespan=self._lifespan)

    @contextlib.asynccontextmanager
    async def _lifespan(self, app: Starlette) -> AsyncIterator[None]:
        self._workers.prepare()
        yield
        await self._workers.close()

    async def _page(self, request: Request) -> Response:
        """A page or an asset, from a table: no path of a request reaches the file system."""
        name = request.path_params.get("name", "view.html")
        if name not in self._assets:
            return PlainTextResponse("404: no such page\n", 404, HEADERS)
        body, kind = self._assets[name]
        if kind == "text/html":
            for key, value in (("scene", self._scene), ("engine", self._options.engine)):
                body = body.replace(f'data-{key}=""'.encode(), f'data-{key}="{escape(value)}"'.encode())
        return Response(body, media_type=kind, headers=HEADERS)

    async def _report(self, request: Request) -> Response:
        """The report of a saved race."""
        name = request.path_params["name"]
        path = self.library.folder / "results" / name / "report.html"
        if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*", name) or not path.is_file():
            return PlainTextResponse("404: no such report\n", 404, HEADERS)
        if not path.resolve().is_relative_to(self.library.folder):
            return PlainTextResponse("403: the report is outside the folder\n", 403, HEADERS)
        return FileResponse(path, media_type="text/html", headers={**HEADERS, "Content-Security-Policy": REPORT_POLICY})

    async def _socket(self, websocket: WebSocket) -> None:
        """Serves the socket of a tab until it closes."""
        page = websocket.path_params["page"]
        if page not in PAGES:
            await websocket.close(1008)
            return
        await websocket.accept()
        if len(self._tabs) >= MAX_TABS:
            await websocket.send_bytes(error_message(f"{MAX_TABS} pages are already open: close one and reload this one"))
            await websocket.close(1013)
            return
        scratch = str(self.library.folder / "results" / f".race-{uuid.uuid4().hex[:12]}") if page == "race" else None
        begin = {
            "type": "begin",
            "page": page,
            "folder": str(self.library.folder),
            "allow_imports": self._options.allow_imports,
            "allow_outside": self._options.allow_outside,
            "parameters": {self._scene: dict(self._options.parameters)},
            "scratch": scratch,
        }
        session = Session(websocket, self._workers, self._slots, begin)
        self._tabs.add(session)
        try:
            await session.run()
        finally:
            self._tabs.discard(session)


def _assets() -> dict[str, tuple[bytes, str]]:
    """Name -> (bytes, media type) of the pages and their assets."""
    assets = {}
    for item in files("harness.view").joinpath("page").iterdir():
        if (suffix := Path(item.name).suffix) in TYPES:
            assets[item.name] = item.read_bytes(), TYPES[suffix]
    for name in REPORT_ASSETS:
        assets[name] = files("harness.report.html").joinpath(name).read_bytes(), TYPES[Path(name).suffix]
    return assets


def serve(options: ViewOptions) -> None:
    """Serves until interrupted. Raises `ConfigError` for a missing folder or scene, and for a port in use."""
    if not options.folder.is_dir():
        raise ConfigError(f"--folder {options.folder}: is not a folder")
    if options.engine and options.engine not in engine_names():
        raise UnknownName("engine", options.engine, engine_names())
    if options.parameters and not options.scene.endswith(".xml"):
        raise ConfigError(f"{options.scene}: parameters (-D) are for Mitsuba's XML files")
    server = Server(options)
    listening = socket.socket()
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind(("127.0.0.1", options.port))
        listening.listen(128)  # a browser that connects before the server runs waits
    except (OSError, OverflowError) as error:
        raise ConfigError(f"--port {options.port}: {getattr(error, 'strerror', None) or error}") from error
    port, token = listening.getsockname()[1], new_token()
    config = uvicorn.Config(
        AccessMiddleware(server.app(), port, token),
        log_level="warning",
        ws="websockets-sansio",
        ws_max_size=MAX_REQUEST_BYTES,
        ws_ping_interval=PING_SECONDS,
        ws_per_message_deflate=False,
        server_header=False,
        access_log=False,
        timeout_graceful_shutdown=1,
    )
    address = f"http://127.0.0.1:{port}/{token}/"
    print(f"raybench view: {address} (Ctrl-C ends it)", flush=True)
    if options.browser:
        webbrowser.open(address)
    with contextlib.suppress(KeyboardInterrupt):
        asyncio.run(uvicorn.Server(config).serve(sockets=[listening]))

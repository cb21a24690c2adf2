"""Worker processes, as the server sees them: one per tab, and a started one in reserve for the next tab."""

from __future__ import annotations

import asyncio
import contextlib
import json
import sys
from collections.abc import Mapping
from typing import Any

from engines.processes import BadMessage, Process, channel
from harness.processes import worker_environment
from harness.view.messages import header_of

STREAM_LIMIT = 1 << 23


class Worker:
    """A process that renders for one tab."""

    def __init__(self, process: Process, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._process, self._from, self._to = process, reader, writer

    @classmethod
    async def start(cls, allow_imports: bool) -> Worker:
        """Starts a worker and waits for its imports."""
        process = Process("harness.view.worker:main", environment=worker_environment(allow_imports))
        streams = await asyncio.open_connection(sock=process.channels[0].socket, limit=STREAM_LIMIT)
        made = cls(process, *streams)
        try:
            first = await made.receive()
        except BaseException:
            made.kill()
            raise
        if first is None or header_of(first)["type"] != "ready":
            made.kill()
            raise RuntimeError("a worker did not start")
        return made

    async def send(self, request: Mapping[str, Any]) -> None:
        """Sends a request. `receive` notices a worker that has ended."""
        with contextlib.suppress(ConnectionError):
            self._to.write(channel.framed(json.dumps(request).encode()))
            await self._to.drain()

    async def receive(self) -> bytes | None:
        """The next message; None where the process has ended, or is of no more use."""
        try:
            _, size = channel.sizes(await self._from.readexactly(channel.HEAD.size))
            return await self._from.readexactly(size)
        except (asyncio.IncompleteReadError, ConnectionError):
            return None
        except BadMessage as error:
            print(f"raybench view: a worker was killed: {error}", file=sys.stderr)
            self.kill()
            return None

    async def ended(self) -> str:
        """How the process ended, as a phrase."""
        ending = await asyncio.to_thread(self._process.ended)
        self.kill()
        return ending

    def kill(self) -> None:
        """Kills the process and its children; does nothing where it has ended."""
        self._process.kill(wait=False)
        self._to.transport.abort()
        asyncio.get_running_loop().run_in_executor(None, self._process.kill)


class WorkerPool:
    """Hands out workers and keeps one started in reserve."""

    def __init__(self, allow_imports: bool) -> None:
        self._allow_imports = allow_imports
        self._spare: asyncio.Task[Worker] | None = None

    def prepare(self) -> None:
        """Starts the reserve worker, if there is none."""
        if self._spare is None:
            self._spare = asyncio.create_task(Worker.start(self._allow_imports))

    async def take(self) -> Worker:
        """The reserve worker; starts the next one."""
        self.prepare()
        assert self._spare is not None
        spare, self._spare = self._spare, None
        try:
            return await spare
        finally:
            self.prepare()

    async def close(self) -> None:
        """Kills the reserve worker."""
        if self._spare is not None:
            self._spare.cancel()
            with contextlib.suppress(asyncio.CancelledError, Exception):
                (await self._spare).kill()

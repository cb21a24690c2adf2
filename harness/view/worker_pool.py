"""Worker processes, as the server sees them: one per tab, and a started one in reserve for the next tab."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sys
from collections.abc import Mapping
from typing import Any

from harness.processes import worker_environment
from harness.view.messages import header_of

STREAM_LIMIT = 1 << 23


class Worker:
    """A process that renders for one tab."""

    def __init__(self, process: asyncio.subprocess.Process) -> None:
        self._process = process
        assert process.stdin is not None and process.stdout is not None
        self._to, self._from = process.stdin, process.stdout

    @classmethod
    async def start(cls, allow_imports: bool) -> Worker:
        """Starts a worker and waits for its imports."""
        process = await asyncio.create_subprocess_exec(
            sys.executable,
            "-P",
            "-m",
            "harness.view.worker",
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            env=worker_environment(allow_imports),
            start_new_session=True,
            limit=STREAM_LIMIT,
        )
        made = cls(process)
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
        data = json.dumps(request).encode()
        with contextlib.suppress(ConnectionError):
            self._to.write(len(data).to_bytes(4, "little") + data)
            await self._to.drain()

    async def receive(self) -> bytes | None:
        """The next message; None where the process has ended."""
        try:
            length = int.from_bytes(await self._from.readexactly(4), "little")
            return await self._from.readexactly(length)
        except (asyncio.IncompleteReadError, ConnectionError):
            return None

    async def ended(self) -> str:
        """How the process ended, as a phrase."""
        status = await self._process.wait()
        return f"was killed by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"

    def kill(self) -> None:
        """Kills the process and its children; does nothing where it has ended."""
        if self._process.returncode is None:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, signal.SIGKILL)


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

"""The server's side of workers: one process a tab, and one that has started already and waits for the next tab."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import sys
from collections.abc import Mapping
from typing import Any

from harness.processes import worker_environment as environment
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
        """A worker that has its imports behind it."""
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-P", "-m", "harness.view.worker", stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE,
            env=environment(allow_imports), start_new_session=True, limit=STREAM_LIMIT,
        )  # fmt: skip
        made = cls(process)
        try:
            first = await made.receive()
        except BaseException:
            made.kill()
            raise
        if first is None or header_of(first)["is"] != "ready":
            made.kill()
            raise RuntimeError("a worker did not start")
        return made

    async def send(self, request: Mapping[str, Any]) -> None:
        """Hands a request over. A worker that has ended is noticed by `receive`."""
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
        """How it ended, in words."""
        status = await self._process.wait()
        return f"was killed by {signal.Signals(-status).name}" if status < 0 else f"ended with status {status}"

    def kill(self) -> None:
        """Ends it and what it started, at once; harmless where it has ended."""
        if self._process.returncode is None:
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, signal.SIGKILL)


class Workers:
    """Gives out workers, and has the next one started."""

    def __init__(self, allow_imports: bool) -> None:
        self._allow_imports = allow_imports
        self._spare: asyncio.Task[Worker] | None = None

    def prepare(self) -> None:
        """Has a worker started, if none waits."""
        if self._spare is None:
            self._spare = asyncio.create_task(Worker.start(self._allow_imports))

    async def take(self) -> Worker:
        """A worker; the next one is started once this one has come."""
        self.prepare()
        assert self._spare is not None
        spare, self._spare = self._spare, None
        try:
            return await spare
        finally:
            self.prepare()

    async def close(self) -> None:
        """Ends the one that waits."""
        if self._spare is not None:
            self._spare.cancel()
            with contextlib.suppress(asyncio.CancelledError, Exception):
                (await self._spare).kill()

"""One tab: its socket, its worker, and what goes between them."""

from __future__ import annotations

import asyncio
import json
import shutil
from pathlib import Path
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from harness.view.messages import BEGIN_WORK, LONGEST_REQUEST, header_of, latest_key, packed, problem
from harness.view.process import Worker, Workers
from harness.view.turns import Turns

MOST_WAITING = 64
MOST_A_SECOND = 400
"""Requests that are read; a page that sends more has to wait, and nobody else does."""
PAUSE_SECONDS = 0.004
PATIENCE_SECONDS = 3.0
"""For a stop; a worker that does not hear it by then is ended."""
Request = dict[str, Any]


class Session:
    """Runs until the tab closes; then its worker is gone, too. `begin` is the worker's first request."""

    def __init__(self, socket: WebSocket, workers: Workers, turns: Turns, begin: Request) -> None:
        self._socket, self._workers, self._turns, self._begin = socket, workers, turns, begin
        self._worker: Worker | None = None
        self._waiting: list[Request] = []
        self._arrived = asyncio.Event()
        self._seq = 0
        self._stopping: asyncio.TimerHandle | None = None

    async def run(self) -> None:
        """Serves an accepted socket."""
        tasks = [asyncio.create_task(part()) for part in (self._read, self._hand_on, self._answer)]
        try:
            done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                if not isinstance(task.exception(), (WebSocketDisconnect, RuntimeError, type(None))):
                    raise task.exception() or RuntimeError
        finally:
            for task in tasks:
                task.cancel()
            if self._stopping is not None:
                self._stopping.cancel()
            self._turns.release(self)
            self._end_worker()
            await asyncio.gather(*tasks, return_exceptions=True)
            self._end_worker()  # one that was just starting

    def _end_worker(self) -> None:
        if self._worker is not None:
            self._worker.kill()
            self._worker = None
        if self._begin.get("scratch"):
            shutil.rmtree(Path(self._begin["scratch"]), ignore_errors=True)

    # ---- from the page -----------------------------------------------------------------------------------------------

    async def _read(self) -> None:
        """Reads requests at a limited pace: those of a flood wait in the sender's own buffers."""
        loop = asyncio.get_running_loop()
        second, count = loop.time(), 0
        while True:
            message = await self._socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            if loop.time() - second >= 1.0:
                second, count = loop.time(), 0
            count += 1
            if count > MOST_A_SECOND:
                await asyncio.sleep(max(0.0, second + 1.0 - loop.time()))
            await self._take_in(message.get("text") or "")

    async def _take_in(self, text: str) -> None:
        try:
            request = json.loads(text) if len(text) <= LONGEST_REQUEST else None
        except (ValueError, RecursionError):
            request = None
        if not isinstance(request, dict) or not isinstance(request.get("do"), str):
            await self._socket.send_bytes(problem("a request is a JSON object with the key 'do'"))
            return
        if request["do"] == "stop":
            await self._stop()
        if key := latest_key(request["do"], request.get("finger")):
            self._waiting = [other for other in self._waiting if (other["do"], other.get("finger")) != key]
        if len(self._waiting) >= MOST_WAITING:
            await self._socket.send_bytes(problem("too many requests wait: this one was dropped"))
            return
        self._waiting.append(request)
        self._arrived.set()

    async def _stop(self) -> None:
        """Forgets what was to begin; the worker gets some seconds to stop what it does."""
        begun = [request for request in self._waiting if request["do"] in BEGIN_WORK]
        self._waiting = [request for request in self._waiting if request["do"] not in BEGIN_WORK]
        self._turns.give_up(self)
        if begun and self._worker is None:
            await self._socket.send_bytes(packed({"is": "state", "state": "stopped", "doing": ""}))
        if self._worker is not None and self._stopping is None:
            loop = asyncio.get_running_loop()
            self._stopping = loop.call_later(PATIENCE_SECONDS, self._worker.kill)

    async def _hand_on(self) -> None:
        """Gives requests to the worker, which begins work only when it is this tab's turn."""
        while True:
            await self._arrived.wait()
            self._arrived.clear()
            while self._waiting:
                request = self._waiting[0]
                if request["do"] in BEGIN_WORK and not await self._turn():
                    continue
                if not self._waiting:
                    break
                request = self._waiting.pop(0)
                worker = await self._ready()
                if request["do"] in BEGIN_WORK:
                    self._seq += 1
                    request["seq"] = self._seq
                await worker.send(request)
            await asyncio.sleep(PAUSE_SECONDS)

    async def _ready(self) -> Worker:
        """The worker, once there is one."""
        while self._worker is None:
            await asyncio.sleep(PAUSE_SECONDS)
        return self._worker

    async def _turn(self) -> bool:
        """Waits for the tab's turn; False where a stop came first."""
        if not self._turns.free_for(self):
            others = self._turns.rendering
            words = f"{others} other tabs are rendering; this one waits for its turn. Stop or close one of them."
            await self._socket.send_bytes(packed({"is": "state", "state": "waiting", "doing": words}))
        return await self._turns.acquire(self)

    # ---- to the page -------------------------------------------------------------------------------------------------

    async def _answer(self) -> None:
        """Hands the worker's messages to the page."""
        worker = await self._begun()
        while True:
            message = await worker.receive()
            if message is None:
                worker = await self._replaced(worker)
                continue
            told = header_of(message)
            if told["is"] == "state":
                self._rested(told)
            await self._socket.send_bytes(message)

    def _rested(self, told: Request) -> None:
        """Gives the turn back when the worker rests, and has not been asked for more since."""
        if told["state"] == "busy":
            return
        if self._stopping is not None:
            self._stopping.cancel()
            self._stopping = None
        if told.get("seq") == self._seq:
            self._turns.release(self)

    async def _begun(self) -> Worker:
        """A worker that knows what it is for."""
        worker = await self._workers.take()
        await worker.send(self._begin)
        self._worker = worker
        return worker

    async def _replaced(self, worker: Worker) -> Worker:
        """Says that the worker has ended; the next one knows no scene yet."""
        self._worker = None
        how = await worker.ended()
        asked, self._stopping = self._stopping is not None, None
        self._turns.release(self)
        words = "It did not stop within some seconds and was ended." if asked else f"The process that rendered {how}."
        await self._socket.send_bytes(packed({"is": "lost", "text": f"{words} Start begins anew."}))
        await self._socket.send_bytes(packed({"is": "state", "state": "stopped", "doing": ""}))
        return await self._begun()

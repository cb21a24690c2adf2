"""One tab: forwards requests from its socket to its worker, and messages from the worker to the socket."""

from __future__ import annotations

import asyncio
import json
import shutil
from pathlib import Path
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from harness.view.messages import MAX_REQUEST_BYTES, STARTS_RENDERING, coalescing_key, error_message, header_of, packed
from harness.view.render_slots import RenderSlots
from harness.view.worker_pool import Worker, WorkerPool

MAX_WAITING = 64
MAX_PER_SECOND = 400
"""Requests that are read from a page; one that sends more is slowed down, other pages are not."""
PAUSE_SECONDS = 0.004
STOP_SECONDS = 3.0
"""A worker that does not stop within this time is killed."""
Request = dict[str, Any]


class Session:
    """Runs until the tab closes, then ends its worker. `begin` is the first request to the worker."""

    def __init__(self, socket: WebSocket, workers: WorkerPool, slots: RenderSlots, begin: Request) -> None:
        self._socket, self._workers, self._slots, self._begin = socket, workers, slots, begin
        self._worker: Worker | None = None
        self._waiting: list[Request] = []
        self._arrived = asyncio.Event()
        self._seq = 0
        self._stopping: asyncio.TimerHandle | None = None

    async def run(self) -> None:
        """Serves an accepted socket."""
        tasks = [asyncio.create_task(loop()) for loop in (self._read, self._forward_requests, self._forward_messages)]
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
            self._slots.release(self)
            self._end_worker()
            await asyncio.gather(*tasks, return_exceptions=True)
            self._end_worker()  # a worker that was just starting

    def _end_worker(self) -> None:
        if self._worker is not None:
            self._worker.kill()
            self._worker = None
        if self._begin.get("scratch"):
            shutil.rmtree(Path(self._begin["scratch"]), ignore_errors=True)

    # ---- from the page -----------------------------------------------------------------------------------------------

    async def _read(self) -> None:
        """Reads requests at a limited rate: more of them wait in the buffers of the sender."""
        loop = asyncio.get_running_loop()
        second, count = loop.time(), 0
        while True:
            message = await self._socket.receive()
            if message["type"] == "websocket.disconnect":
                return
            if loop.time() - second >= 1.0:
                second, count = loop.time(), 0
            count += 1
            if count > MAX_PER_SECOND:
                await asyncio.sleep(max(0.0, second + 1.0 - loop.time()))
            await self._enqueue(message.get("text") or "")

    async def _enqueue(self, text: str) -> None:
        try:
            request = json.loads(text) if len(text) <= MAX_REQUEST_BYTES else None
        except (ValueError, RecursionError):
            request = None
        if not isinstance(request, dict) or not isinstance(request.get("type"), str):
            await self._socket.send_bytes(error_message("a request is a JSON object with the key 'type'"))
            return
        if request["type"] == "stop":
            await self._stop()
        if key := coalescing_key(request["type"], request.get("finger")):
            self._waiting = [other for other in self._waiting if (other["type"], other.get("finger")) != key]
        if len(self._waiting) >= MAX_WAITING:
            await self._socket.send_bytes(error_message("too many requests are waiting: this one was dropped"))
            return
        self._waiting.append(request)
        self._arrived.set()

    async def _stop(self) -> None:
        """Drops the waiting requests that start rendering; the worker gets some seconds to stop."""
        dropped = [request for request in self._waiting if request["type"] in STARTS_RENDERING]
        self._waiting = [request for request in self._waiting if request["type"] not in STARTS_RENDERING]
        self._slots.cancel(self)
        if dropped and self._worker is None:
            await self._socket.send_bytes(packed({"type": "state", "state": "stopped", "activity": ""}))
        if self._worker is not None and self._stopping is None:
            loop = asyncio.get_running_loop()
            self._stopping = loop.call_later(STOP_SECONDS, self._worker.kill)

    async def _forward_requests(self) -> None:
        """Sends requests to the worker; one that starts rendering waits for a render slot."""
        while True:
            await self._arrived.wait()
            self._arrived.clear()
            while self._waiting:
                request = self._waiting[0]
                if request["type"] in STARTS_RENDERING and not await self._acquire_slot():
                    continue
                if not self._waiting:
                    break
                request = self._waiting.pop(0)
                worker = await self._running_worker()
                if request["type"] in STARTS_RENDERING:
                    self._seq += 1
                    request["seq"] = self._seq
                await worker.send(request)
            await asyncio.sleep(PAUSE_SECONDS)

    async def _running_worker(self) -> Worker:
        """Waits for the worker."""
        while self._worker is None:
            await asyncio.sleep(PAUSE_SECONDS)
        return self._worker

    async def _acquire_slot(self) -> bool:
        """Waits for a render slot; False where a stop came first."""
        if not self._slots.is_free_for(self):
            activity = f"{self._slots.in_use} other tabs are rendering; this one waits for them. Stop or close one of them."
            await self._socket.send_bytes(packed({"type": "state", "state": "waiting", "activity": activity}))
        return await self._slots.acquire(self)

    # ---- to the page -------------------------------------------------------------------------------------------------

    async def _forward_messages(self) -> None:
        """Sends the messages of the worker to the page; replaces a worker that has ended."""
        worker = await self._new_worker()
        while True:
            message = await worker.receive()
            if message is None:
                worker = await self._replace(worker)
                continue
            header = header_of(message)
            if header["type"] == "state":
                self._note_state(header)
            await self._socket.send_bytes(message)

    def _note_state(self, header: Request) -> None:
        """Releases the render slot when the worker has finished the last request that starts rendering."""
        if header["state"] == "busy":
            return
        if self._stopping is not None:
            self._stopping.cancel()
            self._stopping = None
        if header.get("seq") == self._seq:
            self._slots.release(self)

    async def _new_worker(self) -> Worker:
        """Takes a worker from the pool and sends it `begin`."""
        worker = await self._workers.take()
        await worker.send(self._begin)
        self._worker = worker
        return worker

    async def _replace(self, worker: Worker) -> Worker:
        """Tells the page that the worker has ended, and takes a new one, which has no scene yet."""
        self._worker = None
        ending = await worker.ended()
        stopped, self._stopping = self._stopping is not None, None
        self._slots.release(self)
        reason = "The render did not stop within some seconds and was killed." if stopped else f"The worker process {ending}."
        await self._socket.send_bytes(packed({"type": "worker_lost", "text": f"{reason} Start opens the scene again."}))
        await self._socket.send_bytes(packed({"type": "state", "state": "stopped", "activity": ""}))
        return await self._new_worker()

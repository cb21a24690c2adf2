"""N. Dahlquist's program, live: its animation, its switches, and spheres that are dragged."""

from __future__ import annotations

import threading
import traceback
from collections import deque
from collections.abc import Callable
from statistics import median
from time import monotonic, perf_counter, sleep
from typing import Any

import psutil

from engines import dahlquist
from engines.errors import RaybenchError
from harness.measure import machine
from harness.processes import one_line
from harness.view import requests
from harness.view.coalescing_queue import CoalescingQueue
from harness.view.messages import coalescing_key, error_message, packed

MAX_UNACKNOWLEDGED = 2
FOCAL = 2.6
"""Distance of the image plane of the original, in image widths."""
SHORTEST_CALL = 1 / 120
"""Seconds per frame call, at least: screens show no more frames."""
STATE_SECONDS = 0.5

ORIGINAL = (
    ("640x640, 2 cores, background kept", 12.3e-3, 33.4e6),
    ("640x640, 2 cores, background redrawn", 15.8e-3, 26.0e6),
    ("640x640, 1 core, background redrawn", 23.0e-3, 17.8e6),
    ("1920x1080, 2 cores, background redrawn", 48.2e-3, 43.0e6),
)
"""(configuration, seconds per whole frame, primary rays/s) of the original, compiled with -O3 -march=native, on two cores at
2.1 GHz, with reflections and environment, without interlacing."""


class DahlquistController:
    """Runs the page of Dahlquist's program."""

    def __init__(self, send: Callable[[bytes], None]) -> None:
        self._send = send
        self._work = CoalescingQueue()
        self._tracer: dahlquist.Tracer | None = None
        self._switches = requests.SwitchesRequest(type="switches")
        self._seconds: deque[float] = deque(maxlen=60)
        self._call_times: deque[float] = deque(maxlen=120)
        self._running, self._seq, self._threads = False, 0, 1
        self._unacknowledged, self._acknowledged = 0, threading.Condition()

    def receive(self, request: Any) -> None:
        if request.type == "ack":
            with self._acknowledged:
                self._unacknowledged = max(0, self._unacknowledged - 1)
                self._acknowledged.notify()
            return
        key = coalescing_key(request.type, getattr(request, "finger", None))
        self._work.put(request, key)

    def start(self) -> None:
        fields = {"original": ORIGINAL, "cores": len(machine.usable_cores()), "engines": dahlquist.ENGINES}
        self._send(packed({"type": "menu", **fields}))

    def run(self) -> None:
        last_call = last_state = monotonic()
        while True:
            request = self._work.take(0.0 if self._running else None)
            try:
                while request is not None:
                    self._handle(request)
                    request = self._work.take(0.0)
                if self._running:
                    now = monotonic()
                    self._call(min(now - last_call, 0.25))
                    last_call = now
                    if now - last_state >= STATE_SECONDS:
                        self._send_state()
                        last_state = now
            except Exception as error:
                if not isinstance(error, RaybenchError):
                    traceback.print_exc()
                self._send(error_message(one_line(error)))
                self._running = False
                self._send_state()

    def _handle(self, request: Any) -> None:
        self._seq = max(self._seq, request.seq)
        if isinstance(request, requests.DahlquistRequest):
            self._prepare(request)
        elif isinstance(request, requests.SwitchesRequest):
            self._switches = request
            self._apply_switches()
        elif isinstance(request, requests.TouchRequest) and self._tracer is not None:
            self._touch(self._tracer, request)
        elif isinstance(request, requests.HoldRequest) and self._tracer is not None:
            self._hold(self._tracer, request)
        elif request.type in ("stop", "resume"):
            self._running = request.type == "resume" and self._tracer is not None
            self._send_state()

    def _prepare(self, request: requests.DahlquistRequest) -> None:
        self._running = False
        self._send(packed({"type": "state", "state": "busy", "activity": "compiling", "seq": self._seq}))
        self._threads = threads = requests.limited_threads(request.threads)
        self._tracer = dahlquist.Tracer(request.width, request.height, engine=request.engine, threads=threads)
        self._tracer.call(0)
        self._apply_switches()
        self._running = True
        self._send_state()

    def _apply_switches(self) -> None:
        """Applies the switches and, as in the original, restarts the measurement of rates."""
        self._seconds.clear()
        self._call_times.clear()
        if self._tracer is None:
            return
        chosen = self._switches
        self._tracer.reflections, self._tracer.interlaced = chosen.reflections, chosen.interlaced
        if self._tracer.environment != chosen.environment:
            self._tracer.environment = chosen.environment

    def _touch(self, tracer: dahlquist.Tracer, request: requests.TouchRequest) -> None:
        if request.type == "touch":
            sphere = int(tracer.touch(request.x, request.y, request.finger))
            self._send(packed({"type": "touched", "finger": request.finger, "sphere": sphere}))
        elif request.type == "move":
            tracer.move(request.x, request.y, request.finger)
        else:
            tracer.release(request.finger)

    def _hold(self, tracer: dahlquist.Tracer, request: requests.HoldRequest) -> None:
        """Touches a sphere at the projection of its centre, and sends that position. Another sphere may be in front of it."""
        depth, right, down = (float(part) for part in tracer.animation.centres[request.sphere])
        width = tracer.frame.shape[1]
        x, y = (width * (FOCAL * part / depth + 0.5) for part in (right, down))
        sphere = int(tracer.touch(x, y, request.finger))
        self._send(packed({"type": "held", "sphere": sphere, "x": x, "y": y}))

    def _call(self, wall_seconds: float) -> None:
        """Renders a frame and sends it; waits while the page has not acknowledged earlier frames."""
        assert self._tracer is not None
        if self._switches.redraw:
            self._tracer.redraw_background()
        start = perf_counter()
        frame = self._tracer.call(round(self._switches.speed * 1000 * wall_seconds))
        elapsed = perf_counter() - start
        self._seconds.append(elapsed)
        self._call_times.append(monotonic())
        height, width, _ = frame.shape
        with self._acknowledged:
            self._acknowledged.wait_for(lambda: self._unacknowledged < MAX_UNACKNOWLEDGED, 0.5)
            self._unacknowledged += 1
        self._send(packed({"type": "frame", "width": width, "height": height}, frame.tobytes()))
        sleep(max(0.0, SHORTEST_CALL - elapsed))

    def _send_state(self) -> None:
        fields: dict[str, Any] = {"type": "state", "state": "busy" if self._running else "stopped", "seq": self._seq}
        fields |= {"activity": "", "memory_bytes": psutil.Process().memory_info().rss}
        if self._tracer is not None and len(self._seconds) > 1:
            height, width, _ = self._tracer.frame.shape
            calls = 2 if self._tracer.interlaced else 1  # of a whole frame
            seconds = calls * median(self._seconds)
            span = self._call_times[-1] - self._call_times[0]
            fields |= {
                "frame_seconds": seconds,
                "rays_per_second": width * height / seconds,
                "size": f"{width}x{height}",
                "calls_per_frame": calls,
                "redraw": self._switches.redraw,
                "threads": self._threads,
                "frames_per_second": (len(self._call_times) - 1) / span / calls if span else None,
            }
        self._send(packed(fields))

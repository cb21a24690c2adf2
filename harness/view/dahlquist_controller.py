"""N. Dahlquist's program, live: its animation, its switches, and spheres that are dragged."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from statistics import median
from time import monotonic, perf_counter, sleep
from typing import Any

from engines import dahlquist
from harness.measure import machine
from harness.view import requests
from harness.view.controller import Controller
from harness.view.messages import state_message

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


class DahlquistController(Controller):
    """Runs the page of Dahlquist's program."""

    def __init__(self, send: Callable[[bytes], None]) -> None:
        super().__init__(send)
        self._tracer: dahlquist.Tracer | None = None
        self._switches = requests.SwitchesRequest(type="switches")
        self._seconds: deque[float] = deque(maxlen=60)
        self._call_times: deque[float] = deque(maxlen=120)
        self._running, self._threads = False, 1
        self._last_call = self._last_state = monotonic()
        self._unacknowledged, self._acknowledged = 0, threading.Condition()

    def receive(self, request: Any) -> None:
        if request.type == "ack":
            with self._acknowledged:
                self._unacknowledged = max(0, self._unacknowledged - 1)
                self._acknowledged.notify()
        else:
            super().receive(request)

    def start(self) -> None:
        self._message("menu", original=ORIGINAL, cores=len(machine.usable_cores()), engines=dahlquist.ENGINES)

    def _step(self) -> None:
        """Handles the requests that wait, then calls the program; waits for a request while it is stopped."""
        request = self._work.take(0.0 if self._running else None)
        while request is not None:
            self._handle(request)
            request = self._work.take(0.0)
        if not self._running:
            return
        now = monotonic()
        self._call(min(now - self._last_call, 0.25))
        self._last_call = now
        if now - self._last_state >= STATE_SECONDS:
            self._send_state()
            self._last_state = now

    def _rest(self) -> None:
        self._running = False
        self._send_state()

    def _on_stop(self, request: Any) -> None:
        self._rest()

    def _on_resume(self, request: Any) -> None:
        self._running = self._tracer is not None
        self._send_state()

    def _on_dahlquist(self, request: requests.DahlquistRequest) -> None:
        self._running = False
        self._send(state_message("busy", self._seq, activity="compiling"))
        self._threads = threads = requests.limited_threads(request.threads)
        self._tracer = dahlquist.Tracer(request.width, request.height, engine=request.engine, threads=threads)
        self._tracer.call(0)
        self._apply_switches()
        self._running = True
        self._send_state()

    def _on_switches(self, request: requests.SwitchesRequest) -> None:
        self._switches = request
        self._apply_switches()

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

    def _on_touch(self, request: requests.TouchRequest) -> None:
        if self._tracer is not None:
            sphere = int(self._tracer.touch(request.x, request.y, request.finger))
            self._message("touched", finger=request.finger, sphere=sphere)

    def _on_move(self, request: requests.TouchRequest) -> None:
        if self._tracer is not None:
            self._tracer.move(request.x, request.y, request.finger)

    def _on_release(self, request: requests.TouchRequest) -> None:
        if self._tracer is not None:
            self._tracer.release(request.finger)

    def _on_hold(self, request: requests.HoldRequest) -> None:
        """Touches a sphere at the projection of its centre, and sends that position. Another sphere may be in front of it."""
        tracer = self._tracer
        if tracer is None:
            return
        depth, right, down = (float(part) for part in tracer.animation.centres[request.sphere])
        width = tracer.frame.shape[1]
        x, y = (width * (FOCAL * part / depth + 0.5) for part in (right, down))
        sphere = int(tracer.touch(x, y, request.finger))
        self._message("held", sphere=sphere, x=x, y=y)

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
        self._message("frame", frame.tobytes(), width=width, height=height)
        sleep(max(0.0, SHORTEST_CALL - elapsed))

    def _send_state(self) -> None:
        fields: dict[str, Any] = {}
        if self._tracer is not None and len(self._seconds) > 1:
            height, width, _ = self._tracer.frame.shape
            calls = 2 if self._tracer.interlaced else 1  # of a whole frame
            seconds = calls * median(self._seconds)
            span = self._call_times[-1] - self._call_times[0]
            fields = {
                "frame_seconds": seconds,
                "rays_per_second": width * height / seconds,
                "size": f"{width}x{height}",
                "calls_per_frame": calls,
                "redraw": self._switches.redraw,
                "threads": self._threads,
                "frames_per_second": (len(self._call_times) - 1) / span / calls if span else None,
            }
        self._send(state_message("busy" if self._running else "stopped", self._seq, **fields))

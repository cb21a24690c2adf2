"""N. Dahlquist's program, live: its animation and switches, and balls that follow a finger."""

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
from harness.view.mailbox import Mailbox
from harness.view.messages import latest_key, packed, problem

MOST_UNSEEN = 2
FOCAL = 2.6
"""Distance of the original's image plane, in image widths."""
SHORTEST_CALL = 1 / 120
"""Seconds; a call that is done sooner waits, as no screen shows more."""
STATE_SECONDS = 0.5

ORIGINAL = (
    ("640x640, 2 cores, background kept", 12.3e-3, 33.4e6),
    ("640x640, 2 cores, background redrawn", 15.8e-3, 26.0e6),
    ("640x640, 1 core, background redrawn", 23.0e-3, 17.8e6),
    ("1920x1080, 2 cores, background redrawn", 48.2e-3, 43.0e6),
)
"""Seconds a call and primary rays/s of the original, built natively with -O3 -march=native, on two cores at 2.1 GHz,
reflections and environment on, all rows."""


class DemoDesk:
    """A tab with the demo."""

    def __init__(self, send: Callable[[bytes], None]) -> None:
        self._send = send
        self._work = Mailbox()
        self._tracer: dahlquist.Tracer | None = None
        self._switches = requests.Switches(do="switches")
        self._seconds: deque[float] = deque(maxlen=60)
        self._called: deque[float] = deque(maxlen=120)
        self._running, self._seq = False, 0
        self._unseen, self._seen = 0, threading.Condition()

    def hear(self, request: Any) -> None:
        if request.do == "ack":
            with self._seen:
                self._unseen = max(0, self._unseen - 1)
                self._seen.notify()
            return
        key = latest_key(request.do, getattr(request, "finger", None))
        self._work.put(request, key)

    def start(self) -> None:
        told = {"original": ORIGINAL, "cores": len(machine.usable_cores()), "engines": dahlquist.ENGINES}
        self._send(packed({"is": "menu", **told}))

    def run(self) -> None:
        before = stated = monotonic()
        while True:
            request = self._work.take(0.0 if self._running else None)
            try:
                while request is not None:
                    self._do(request)
                    request = self._work.take(0.0)
                if self._running:
                    now = monotonic()
                    self._call(min(now - before, 0.25))
                    before = now
                    if now - stated >= STATE_SECONDS:
                        self._tell_state()
                        stated = now
            except Exception as error:
                if not isinstance(error, RaybenchError):
                    traceback.print_exc()
                self._send(problem(one_line(error)))
                self._running = False
                self._tell_state()

    def _do(self, request: Any) -> None:
        self._seq = max(self._seq, request.seq)
        if isinstance(request, requests.Demo):
            self._begin(request)
        elif isinstance(request, requests.Switches):
            self._switches = request
            self._switch()
        elif isinstance(request, requests.Touch) and self._tracer is not None:
            self._touched(self._tracer, request)
        elif isinstance(request, requests.Hold) and self._tracer is not None:
            self._hold(self._tracer, request)
        elif request.do in ("stop", "resume"):
            self._running = request.do == "resume" and self._tracer is not None
            self._tell_state()

    def _begin(self, request: requests.Demo) -> None:
        self._running = False
        self._send(packed({"is": "state", "state": "busy", "doing": "compiling", "seq": self._seq}))
        threads = requests.threads_within(request.threads)
        self._tracer = dahlquist.Tracer(request.width, request.height, engine=request.engine, threads=threads)
        self._tracer.call(0)
        self._switch()
        self._running = True
        self._tell_state()

    def _switch(self) -> None:
        """Takes the switches over. As in the original, rates begin anew."""
        self._seconds.clear()
        self._called.clear()
        if self._tracer is None:
            return
        chosen = self._switches
        self._tracer.reflections, self._tracer.interlaced = chosen.reflections, chosen.interlaced
        if self._tracer.environment != chosen.environment:
            self._tracer.environment = chosen.environment

    def _touched(self, tracer: dahlquist.Tracer, request: requests.Touch) -> None:
        if request.do == "touch":
            ball = int(tracer.touch(request.x, request.y, request.finger))
            self._send(packed({"is": "touched", "finger": request.finger, "ball": ball}))
        elif request.do == "move":
            tracer.move(request.x, request.y, request.finger)
        else:
            tracer.release(request.finger)

    def _hold(self, tracer: dahlquist.Tracer, request: requests.Hold) -> None:
        """Touches the middle of a ball, where another may be in front of it; the answer says where that is."""
        depth, right, down = (float(part) for part in tracer.animation.centres[request.ball])
        width = tracer.frame.shape[1]
        x, y = (width * (FOCAL * part / depth + 0.5) for part in (right, down))
        ball = int(tracer.touch(x, y, request.finger))
        self._send(packed({"is": "held", "ball": ball, "x": x, "y": y}))

    def _call(self, wall_seconds: float) -> None:
        """A frame call, and the frame on its way; waits while the page has frames enough to draw."""
        assert self._tracer is not None
        if self._switches.redraw:
            self._tracer.redraw_background()
        start = perf_counter()
        frame = self._tracer.call(round(self._switches.speed * 1000 * wall_seconds))
        spent = perf_counter() - start
        self._seconds.append(spent)
        self._called.append(monotonic())
        height, width, _ = frame.shape
        with self._seen:
            self._seen.wait_for(lambda: self._unseen < MOST_UNSEEN, 0.5)
            self._unseen += 1
        self._send(packed({"is": "frame", "width": width, "height": height}, frame.tobytes()))
        sleep(max(0.0, SHORTEST_CALL - spent))

    def _tell_state(self) -> None:
        told: dict[str, Any] = {"is": "state", "state": "busy" if self._running else "stopped", "seq": self._seq}
        told |= {"doing": "", "memory_bytes": psutil.Process().memory_info().rss}
        if self._tracer is not None and len(self._seconds) > 1:
            height, width, _ = self._tracer.frame.shape
            rays = width * height / (2 if self._tracer.interlaced else 1)
            seconds = median(self._seconds)
            span = self._called[-1] - self._called[0]
            told |= {"call_seconds": seconds, "rays_per_second": rays / seconds, "size": f"{width}x{height}",
                     "frames_per_second": (len(self._called) - 1) / span if span else None}  # fmt: skip
        self._send(packed(told))

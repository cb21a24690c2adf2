"""A race in a tab: contestants render one at a time, in slices of equal time, so that they do not share cores."""

from __future__ import annotations

import shutil
import threading
import traceback
from collections.abc import Callable
from pathlib import Path
from time import monotonic
from typing import Any

import psutil

from engines.errors import ConfigError, RaybenchError
from engines.registry import names_a_program
from harness.processes import one_line
from harness.view import requests
from harness.view.coalescing_queue import CoalescingQueue
from harness.view.contestant import Contestant
from harness.view.display import half_floats
from harness.view.library import Library
from harness.view.menu import menu
from harness.view.messages import error_message, packed
from harness.view.race import Race, Stopped


class RaceController:
    """Runs the races of a tab. Results are in the folder `scratch`, beside other results, until they are saved by name."""

    def __init__(
        self, send: Callable[[bytes], None], library: Library, scratch: Path, allow_imports: bool, allow_outside: bool = False
    ) -> None:
        self._send, self._library, self._scratch = send, library, scratch
        self._allowed = allow_imports, allow_outside
        self._work = CoalescingQueue()
        self._stopped = threading.Event()
        self._race: Race | None = None
        self._racing: Contestant | None = None
        self._state, self._seq = "idle", 0

    def receive(self, request: Any) -> None:
        if request.type == "stop":
            self._stopped.set()
            self._interrupt()
        self._work.put(request)

    def _interrupt(self) -> None:
        race, contestant = self._race, self._racing
        if race is not None:
            race.replicates.stop()
        if contestant is not None and contestant.renderer is not None:
            contestant.renderer.stop()

    def start(self) -> None:
        self._send_message("menu", **menu(self._library))

    def run(self) -> None:
        while True:
            request = self._work.take()
            self._seq = max(self._seq, request.seq)
            try:
                getattr(self, f"_on_{request.type}", self._refuse)(request)
            except Stopped:
                self._set_state("stopped")
            except Exception as error:
                if not isinstance(error, RaybenchError):
                    traceback.print_exc()
                self._send(error_message(one_line(error)))
                self._set_state("stopped")

    def _refuse(self, request: Any) -> None:
        raise ConfigError(f"a race has no request {request.type!r}")

    def _on_stop(self, request: Any) -> None:
        self._set_state(self._state)

    def _send_message(self, type: str, **fields: Any) -> None:
        self._send(packed({"type": type, **fields}))

    def _set_state(self, state: str, activity: str = "", racing: int | None = None) -> None:
        """`racing` is the index of the contestant that renders."""
        self._state = state
        memory = psutil.Process().memory_info().rss
        self._send_message("state", state=state, activity=activity, racing=racing, seq=self._seq, memory_bytes=memory)

    # ---- the race ----------------------------------------------------------------------------------------------------

    def _on_race(self, request: requests.RaceRequest) -> None:
        self._stopped.clear()
        self._race = None
        shutil.rmtree(self._scratch, ignore_errors=True)
        self._set_state("busy", "reading the scene")
        scene, parameters = self._library.find(request.scene), self._library.parameters.get(request.scene, {})
        for settings in request.contestants:
            if names_a_program(settings.engine):
                raise ConfigError(f"{settings.engine}: external renderers are not run from a page")
        race = self._race = Race(request, (scene, parameters), self._scratch, self._allowed, self._send_message)
        self._send_message("contestants", names=race.names, targets=request.targets, width=request.width, height=request.height)
        try:
            self._set_state("busy", "rendering the reference")
            race.references()
            self._send_references()
            self._prepare()
            self._render_slices(request.slice_seconds)
        finally:
            self._racing = None
            race.close()
        self._set_state("stopped" if self._stopped.is_set() else "finished")

    def _send_references(self) -> None:
        """Sends every reference once, with the indices of the contestants that are compared with it."""
        from harness.report.html.assembly import colour_maps

        assert self._race is not None
        users: dict[str, list[int]] = {}
        for index, contestant in enumerate(self._race.contestants):
            users.setdefault(str(contestant.cell.reference_id), []).append(index)
        epsilon, maps = self._race.plan.experiment.quality.epsilon, colour_maps()
        for reference_id, contestants in users.items():
            reference = self._race.sweep.recorder.reference(reference_id)
            height, width, _ = reference.mean.shape
            fields = {"contestants": contestants, "width": width, "height": height, "epsilon": epsilon, "maps": maps}
            pixels = reference.mean.clip(-65504, 65504).astype("<f2").tobytes()
            self._send(packed({"type": "reference", **fields, "spp": reference.spp}, pixels))

    def _prepare(self) -> None:
        assert self._race is not None
        for contestant, name in zip(self._race.contestants, self._race.names, strict=True):
            if self._stopped.is_set():
                raise Stopped
            self._set_state("busy", f"building and compiling {name}")
            contestant.prepare()

    def _render_slices(self, slice_seconds: float) -> None:
        """Renders until all contestants are done; the one with the least time renders the next slice."""
        assert self._race is not None
        contestants = self._race.contestants
        while not self._stopped.is_set():
            left = [contestant for contestant in contestants if not contestant.done]
            if not left:
                return
            contestant = min(left, key=lambda contestant: contestant.seconds)
            index = contestants.index(contestant)
            self._set_state("busy", f"contestant {index + 1} is rendering, the others wait", index)
            self._racing = contestant
            contestant.race(slice_seconds)
            self._racing = None
            self._send_contestant(index, contestant)

    def _send_contestant(self, index: int, contestant: Contestant) -> None:
        assert contestant.renderer is not None
        fields = {
            "contestant": index,
            "seconds": contestant.seconds,
            "spp": contestant.spp,
            "done": contestant.done,
            "points": contestant.points,
            "crossings": contestant.crossings(),
            "phases": contestant.phases,
            "rays": _rays(contestant),
        }
        self._send(packed({"type": "contestant", **fields}, half_floats(contestant.renderer.film)))

    # ---- saving -------------------------------------------------------------------------------------------------

    def _on_save(self, request: requests.SaveRequest) -> None:
        """Renames the results folder, and writes tables, plots and the report."""
        if self._race is None or not any(contestant.points for contestant in self._race.contestants):
            raise ConfigError("there is no race to save yet")
        state, target = self._state, self._scratch.parent / request.name
        if self._race.folder != self._scratch:
            raise ConfigError(f"this race is already saved as {self._race.folder.name}")
        if target.exists():
            raise ConfigError(f"results/{request.name} exists already: choose another name")
        self._set_state("busy", "writing tables, plots and report")
        began = monotonic()
        self._scratch.rename(target)
        self._race.folder = target
        from harness.report import write_derived

        write_derived(target)
        folder = str(target.relative_to(self._library.folder))
        self._send_message("saved", name=request.name, folder=folder, seconds=monotonic() - began)
        self._set_state(state)


def _rays(contestant: Contestant) -> float | None:
    found = contestant.renderer.counters().get("rays") if contestant.renderer is not None else None
    return None if found is None else float(found)

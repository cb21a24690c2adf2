"""A race in a tab: lanes take turns of equal time, so that they do not steal each other's cores."""

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
from engines.registry import is_file
from harness.processes import one_line
from harness.view import requests
from harness.view.contest import Contest, Stopped
from harness.view.display import half_floats
from harness.view.lane import Lane
from harness.view.library import Library
from harness.view.mailbox import Mailbox
from harness.view.menu import menu
from harness.view.messages import packed, problem


class RaceDesk:
    """A tab with a race. Its results lie in `scratch`, beside the folders of other results, until they get a name."""

    def __init__(self, send: Callable[[bytes], None], library: Library, scratch: Path, allow_imports: bool) -> None:
        self._send, self._library, self._scratch, self._allow_imports = send, library, scratch, allow_imports
        self._work = Mailbox()
        self._stopped = threading.Event()
        self._contest: Contest | None = None
        self._racing: Lane | None = None
        self._state, self._doing, self._seq = "idle", "", 0

    def hear(self, request: Any) -> None:
        if request.do == "stop":
            self._stopped.set()
            self._interrupt()
        self._work.put(request)

    def _interrupt(self) -> None:
        contest, lane = self._contest, self._racing
        if contest is not None:
            contest.replicates.stop()
        if lane is not None and lane.renderer is not None:
            lane.renderer.stop()

    def start(self) -> None:
        self._tell("menu", **menu(self._library))

    def run(self) -> None:
        while True:
            request = self._work.take()
            self._seq = max(self._seq, request.seq)
            try:
                getattr(self, f"_{request.do}", self._unknown)(request)
            except Stopped:
                self._to("stopped")
            except Exception as error:
                if not isinstance(error, RaybenchError):
                    traceback.print_exc()
                self._send(problem(one_line(error)))
                self._to("stopped")

    def _unknown(self, request: Any) -> None:
        raise ConfigError(f"{request.do!r} means nothing in a race")

    def _stop(self, request: Any) -> None:
        self._to(self._state)

    def _tell(self, what: str, **told: Any) -> None:
        self._send(packed({"is": what, **told}))

    def _to(self, state: str, doing: str = "") -> None:
        self._state, self._doing = state, doing
        memory = psutil.Process().memory_info().rss
        self._tell("state", state=state, doing=doing, seq=self._seq, memory_bytes=memory)

    # ---- the race ----------------------------------------------------------------------------------------------------

    def _race(self, request: requests.Race) -> None:
        self._stopped.clear()
        self._contest = None
        shutil.rmtree(self._scratch, ignore_errors=True)
        self._to("busy", "reading the scene")
        scene = self._library.find(request.scene)
        for part in request.lanes:
            if is_file(part.engine):
                raise ConfigError(f"{part.engine}: programs that are named in files are not run from a page")
        contest = self._contest = Contest(request, scene, self._scratch, self._allow_imports, self._tell)
        self._tell("lanes", names=contest.names, targets=request.targets, width=request.width, height=request.height)
        try:
            self._to("busy", "making the reference")
            contest.references()
            self._tell_references()
            self._prepare()
            self._in_turns(request.slice_seconds)
        finally:
            self._racing = None
            contest.close()
        self._to("stopped" if self._stopped.is_set() else "finished")

    def _tell_references(self) -> None:
        """Every reference once, with the lanes that are compared with it."""
        from harness.report.html.assembly import colour_maps

        assert self._contest is not None
        users: dict[str, list[int]] = {}
        for index, lane in enumerate(self._contest.lanes):
            users.setdefault(str(lane.cell.reference_id), []).append(index)
        epsilon, maps = self._contest.plan.experiment.quality.epsilon, colour_maps()
        for reference_id, lanes in users.items():
            reference = self._contest.sweep.recorder.reference(reference_id)
            height, width, _ = reference.mean.shape
            told = {"lanes": lanes, "width": width, "height": height, "epsilon": epsilon, "maps": maps}
            pixels = reference.mean.clip(-65504, 65504).astype("<f2").tobytes()
            self._send(packed({"is": "reference", **told, "spp": reference.spp}, pixels))

    def _prepare(self) -> None:
        assert self._contest is not None
        for lane, name in zip(self._contest.lanes, self._contest.names, strict=True):
            if self._stopped.is_set():
                raise Stopped
            self._to("busy", f"building and compiling {name}")
            lane.prepare()

    def _in_turns(self, slice_seconds: float) -> None:
        """The lane that has had the least time goes next."""
        assert self._contest is not None
        lanes = self._contest.lanes
        while not self._stopped.is_set():
            left = [lane for lane in lanes if not lane.done]
            if not left:
                return
            lane = min(left, key=lambda lane: lane.seconds)
            index = lanes.index(lane)
            self._to("busy", f"lane {index + 1} renders, the others wait")
            self._racing = lane
            lane.race(slice_seconds)
            self._racing = None
            self._tell_lane(index, lane)

    def _tell_lane(self, index: int, lane: Lane) -> None:
        assert lane.renderer is not None
        told = {"lane": index, "seconds": lane.seconds, "spp": lane.spp, "done": lane.done, "points": lane.points,
                "crossings": lane.crossings(), "phases": lane.phases, "rays": _rays(lane)}  # fmt: skip
        self._send(packed({"is": "lane", **told}, half_floats(lane.renderer.film)))

    # ---- its results -------------------------------------------------------------------------------------------------

    def _save(self, request: requests.Save) -> None:
        """Gives the results folder its name, and writes tables, plots and the report."""
        if self._contest is None or not any(lane.points for lane in self._contest.lanes):
            raise ConfigError("there is no race to save yet")
        state, target = self._state, self._scratch.parent / request.name
        if self._contest.folder != self._scratch:
            raise ConfigError(f"this race is saved already, as {self._contest.folder.name}")
        if target.exists():
            raise ConfigError(f"results/{request.name} exists already: choose another name")
        self._to("busy", "writing tables, plots and report")
        began = monotonic()
        self._scratch.rename(target)
        self._contest.folder = target
        from harness.report import write_derived

        write_derived(target)
        folder = str(target.relative_to(self._library.folder))
        self._tell("saved", name=request.name, folder=folder, seconds=monotonic() - began)
        self._to(state)


def _rays(lane: Lane) -> float | None:
    found = lane.renderer.counters().get("rays") if lane.renderer is not None else None
    return None if found is None else float(found)

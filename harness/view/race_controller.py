"""A race in a tab: contestants render one at a time, in slices of equal time, so that they do not share cores."""

from __future__ import annotations

import shutil
import threading
from collections.abc import Callable
from pathlib import Path
from time import monotonic
from typing import Any

from engines.errors import ConfigError
from engines.registry import names_a_program
from harness.measure import clock
from harness.view import requests
from harness.view.contestant import Contestant
from harness.view.controller import Controller
from harness.view.display import half_floats
from harness.view.library import Library
from harness.view.menu import menu
from harness.view.messages import state_message
from harness.view.race import Race, Stopped


class RaceController(Controller):
    """Runs the races of a tab. Results are in the folder `scratch`, beside other results, until they are saved by name."""

    def __init__(
        self, send: Callable[[bytes], None], library: Library, scratch: Path, allow_imports: bool, allow_outside: bool = False
    ) -> None:
        super().__init__(send)
        self._library, self._scratch = library, scratch
        self._allowed = allow_imports, allow_outside
        self._stopped = threading.Event()
        self._race: Race | None = None
        self._racing: Contestant | None = None
        self._state = "idle"

    def receive(self, request: Any) -> None:
        if request.type == "stop":
            self._stopped.set()
            self._interrupt()
        super().receive(request)

    def _interrupt(self) -> None:
        race, contestant = self._race, self._racing
        if race is not None:
            race.replicates.stop()
        if contestant is not None and contestant.renderer is not None:
            contestant.renderer.stop()

    def start(self) -> None:
        self._message("menu", **menu(self._library))

    def _rest(self) -> None:
        self._set_state("stopped")

    def _on_stop(self, request: Any) -> None:
        self._set_state(self._state)

    def _set_state(self, state: str, activity: str = "", racing: int | None = None) -> None:
        """`racing` is the index of the contestant that renders."""
        self._state = state
        self._send(state_message(state, self._seq, activity=activity, racing=racing))

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
        race = self._race = Race(request, (scene, parameters), self._scratch, self._allowed, self._message)
        self._message("contestants", names=race.names, targets=request.targets, width=request.width, height=request.height)
        try:
            self._set_state("busy", "rendering the reference")
            race.references()
            self._send_references()
            self._prepare()
            self._render_slices(request.slice_seconds)
        except Stopped:
            self._stopped.set()
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
            self._message("reference", pixels, **fields, spp=reference.spp)

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
        self._message(
            "contestant",
            half_floats(contestant.renderer.film),
            contestant=index,
            seconds=contestant.seconds,
            spp=contestant.spp,
            done=contestant.done,
            points=contestant.points,
            crossings=contestant.crossings(),
            phases=contestant.phases,
            rays=clock.rays_traced(contestant.renderer),
        )

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
        self._message("saved", name=request.name, folder=folder, seconds=monotonic() - began)
        self._set_state(state)

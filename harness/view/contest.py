"""A race as an experiment: the same plan, references and events as those of `raybench run`, in a folder of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

from engines.errors import ConfigError
from engines.film import Film
from engines.interface import Renderer
from engines.registry import engine as engine_of
from engines.scene import load_scene
from engines.scene.yaml_file import locate
from harness import config, store
from harness.config.settings import engine_settings
from harness.measure import clock as measure
from harness.plan import planner as plan
from harness.plan.cells import Cell, Plan
from harness.run.sweep import Options, Sweep
from harness.store.results import brief_choice
from harness.view import requests
from harness.view.lane import Lane

KINDS = ("shader", "sampler", "accelerator")


class Stopped(Exception):
    """The race was stopped while its references were made."""


class Listener:
    """Tells the page how references come along."""

    def __init__(self, tell: Callable[..., None]) -> None:
        self._tell = tell

    def note(self, text: str) -> None:
        self._tell("note", text=text)

    def reference(self, name: str, done: int, wanted: int) -> None:
        self._tell("progress", text=f"reference: {name}", done=done, wanted=wanted)

    def cell(self, cell: Cell, number: int, total: int, seconds_left: float) -> None: ...
    def point(self, spp: int, seconds: float) -> None: ...
    def finished(self, cell: Cell, event: Mapping[str, Any]) -> None: ...
    def examination(self, name: str, number: int, total: int) -> None: ...


class Replicates:
    """Renders the images of a reference in this process; `stop` ends it."""

    def __init__(self, allow_imports: bool) -> None:
        self._allow_imports = allow_imports
        self._renderer: Renderer | None = None
        self._stopped = False

    def stop(self) -> None:
        self._stopped = True
        if self._renderer is not None:
            self._renderer.stop()

    def replicates(self, engine: str, request: Mapping[str, Any], seeds: Sequence[int]) -> Iterator[tuple[Film, float]]:
        scene = load_scene(request["scene_path"], allow_imports=self._allow_imports)
        for seed in seeds:
            settings = engine_settings(request["settings"], seed, self._allow_imports)
            self._renderer = measure.prepare(engine_of(engine), scene, settings)[0]
            start = perf_counter()
            film = self._renderer.render(request["spp"]) if not self._stopped else None
            if film is None or film.spp < request["spp"]:
                raise Stopped
            yield film, perf_counter() - start


class Contest:
    """A race that is being run; `folder` becomes a results folder. Raises `RaybenchError` for what cannot be raced."""

    def __init__(
        self, request: requests.Race, scene: Path, folder: Path, allow_imports: bool, tell: Callable[..., None]
    ) -> None:  # fmt: skip
        self.folder, self._allow_imports = folder, allow_imports
        asked = locate(_experiment(request, scene), "race", ConfigError)
        experiment = config.parse(asked, scene.parent, "race", "raybench view")
        made = plan.make(experiment, allow_imports)
        skipped = next((cell.skip for cell in made.cells if cell.skip), None)
        if skipped:
            raise ConfigError(skipped)
        if len(made.cells) < len(request.lanes):
            raise ConfigError("two lanes have the same settings: change one of them")
        for warning in made.warnings:
            tell("note", text=warning)
        self.plan: Plan = made
        self._events = store.Events(folder)
        options = Options(allow_imports=allow_imports, command=["raybench", "view"])
        self.sweep = Sweep(made, folder, options, Listener(tell), self._events)
        self.replicates = Replicates(allow_imports)
        cells = sorted(made.cells, key=lambda cell: _place(cell, request.lanes))
        self.lanes = [Lane(self.sweep.recorder, cell, allow_imports) for cell in cells]
        self.names = _names(cells)

    def references(self) -> None:
        """Makes what is missing. Raises `Stopped`, and `ConfigError` where an engine fails."""
        self.sweep.record_plan()
        self.sweep.make_references(self.replicates)
        failed = [event["message"] for event in self.sweep.recorder.latest.values() if event["state"] == "failed"]
        if failed:
            raise ConfigError(failed[0])

    def close(self) -> None:
        """Writes what the lanes have, once."""
        for lane in self.lanes:
            lane.finish()
        self._events.close()


def _experiment(request: requests.Race, scene: Path) -> dict[str, Any]:
    """The experiment file of a race."""
    lanes = []
    for part in request.lanes:
        lane = {"engine": part.engine, "threads": requests.threads_within(part.threads), "precision": part.precision}
        lanes.append({**lane, **{kind: getattr(part, kind) for kind in KINDS}})
    return {
        "raybench_experiment": 1, "name": "race", "question": "Which lane reaches an error first?", "scene": str(scene),
        "resolution": [request.width, request.height], "repeats": 1, "seed": request.seed, "control": False,
        "include": lanes, "images": "some", "budget": {"max_time": f"{request.max_seconds}s", "max_spp": 2**20},
        "reference": {"engine": request.reference_engine, "spp": request.reference_spp},
        "quality": {"metric": "relmse", "targets": list(request.targets)},
    }  # fmt: skip


def _place(cell: Cell, lanes: Sequence[requests.Part]) -> int:
    """Which lane of the page a cell is: lanes keep the order in which they were asked for."""

    def like(part: requests.Part) -> int:
        same = [cell.engine == part.engine, cell.settings["threads"] == requests.threads_within(part.threads)]
        same.append(part.precision in (None, cell.settings["precision"]))
        same += [getattr(part, kind).items() <= cell.settings[kind].items() for kind in KINDS]
        return sum(same)

    return max(range(len(lanes)), key=lambda index: like(lanes[index]))


def _names(cells: Sequence[Cell]) -> list[str]:
    """Each lane's engine, and of its settings those in which lanes differ; accelerators are told apart by engine."""

    def word(cell: Cell, key: str) -> str:
        others = [other for other in cells if key != "accelerator" or other.engine == cell.engine]
        values = [other.settings[key] for other in others]
        if all(value == cell.settings[key] for value in values):
            return ""
        if key in KINDS:
            return brief_choice(cell.settings[key], values)
        return f"{cell.settings[key]}{' threads' if key == 'threads' else ''}"

    keys = (*KINDS, "precision", "threads")
    return [" ".join(filter(None, [cell.engine_name, *(word(cell, key) for key in keys)])) for cell in cells]

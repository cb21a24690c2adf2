"""A race as an experiment: it has a plan, references and events like `raybench run`, in a results folder of its own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from time import perf_counter
from typing import Any

from engines.errors import ConfigError
from engines.film import Film
from engines.interface import Renderer
from engines.registry import engine as engine_of
from engines.schema.yaml_file import locate
from harness import config, store
from harness.measure import clock
from harness.measure.requests import ReferenceRequest
from harness.plan import planner
from harness.plan.cells import Cell, Plan
from harness.run.sweep import Options, Sweep
from harness.settings import engine_settings
from harness.store import records
from harness.store.results import brief_choice
from harness.view import requests
from harness.view.contestant import Contestant

KINDS = ("shader", "sampler", "accelerator")


class Stopped(Exception):
    """The race was stopped while its references were rendered."""


class Listener:
    """Sends warnings and the progress of references to the page; `send(type, **fields)` sends a message."""

    def __init__(self, send: Callable[..., None]) -> None:
        self._send = send

    def note(self, text: str) -> None:
        self._send("warning", text=text)

    def reference(self, name: str, done: int, count: int) -> None:
        self._send("progress", text=f"reference: {name}", done=done, total=count)

    def cell(self, cell: Cell, number: int, total: int, seconds_left: float) -> None: ...
    def point(self, spp: int, seconds: float, error: float) -> None: ...
    def finished(self, cell: Cell, event: records.AnyCell) -> None: ...
    def verify_job(self, name: str, number: int, total: int) -> None: ...


class Replicates:
    """Renders the images of a reference in this process; after `stop` it raises `Stopped`."""

    def __init__(self, allow_imports: bool) -> None:
        self._allow_imports = allow_imports
        self._renderer: Renderer | None = None
        self._stopped = False

    def stop(self) -> None:
        self._stopped = True
        if self._renderer is not None:
            self._renderer.stop()

    def replicates(self, engine: str, request: ReferenceRequest, seeds: Sequence[int]) -> Iterator[tuple[Film, float]]:
        scene = request.scene.load(self._allow_imports)
        for seed in seeds:
            settings = engine_settings(request.settings, seed, self._allow_imports)
            self._renderer = clock.prepare(engine_of(engine), scene, settings)[0]
            start = perf_counter()
            film = self._renderer.render(request.spp) if not self._stopped else None
            if film is None or film.spp < request.spp:
                raise Stopped
            yield film, perf_counter() - start


class Race:
    """A running race; `folder` becomes its results folder. Raises `RaybenchError` for a request that cannot be raced."""

    def __init__(
        self,
        request: requests.RaceRequest,
        scene: tuple[Path, Mapping[str, str]],
        folder: Path,
        allowed: tuple[bool, bool],
        send: Callable[..., None],
    ) -> None:
        """`scene`: its file, and values of its parameters. `allowed`: imports, and files outside of the scene's folder."""
        self.folder, (allow_imports, allow_outside) = folder, allowed
        located = locate(_experiment(request, *scene), "race", ConfigError)
        experiment = config.parse(located, scene[0].parent, "race", "raybench view")
        self.plan: Plan = planner.make(experiment, allow_imports, allow_outside=allow_outside)
        skipped = next((cell.skip for cell in self.plan.cells if cell.skip), None)
        if skipped:
            raise ConfigError(skipped)
        if len(self.plan.cells) < len(request.contestants):
            raise ConfigError("two contestants have the same settings: change one of them")
        for warning in self.plan.warnings:
            send("warning", text=warning)
        self._events = store.Events(folder)
        options = Options(allow_imports=allow_imports, allow_outside=allow_outside, command=["raybench", "view"])
        self.sweep = Sweep(self.plan, folder, options, Listener(send), self._events)
        self.replicates = Replicates(allow_imports)
        cells = sorted(self.plan.cells, key=lambda cell: _index_of(cell, request.contestants))
        self.contestants = [Contestant(self.sweep.recorder, cell, allow_imports) for cell in cells]
        self.names = _names(cells)

    def references(self) -> None:
        """Renders the references that are missing. Raises `Stopped`, and `ConfigError` where an engine fails."""
        self.sweep.record_plan()
        self.sweep.make_references(self.replicates)
        failed = [event.message for event in self.sweep.recorder.latest.values() if event.state == "failed"]
        if failed:
            raise ConfigError(failed[0])

    def close(self) -> None:
        """Writes the events of the contestants. Call it once."""
        for contestant in self.contestants:
            contestant.finish()
        self._events.close()


def _experiment(request: requests.RaceRequest, scene: Path, parameters: Mapping[str, str]) -> dict[str, Any]:
    """The experiment file of a race."""
    contestants = []
    for chosen in request.contestants:
        settings = {"engine": chosen.engine, "threads": requests.limited_threads(chosen.threads), "precision": chosen.precision}
        contestants.append({**settings, **{kind: getattr(chosen, kind) for kind in KINDS}})
    named = {"file": str(scene), "parameters": dict(parameters)} if parameters else str(scene)
    return {
        "raybench_experiment": 1,
        "name": "race",
        "question": "Which contestant reaches an error first?",
        "scene": named,
        "resolution": [request.width, request.height],
        "repeats": 1,
        "seed": request.seed,
        "aa_twin": False,
        "include": contestants,
        "images": "some",
        "budget": {"max_time": f"{request.max_seconds}s", "max_spp": 2**20},
        "reference": {"engine": request.reference_engine, "spp": request.reference_spp},
        "quality": {"metric": "relmse", "targets": list(request.targets)},
    }


def _index_of(cell: Cell, contestants: Sequence[requests.RenderSettings]) -> int:
    """The index of the contestant in the request that a cell belongs to: the one with the most equal settings."""

    def equal_settings(requested: requests.RenderSettings) -> int:
        settings = cell.settings.describe()
        same = [cell.engine == requested.engine, settings["threads"] == requests.limited_threads(requested.threads)]
        same.append(requested.precision in (None, settings["precision"]))
        same += [getattr(requested, kind).items() <= settings[kind].items() for kind in KINDS]
        return sum(same)

    return max(range(len(contestants)), key=lambda index: equal_settings(contestants[index]))


def _names(cells: Sequence[Cell]) -> list[str]:
    """Names of contestants: the engine, and the settings that differ; accelerators are compared within an engine."""

    def setting_text(cell: Cell, key: str) -> str:
        others = [other for other in cells if key != "accelerator" or other.engine == cell.engine]
        own, values = getattr(cell.settings, key), [getattr(other.settings, key) for other in others]
        if all(value == own for value in values):
            return ""
        if key in KINDS:
            return brief_choice(own, values)
        return f"{own}{' threads' if key == 'threads' else ''}"

    keys = (*KINDS, "precision", "threads")
    return [" ".join(filter(None, [cell.engine_name, *(setting_text(cell, key) for key in keys)])) for cell in cells]

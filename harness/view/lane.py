"""A contestant of a race: one cell, rendered in slices, whose checkpoints are taken down as in `raybench run`."""

from __future__ import annotations

from copy import deepcopy
from time import perf_counter
from typing import Any

from engines.film import Film
from engines.interface import Renderer
from engines.registry import engine as engine_of
from engines.scene import load_scene
from harness.config.settings import engine_settings
from harness.measure import clock as measure
from harness.measure.contention import Disturbance
from harness.measure.pool import Heard
from harness.measure.sentinel import sentinel_seconds
from harness.plan.cells import WARM_UP_SEED, Cell
from harness.run.recorder import CellRecord as Recording
from harness.run.recorder import Recorder as Sweep
from harness.statistics.convergence import first_crossing
from harness.store.results import point_error

FINISHED = ("reached", "at_first")


class Lane:
    """`seconds` are those spent in `render` and nothing else. `done`: the hardest target is reached, or the time is spent."""

    def __init__(self, sweep: Sweep, cell: Cell, allow_imports: bool) -> None:
        self.cell, self._sweep, self._allow_imports = cell, sweep, allow_imports
        self._record = Recording(sweep, cell, sweep.env_id)
        self.renderer: Renderer | None = None
        self.seconds, self.spp, self.done = 0.0, 0, False
        self.points: list[tuple[float, float, int]] = []
        """(seconds, error, spp) of every checkpoint, the error with the reference's noise taken out."""

    def prepare(self) -> None:
        """Takes the phases on a renderer that is dropped, as `measure` has it; then builds the one that races."""
        start = perf_counter()
        scene = load_scene(self.cell.scene.path, allow_imports=self._allow_imports)
        load = perf_counter() - start
        engine, seed = engine_of(self.cell.engine), self.cell.seed
        warm = engine_settings(self.cell.settings, seed + WARM_UP_SEED, self._allow_imports)
        self.renderer, build, compilation = measure.prepare(engine, scene, warm)
        self._seconds_per_sample = measure.one_sample(self.renderer)
        self._hear(did="prepared", load_seconds=load, build_seconds=build, compile_seconds=compilation)
        self.phases = {"build": build, "compile": compilation}
        settings = engine_settings(self.cell.settings, seed, self._allow_imports)
        self.renderer = measure.prepare(engine, scene, settings)[0]
        self._began, self._sentinel = perf_counter(), sentinel_seconds()
        self._rays_before = measure.counters(self.renderer).get("rays", 0.0)
        self._disturbance = Disturbance()
        checkpoints, budget = self._sweep.plan.experiment.checkpoints, self.cell.budget
        schedule = measure.Schedule(checkpoints.ratio, checkpoints.start, budget.max_spp, budget.max_time_seconds)
        self._ahead = measure.checkpoints(schedule)
        self._next = next(self._ahead)
        self._sweep.begin(self.cell)

    def _hear(self, film: Film | None = None, **message: Any) -> None:
        self._record.follow([Heard(message, film)])

    def race(self, seconds: float) -> None:
        """Renders for about that long, and stops at checkpoints on the way to be measured, off the clock."""
        assert self.renderer is not None
        end = self.seconds + seconds
        while not self.done and self.seconds < end:
            left = min(end, self.cell.budget.max_time_seconds) - self.seconds
            fits = max(1, int(left / self._seconds_per_sample))
            spp = min(self._next - self.spp, fits)
            film, elapsed = measure.timed_call(self.renderer.render, spp, self._disturbance)
            if film.spp < self.spp + spp:
                return  # stopped
            self.seconds, self.spp = self.seconds + elapsed, self.spp + spp
            self._seconds_per_sample = max(self.seconds / self.spp, 1e-12)
            spent = self.seconds >= self.cell.budget.max_time_seconds or self.spp >= self.cell.budget.max_spp
            if self.spp == self._next or spent:
                self._checkpoint(film)
            self.done = spent or all(crossing["state"] in FINISHED for crossing in self.crossings())

    def _checkpoint(self, film: Film) -> None:
        rays = measure.counters(self.renderer).get("rays", 0.0) - self._rays_before if self.renderer else 0.0
        # a copy: the film goes on, and its picture is kept until the lane's end
        self._hear(deepcopy(film), did="point", spp=self.spp, seconds=self.seconds, rays=rays)
        error, _ = point_error(self._record.points[-1], self._sweep.metric)
        self.points.append((self.seconds, error, self.spp))
        while self._next <= self.spp:
            self._next = next(self._ahead, self.spp + 1)

    def crossings(self) -> list[dict[str, Any]]:
        """When each target was reached, as reports have it; an error that noise makes negative counts as unknown."""
        times, errors = [point[0] for point in self.points], [point[1] for point in self.points]
        found = []
        for target in self._sweep.plan.experiment.quality.targets or ():
            crossing = first_crossing(times, errors, target)
            found.append({"target": target, "seconds": crossing.x, "state": crossing.state})
        return found

    def finish(self) -> None:
        """Puts the cell's event on disk."""
        if self.renderer is None or not self.points:
            return
        counters = {k: v for k, v in measure.counters(self.renderer).items() if k not in ("build_seconds", "compile_seconds")}
        self._hear(did="end", counters=counters, machine=self._disturbance.report())
        event = self._sweep.measured_as(self._record, (), self._sentinel)
        self._sweep.finish(self.cell, {**event, "wall_seconds": perf_counter() - self._began})

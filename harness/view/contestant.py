"""A contestant of a race: one cell that is rendered in slices, with checkpoints recorded as in `raybench run`."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from time import perf_counter
from typing import Any

from engines.film import Film
from engines.interface import Renderer
from engines.registry import engine as engine_of
from harness.measure import clock
from harness.measure.contention import Disturbance, judged
from harness.measure.messages import End, Point, Prepared
from harness.measure.pool import WorkerMessage
from harness.measure.schedule import Schedule, checkpoints
from harness.metrics import as_error
from harness.plan.cells import WARM_UP_SEED, Cell
from harness.run.recorder import CellRecord, Recorder
from harness.settings import CellSettings, engine_settings
from harness.statistics import crossing_seconds
from harness.statistics.convergence import CLEAR_ERRORS
from harness.store.results import curve_of, point_error

FINISHED = ("reached", "at_first")


class Contestant:
    """`seconds`: time inside `render` alone. `done`: every target is reached, or the budget is used up."""

    def __init__(self, recorder: Recorder, cell: Cell, allow_imports: bool) -> None:
        self.cell = replace(cell, patterns=())  # a race refines one image
        self._recorder, self._allow_imports = recorder, allow_imports
        self._record = CellRecord(recorder, self.cell, recorder.env_id)
        self.renderer: Renderer | None = None
        self.seconds, self.spp, self.done = 0.0, 0, False
        self.points: list[tuple[float, float, int]] = []
        """(seconds, error, spp) of every checkpoint; the error is corrected for the noise of the reference."""

    def prepare(self) -> None:
        """Measures load, build and compile times with one renderer, as `measure` does; races with a second one."""
        start = perf_counter()
        scene = self.cell.scene.load(self._allow_imports)
        load = perf_counter() - start
        engine, seed, chosen = engine_of(self.cell.engine), self.cell.seed, self.cell.settings
        assert isinstance(chosen, CellSettings)
        warm = engine_settings(chosen, seed + WARM_UP_SEED, self._allow_imports)
        self.renderer, build, compilation = clock.prepare(engine, scene, warm)
        self._seconds_per_sample = clock.one_sample(self.renderer)
        self._record.follow([WorkerMessage(Prepared(load, build, compilation))])
        self.phases = {"build": build, "compile": compilation}
        settings = engine_settings(chosen, seed, self._allow_imports)
        self.renderer = clock.prepare(engine, scene, settings)[0]
        self._start = perf_counter()
        self._rays_before = clock.counters(self.renderer).get("rays", 0.0)
        self._disturbance = Disturbance()
        self._checkpoints = checkpoints(Schedule.of(self._recorder.plan.experiment.checkpoints, self.cell.budget))
        self._next_checkpoint = next(self._checkpoints)
        self._recorder.begin(self.cell)

    def race(self, seconds: float) -> None:
        """Renders for about that long. At checkpoints the clock stops while the error is measured."""
        assert self.renderer is not None
        end = self.seconds + seconds
        while not self.done and self.seconds < end:
            left = min(end, self.cell.budget.max_time_seconds) - self.seconds
            fits = max(1, int(left / self._seconds_per_sample))
            spp = min(self._next_checkpoint - self.spp, fits)
            film, elapsed = clock.timed_call(self.renderer.render, spp, self._disturbance)
            if film.spp < self.spp + spp:
                return  # stopped
            self.seconds, self.spp = self.seconds + elapsed, self.spp + spp
            self._seconds_per_sample = max(self.seconds / self.spp, 1e-12)
            used_up = self.seconds >= self.cell.budget.max_time_seconds or self.spp >= self.cell.budget.max_spp
            if self.spp == self._next_checkpoint or used_up:
                self._checkpoint(film)
            self.done = used_up or all(crossing["state"] in FINISHED for crossing in self.crossings())

    def _checkpoint(self, film: Film) -> None:
        rays = clock.counters(self.renderer).get("rays", 0.0) - self._rays_before if self.renderer else 0.0
        # a copy: the film changes, and the image is kept until the contestant ends
        self._record.follow([WorkerMessage(Point(self.spp, self.seconds, rays), deepcopy(film))])
        error, _ = point_error(self._record.points[-1], self._recorder.metric)
        self.points.append((self.seconds, error, self.spp))
        while self._next_checkpoint <= self.spp:
            self._next_checkpoint = next(self._checkpoints, self.spp + 1)

    def crossings(self) -> list[dict[str, Any]]:
        """When each target was reached, and whether the noise of the reference leaves that in doubt, as in reports."""
        metric, cell = self._recorder.metric, self.cell
        curve, crossings = curve_of(self._record.points, metric, cell.smooth_sampler, cell.reproducible), []
        for target in self._recorder.plan.experiment.quality.targets or ():
            crossing = crossing_seconds(curve, as_error(metric, target))
            reliable = crossing.noise <= 1 / CLEAR_ERRORS
            crossings.append({"target": target, "seconds": crossing.x.high, "state": crossing.state, "reliable": reliable})
        return crossings

    def finish(self) -> None:
        """Writes the event of the cell."""
        if self.renderer is None or not self.points:
            return
        counters = {k: v for k, v in clock.counters(self.renderer).items() if k not in ("build_seconds", "compile_seconds")}
        machine = judged(self._disturbance.report(), self.cell.settings.threads)
        self._record.follow([WorkerMessage(End(counters, machine))])
        event = self._recorder.measured_as(self._record, ())
        self._recorder.finish(self.cell, event.replaced(wall_seconds=perf_counter() - self._start))

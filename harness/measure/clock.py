"""The only clock: `perf_counter` from just before `render` until its film can be read. It runs in a worker process.

Phases are taken on a renderer with another seed, which then renders one discarded sample and is dropped; only after
that is the renderer built whose passes are timed. So what is measured is warm, and what it cost to get there is known.
Metrics, files and progress happen between the timed calls, while this process waits for its parent.
"""

from __future__ import annotations

import gc
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from numbers import Real
from time import perf_counter
from typing import Any

from engines.errors import RendererFailed
from engines.film import Film
from engines.interface import Engine, FullPattern, Renderer, Settings
from engines.scene import Scene
from harness.measure.contention import Disturbance
from harness.measure.schedule import OVERSHOOT, Schedule, checkpoints, shortened


@dataclass(slots=True)
class Point:
    """A checkpoint: `seconds` and `rays` are cumulative over the timed calls, or of its own call in `pattern_points`. `rays`
    is None where nobody counts them."""

    spp: int
    seconds: float
    rays: float | None
    film: Film
    counters: Mapping[str, float]


def prepare(engine: Engine, scene: Scene, settings: Settings) -> tuple[Renderer, float, float]:
    """A compiled renderer, with build and compile seconds that add up to what was waited for.

    Where an engine compiles inside `prepare` and says so in its counters, that part is taken as compilation.
    """
    start = perf_counter()
    renderer = engine.prepare(scene, settings)
    prepared = perf_counter()
    lacking = [name for name in ("warm_up", "render", "counters") if not callable(getattr(renderer, name, None))]
    if lacking:
        raise RendererFailed(
            f"the engine's prepare returned {type(renderer).__name__}, which lacks {', '.join(lacking)}: a Renderer is expected"
        )
    inside = counters(renderer).get("compile_seconds", 0.0)
    warming = perf_counter()
    renderer.warm_up()
    warm = perf_counter() - warming
    waited = prepared - start
    inside = min(max(inside, 0.0), waited)
    return renderer, waited - inside, warm + inside


def one_sample(renderer: Renderer) -> float:
    """Seconds of the discarded pass: an estimate of the time of a sample per pixel."""
    start = perf_counter()
    renderer.render(spp=1)
    waited = perf_counter() - start
    return max(reported_seconds(renderer) or waited, 1e-9)


def timed_points(renderer: Renderer, schedule: Schedule, seconds_per_spp: float, disturbance: Disturbance) -> Iterator[Point]:
    """Renders checkpoint after checkpoint until the budget is spent; the caller's work in between is off the clock."""
    done, seconds = 0, 0.0
    gc.collect()  # once: before every pass it would empty the caches that the renderer has filled
    rays_before = rays_traced(renderer)
    for checkpoint in checkpoints(schedule):
        target = shortened(checkpoint, done, seconds, seconds_per_spp, schedule.max_time_seconds)
        if target <= done:
            return
        film, elapsed = _timed_pass(renderer, target - done, disturbance)
        seconds, done = seconds + elapsed, target
        seconds_per_spp = max(seconds / done, 1e-12)
        yield _point(done, seconds, film, renderer, rays_before)
        if seconds >= schedule.max_time_seconds or target < checkpoint:
            return


def pattern_points(
    engine: Engine,
    scene: Scene,
    prepared: Callable[[FullPattern], Settings],
    patterns: Sequence[FullPattern],
    max_time: float,
    seconds_per_spp: float,
    disturbance: Disturbance,
) -> Iterator[Point]:
    """Renders pattern after pattern, each from its first sample on by a renderer of its own, in one call that is timed alone.

    `prepared` gives the settings of a pattern. The last one is the first that takes `max_time`; one that is predicted to take
    `OVERSHOOT` times as long is left out.
    """
    for number, pattern in enumerate(patterns):
        if number and pattern.spp * seconds_per_spp > OVERSHOOT * max_time:
            return
        disturbance.rest()  # what builds and compiles the next renderer is asked for
        renderer, _, _ = prepare(engine, scene, prepared(pattern))
        gc.collect()
        rays_before = rays_traced(renderer)
        film, seconds = _timed_pass(renderer, pattern.spp, disturbance)
        yield _point(pattern.spp, seconds, film, renderer, rays_before)
        del renderer, film  # before the next one is prepared
        if seconds >= max_time:
            return
        seconds_per_spp = max(seconds / pattern.spp, 1e-12)


def _timed_pass(renderer: Renderer, spp: int, disturbance: Disturbance) -> tuple[Film, float]:
    """The film after `spp` more samples, with the seconds that count: an external program's own where it reports them."""
    before = reported_seconds(renderer)
    film, elapsed = timed_call(renderer.render, spp, disturbance)
    return film, elapsed if before is None else (reported_seconds(renderer) or 0.0) - before


def _point(spp: int, seconds: float, film: Film, renderer: Renderer, rays_before: float | None) -> Point:
    found = counters(renderer)
    rays = found.get("rays")
    return Point(spp, seconds, None if rays is None or rays_before is None else rays - rays_before, film, found)


def rays_traced(renderer: Renderer) -> float | None:
    """The rays that the renderer has counted so far; None where it counts none."""
    return counters(renderer).get("rays")


def reported_seconds(renderer: Renderer) -> float | None:
    """Rendering seconds that an external program has reported so far; None where it reports none.

    Waiting for it takes longer.
    """
    return counters(renderer).get("told_seconds")


def timed_call(render: Callable[..., Film], spp: int, disturbance: Disturbance) -> tuple[Film, float]:
    """One call of `render` on the clock, with the garbage collector at rest."""
    gc.disable()
    try:
        disturbance.start()
        start = perf_counter()
        film = render(spp=spp)
        elapsed = perf_counter() - start
        disturbance.stop(elapsed)
    finally:
        gc.enable()
    return film, elapsed


def counters(renderer: Renderer) -> dict[str, float]:
    """The renderer's counters as plain numbers; what is no number is left out.

    Raises `RendererFailed` where there is no mapping, or a number in it is negative or not finite.
    """
    found: Any = renderer.counters()
    if not isinstance(found, Mapping):
        raise RendererFailed(f"the engine's counters returned {type(found).__name__}: a mapping to numbers is expected")
    numbers = {str(key): float(value) for key, value in found.items() if isinstance(value, Real)}
    for key, value in numbers.items():
        if not 0.0 <= value < math.inf:
            raise RendererFailed(f"the engine's counters have {key} = {value}: a finite number from 0 on is expected")
    return numbers

"""What a measuring worker does with its engine: measures a cell, renders references, traces rays.

Each job is called with the engine, its request and the parent's end of the channel.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from time import monotonic, perf_counter
from typing import Any

from engines.choices import Choice
from engines.errors import Unsupported
from harness.measure import clock, films, scratch, tracing
from harness.measure.contention import Disturbance
from harness.measure.messages import End, Go, Parent, Point, Prepared, Traced, Unwritten
from harness.measure.requests import CellRequest, ImageRequest, RayRequest, ReferenceRequest, Request
from harness.settings import engine_settings

TIMED_HERE = ("build_seconds", "compile_seconds")
"""Counters that are not passed on: the phases of the first renderer are what was waited for."""


def cell(engine: Any, request: CellRequest, parent: Parent) -> None:
    """Measures a cell: phases on a renderer that is dropped, then the timed passes on another, or each pattern of its sampler
    on one of its own."""
    scene, load_seconds = loaded(request)
    renderer, build, compilation = clock.prepare(engine, scene, settings_of(request, request.warm_up_seed))
    parent.send(Prepared(load_seconds, build, compilation))
    estimate = clock.one_sample(renderer)
    schedule, disturbance = request.schedule, Disturbance()
    del renderer
    warm_build: float | None = None
    if request.patterns:
        points = clock.pattern_points(
            engine,
            scene,
            lambda each: settings_of(request, request.seed, each.sampler),
            request.patterns,
            schedule.max_time_seconds,
            estimate,
            disturbance,
        )
    else:
        renderer, warm_build, _ = clock.prepare(engine, scene, settings_of(request, request.seed))
        points = clock.timed_points(renderer, schedule, estimate, disturbance)
    counters: dict[str, float] = {}
    for point in points:
        began, ended = disturbance.window
        measured = {"seconds": point.seconds, "rays": point.rays, "began": began, "ended": ended, "alive": disturbance.alive}
        enough = hand_over(parent, engine, point.film, request, point.spp, **measured)
        counters = {key: value for key, value in point.counters.items() if key not in TIMED_HERE}
        if enough:
            break
    disturbance.rest()
    parent.send(End(counters, disturbance.report(), warm_build))


def reference(engine: Any, request: ReferenceRequest, parent: Parent) -> None:
    """Renders `spp` samples per pixel under each seed, handing over a film after each."""
    scene, _ = loaded(request)
    for seed in request.seeds:
        settings = settings_of(request, seed)
        reason = engine.why_not(scene, settings)
        if reason is not None:
            raise Unsupported(reason)
        renderer, _, _ = clock.prepare(engine, scene, settings)
        start = perf_counter()
        film = renderer.render(spp=request.spp)
        hand_over(parent, engine, film, request, request.spp, seconds=perf_counter() - start)
    parent.send(End({}, {}))


def trace(engine: Any, request: RayRequest, parent: Parent) -> None:
    """Traces a set of rays again and again, see `RayRequest`, and leaves the answers to those rays that are to be
    checked."""
    scene, load_seconds = loaded(request)
    rays = tracing.read_rays(request.file)
    tracer, build, first_call = tracing.prepare(engine, scene, request, rays)
    parent.send(Prepared(load_seconds, build, first_call))
    disturbance, began = Disturbance(), monotonic()
    seconds, passes = tracing.timed_passes(tracer, request, rays, disturbance)
    disturbance.rest()
    with written(parent):
        tracing.leave_answers(tracer, request, rays)
    parent.send(Traced(seconds, passes, began, disturbance.window[1], disturbance.alive))
    parent.send(End({}, disturbance.report()))


def loaded(request: Request) -> tuple[Any, float]:
    """The scene with the seconds it took; refused if it is no longer the one that was planned."""
    start = perf_counter()
    scene = request.scene.load(request.allow_imports)
    seconds = perf_counter() - start
    if scene.identity != request.scene_hash:
        raise RuntimeError(f"{request.scene.path}: the scene has changed since the run began")
    return scene, seconds


def settings_of(request: ImageRequest, seed: int, sampler: Any = None) -> Any:
    """The request's settings, with another sampler where one is given."""
    settings = request.settings if sampler is None else replace(request.settings, sampler=Choice.of(sampler))
    return engine_settings(settings, seed, request.allow_imports)


@contextmanager
def written(parent: Parent) -> Iterator[None]:
    """Ends the process, and says why, where the request's file cannot be written."""
    try:
        yield
    except scratch.Unwritten as error:
        parent.send(Unwritten(str(error)))
        os._exit(0)


def hand_over(parent: Parent, engine: Any, film: Any, request: ImageRequest, spp: int, **measured: Any) -> bool:
    """Leaves the film's arrays in the file `request.scratch` and waits until the parent has used them; whether they are
    enough for it."""
    overshoots, settings = bool(getattr(engine, "overshoots", False)), request.settings
    with written(parent):
        films.leave(film, request.scratch, settings.width, settings.height, spp, overshoots)
    parent.send(Point(spp=spp, overshoots=overshoots, **measured))
    return parent.receive(Go).enough

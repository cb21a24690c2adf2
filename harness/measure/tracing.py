"""Rays on the clock: sets of rays traced through `trace` and `occluded`, in a worker process, with the answers kept.

A first call that does not count compiles what the engine compiles. Each pass over the set is then a timed interval of its
own, by the only clock (`measure.clock`).
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np

from engines.choices import shaders_and_samplers
from engines.errors import RendererFailed, Unsupported
from engines.interface import Engine, HasTracer, RayTracer, Settings
from engines.scene import Scene
from harness.measure import clock, scratch
from harness.measure.contention import Disturbance
from harness.measure.requests import RayRequest
from harness.settings import TracerSettings, plugin_or_choice

FIRST_RAYS = 16_384
"""Rays of the call that does not count: enough for engines that share large sets among threads."""
LEAST_PASSES = 2
Arrays = Mapping[str, Any]


def write_rays(path: Path, rays: Any, checked: Any, hard: Any) -> None:
    """Leaves a set (origins, directions, t_max) for workers, the indices of the rays whose answers are expected, and the
    hard rays. Raises `scratch.Unwritten`."""
    sets = {
        f"{prefix}{name}": array
        for prefix, each in (("", rays), ("hard_", hard))
        for name, array in zip(("origins", "directions", "t_max"), each, strict=True)
    }
    scratch.leave(path, checked=checked, **sets)


def read_rays(path: str) -> Arrays:
    """What `write_rays` has left."""
    with np.load(path, allow_pickle=False) as file:
        return {name: file[name] for name in file.files}


def why_not(engine: Engine, scene: Scene, settings: TracerSettings, allow_imports: bool) -> str | None:
    """Why an engine cannot trace rays in a scene, or None."""
    if isinstance(engine, HasTracer):
        return engine.why_not_tracer(scene, _settings(settings, allow_imports))
    found = [engine.why_not(scene, each) for each in _choices(engine, settings, allow_imports)]
    return None if None in found else found[0]


def _settings(settings: TracerSettings, allow_imports: bool, **more: Any) -> Settings:
    accelerator = plugin_or_choice("accelerator", settings.accelerator, allow_imports)
    return Settings(accelerator=accelerator, precision=settings.precision, threads=settings.threads, **more)


def _choices(engine: Engine, settings: TracerSettings, allow_imports: bool) -> list[Settings]:
    """Settings with any shader and sampler: which one does not matter for single rays."""
    return [_settings(settings, allow_imports, **each) for each in shaders_and_samplers(engine)]


def make_tracer(engine: Engine, scene: Scene, settings: TracerSettings, allow_imports: bool) -> RayTracer:
    """What traces rays. Raises `Unsupported` in the engine's words where there is none."""
    if isinstance(engine, HasTracer):
        return engine.tracer(scene, _settings(settings, allow_imports))
    choices = _choices(engine, settings, allow_imports)
    reasons = [engine.why_not(scene, each) for each in choices]
    if None not in reasons:
        raise Unsupported(reasons[0] or "")
    return engine.prepare(scene, choices[reasons.index(None)])


def prepare(engine: Engine, scene: Scene, request: RayRequest, rays: Arrays) -> tuple[RayTracer, float, float]:
    """A tracer, the seconds that building it took, and those of its first call."""
    start = perf_counter()
    tracer = make_tracer(engine, scene, request.settings, request.allow_imports)
    built = perf_counter()
    _answer(tracer, request, rays, slice(0, min(FIRST_RAYS, request.batch or FIRST_RAYS)))
    return tracer, built - start, perf_counter() - built


def timed_passes(tracer: RayTracer, request: RayRequest, rays: Arrays, disturbance: Disturbance) -> tuple[float, int]:
    """Seconds and number of the passes over the whole set."""
    parts = _batches(request, rays)

    def one_pass(spp: int) -> Any:
        for part in parts:
            _call(tracer, request)(rays["origins"][part], rays["directions"][part], rays["t_max"][part])

    seconds, passes = 0.0, 0
    while passes < LEAST_PASSES or seconds < request.max_time_seconds:
        seconds, passes = seconds + clock.timed_call(one_pass, 1, disturbance)[1], passes + 1
    return seconds, passes


def _call(tracer: RayTracer, request: RayRequest) -> Any:
    return tracer.occluded if request.kind == "shadow" else tracer.trace


def leave_answers(tracer: RayTracer, request: RayRequest, rays: Arrays) -> None:
    """Writes the answers to the rays to be checked, traced among all others, and to the hard rays."""
    whole = _answers(tracer, request, rays)
    hard = {name.removeprefix("hard_"): array for name, array in rays.items() if name.startswith("hard_")}
    kept = {name: array[rays["checked"]] for name, array in whole.items()}
    hard_answers = {f"hard_{name}": array for name, array in _answers(tracer, request, hard).items()}
    scratch.leave(request.scratch, **kept, **hard_answers)


def _batches(request: RayRequest, rays: Arrays) -> list[slice]:
    """The rays of each call: one call, of none, where there are none."""
    count = max(1, len(rays["t_max"]))
    batch = request.batch or count
    return [slice(first, first + batch) for first in range(0, count, batch)]


def _answers(tracer: RayTracer, request: RayRequest, rays: Arrays) -> dict[str, Any]:
    """An engine's answers to all rays, asked as in a timed pass."""
    found = [_answer(tracer, request, rays, part) for part in _batches(request, rays)]
    return {name: np.concatenate([each[name] for each in found]) for name in found[0]}


def _answer(tracer: RayTracer, request: RayRequest, rays: Arrays, part: slice) -> dict[str, Any]:
    """An engine's answers as arrays; raises `RendererFailed` where they are not what the interface says."""
    given = [rays[name][part] for name in ("origins", "directions", "t_max")]
    found: Any = _call(tracer, request)(*given)
    if request.kind == "shadow":
        arrays = {"blocked": np.asarray(found)}
    else:
        arrays = {name: np.asarray(getattr(found, name)) for name in ("t", "shape", "primitive")}
    for name, array in arrays.items():
        if array.shape != (len(given[2]),):
            raise RendererFailed(f"its answers to {len(given[2])} rays have {name} of shape {array.shape}")
    return arrays


def bytes_left(request: RayRequest) -> int:
    """Bytes of the answers that `leave_answers` writes: of a ray t, shape and primitive at most."""
    return (request.checked + request.hard) * 3 * 8


def read_answers(path: Path, request: RayRequest) -> Arrays:
    """What `leave_answers` has written: `blocked`, or `t`, `shape` and `primitive`, each also with `hard_` before it. Raises
    `RendererFailed` where that is something else."""
    names = ("blocked",) if request.kind == "shadow" else ("t", "shape", "primitive")
    sizes = {"": request.checked, "hard_": request.hard}
    kinds = {"t": np.float64, "blocked": np.bool_}
    left = scratch.take(path, [prefix + name for name in names for prefix in sizes], bytes_left(request), "answers")
    found = {}
    for name, array in left.items():
        prefix = "hard_" if name.startswith("hard_") else ""
        if array.shape != (sizes[prefix],):
            raise RendererFailed(f"its answers have {name} of shape {array.shape}")
        try:
            found[name] = array.astype(kinds.get(name.removeprefix(prefix), np.int64), casting="same_kind")
        except TypeError as error:
            raise RendererFailed(f"its answers have {name} of dtype {array.dtype}") from error
    return found

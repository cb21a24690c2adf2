"""The process in which things are measured: `python -m harness.measure.worker`, one JSON message a line on its pipes.

A worker belongs to one engine and one block. It imports the engine once (timed) and then forks a child for every cell,
so that a cell finds a fresh process (nothing compiled, loaded or warmed by the cell before it) and imports are paid
once. Where forking is not safe (other systems than Linux, or an engine that started threads on import) it serves one
cell itself and ends, and the parent starts another.

Requests:  {"do": "import", "engine"}   {"do": "cell", ...}   {"do": "reference", ...}   {"do": "go"}
           {"do": "verify", "case", "precision", "accelerator", "quick"}   {"do": "trace", ...}
Answers:   {"did": "import", "seconds", "version", "code", "forks"}   {"did": "prepared", phases}   {"did": "point", ...}
           {"did": "verified", "results"}   {"did": "traced", ...}
           {"did": "end", ...}   {"did": "failed", "message"}   {"did": "idle", "status"}
           {"did": "unwritten", "message"}: a film could not be handed over, which is no failure of the engine
After a point the child waits for "go": the parent measures the error while nothing renders.

Like `harness.processes` it imports the standard library only, so that the time to import an engine is all its own.
"""

from __future__ import annotations

import gc
import json
import os
import signal
import sys
import threading
from time import perf_counter
from typing import Any

from harness.processes import die_with_parent, one_line

TIMED_HERE = ("build_seconds", "compile_seconds")
"""Counters that are not passed on: the phases of the first renderer are what was waited for."""


class Pipes:
    """The parent's ends of stdin and stdout; whatever else prints goes to stderr."""

    def __init__(self) -> None:
        self.requests = open(os.dup(0), "rb", buffering=0)  # noqa: SIM115 (open as long as the process)
        self.answers = os.dup(1)
        os.dup2(2, 1)
        null = os.open(os.devnull, os.O_RDONLY)
        os.dup2(null, 0)

    def receive(self) -> dict[str, Any]:
        """The next request; ends the process when the parent has gone."""
        # Unbuffered on purpose: a forked child must not find, or swallow, what was read ahead.
        line = self.requests.readline()
        if not line:
            os._exit(0)
        return json.loads(line)

    def send(self, **message: Any) -> None:
        data = json.dumps(message).encode() + b"\n"
        while data:
            data = data[os.write(self.answers, data) :]


def main() -> None:
    die_with_parent()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    pipes = Pipes()
    engine: Any = None
    forks = False
    while True:
        request = pipes.receive()
        if request["do"] == "import":
            engine, forks = imported(request, pipes)
        elif forks:
            pipes.send(did="idle", status=in_child(engine, request, pipes))
        else:
            serve(engine, request, pipes)
            pipes.send(did="idle", status=0)
            return


def imported(request: dict[str, Any], pipes: Pipes) -> tuple[Any, bool]:
    """The engine, and whether forking is safe; all else that a cell needs is imported after the clock has stopped."""
    start = perf_counter()
    try:
        from engines.registry import engine as engine_of

        engine = engine_of(request["engine"])
        version = str(engine.version)
        seconds = perf_counter() - start
        from harness.source_hashes import engine_code

        code = engine_code(engine, request["engine"])
    except BaseException as error:
        pipes.send(did="failed", message=one_line(error))
        os._exit(0)
    import engines  # noqa: F401 (so that children find it)
    import harness.measure.clock
    import harness.settings  # noqa: F401

    apart = getattr(engine, "own_process", False)  # that process is one cell's, as a fork would be
    forks = hasattr(os, "fork") and sys.platform == "linux" and threads_now() == 1 and not apart
    gc.collect()
    gc.freeze()
    pipes.send(did="import", seconds=seconds, version=version, code=code, forks=forks)
    return engine, forks


def threads_now() -> int:
    """Threads of this process, those of native libraries included where the system counts them."""
    try:
        return len(os.listdir("/proc/self/task"))
    except OSError:
        return threading.active_count()


def in_child(engine: Any, request: dict[str, Any], pipes: Pipes) -> int:
    """Serves a request in a forked child; the exit status, negative for a signal."""
    child = os.fork()
    if child == 0:
        die_with_parent()
        try:
            serve(engine, request, pipes)
        finally:
            os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])


def serve(engine: Any, request: dict[str, Any], pipes: Pipes) -> None:
    """Answers one request; an exception becomes a message."""
    try:
        {"cell": cell, "reference": reference, "verify": verify, "trace": trace}[request["do"]](engine, request, pipes)
    except BaseException as error:  # sys.exit of an engine is a failure, too
        import contextlib
        import traceback

        with contextlib.suppress(OSError):  # where the log cannot grow
            traceback.print_exc()
        pipes.send(did="failed", message=one_line(error))


def cell(engine: Any, request: dict[str, Any], pipes: Pipes) -> None:
    """Measures a cell: phases on a renderer that is dropped, then the timed passes on another, or each pattern of its sampler
    on one of its own."""
    from engines.interface import FullPattern
    from harness.measure import clock
    from harness.measure.contention import Disturbance
    from harness.measure.schedule import Schedule

    scene, load_seconds = loaded(request)
    renderer, build, compilation = clock.prepare(engine, scene, settings_of(request, request["warm_up_seed"]))
    pipes.send(did="prepared", load_seconds=load_seconds, build_seconds=build, compile_seconds=compilation)
    estimate = clock.one_sample(renderer)
    schedule, disturbance = Schedule(**request["schedule"]), Disturbance()
    patterns = [FullPattern(**each) for each in request["patterns"]]
    del renderer
    again: dict[str, float] = {}
    if patterns:
        points = clock.pattern_points(
            engine,
            scene,
            lambda each: settings_of(request, request["seed"], each.sampler),
            patterns,
            schedule.max_time_seconds,
            estimate,
            disturbance,
        )
    else:
        renderer, again["warm_build_seconds"], _ = clock.prepare(engine, scene, settings_of(request, request["seed"]))
        points = clock.timed_points(renderer, schedule, estimate, disturbance)
    counters: dict[str, float] = {}
    for point in points:
        timed = {"window": disturbance.window, "alive": disturbance.alive}
        hand_over(pipes, engine, point.film, request, point.spp, seconds=point.seconds, rays=point.rays, **timed)
        counters = {key: value for key, value in point.counters.items() if key not in TIMED_HERE}
    disturbance.rest()
    pipes.send(did="end", counters=counters, machine=disturbance.report(), **again)


def reference(engine: Any, request: dict[str, Any], pipes: Pipes) -> None:
    """Renders `spp` samples per pixel under each seed, handing over a film after each."""
    from engines.errors import Unsupported
    from harness.measure import clock

    scene, _ = loaded(request)
    for seed in request["seeds"]:
        settings = settings_of(request, seed)
        reason = engine.why_not(scene, settings)
        if reason is not None:
            raise Unsupported(reason)
        renderer, _, _ = clock.prepare(engine, scene, settings)
        start = perf_counter()
        film = renderer.render(spp=request["spp"])
        hand_over(pipes, engine, film, request, request["spp"], seconds=perf_counter() - start, seed=seed)
    pipes.send(did="end")


def verify(engine: Any, request: dict[str, Any], pipes: Pipes) -> None:
    """Runs one case of the accuracy suite."""

    from harness.verify.subject import Subject
    from harness.verify.suite import CASES, run_case

    case = next(case for case in CASES if case.id == request["case"])
    subject = Subject(engine, request["precision"], request["accelerator"], request["quick"])
    pipes.send(did="verified", results=[dict(result) for result in run_case(case, subject)])
    pipes.send(did="end")


def trace(engine: Any, request: dict[str, Any], pipes: Pipes) -> None:
    """Traces a set of rays again and again until `max_time_seconds` are on the clock, and leaves the answers to those rays
    that are to be checked."""
    from harness.measure import tracing
    from harness.measure.contention import Disturbance

    scene, load_seconds = loaded(request)
    rays = tracing.read_rays(request["rays"])
    tracer, build, first_call = tracing.prepare(engine, scene, request, rays)
    pipes.send(did="prepared", load_seconds=load_seconds, build_seconds=build, compile_seconds=first_call)
    disturbance = Disturbance()
    seconds, passes = tracing.timed_passes(tracer, request, rays, disturbance)
    disturbance.rest()
    tracing.leave_answers(tracer, request, rays)
    window = {"window": disturbance.window, "alive": disturbance.alive}
    pipes.send(did="traced", seconds=seconds, passes=passes, **window)
    pipes.send(did="end", machine=disturbance.report())


def loaded(request: dict[str, Any]) -> tuple[Any, float]:
    """The scene with the seconds it took; refused if it is no longer the one that was planned."""
    from engines.scene import load_scene

    start = perf_counter()
    outside, parameters = request.get("allow_outside", False), request.get("scene_parameters")
    scene = load_scene(request["scene_path"], request["allow_imports"], outside, parameters, natively=True)
    seconds = perf_counter() - start
    if scene.identity != request["scene_hash"]:
        raise RuntimeError(f"{request['scene_path']}: the scene has changed since the run began")
    return scene, seconds


def settings_of(request: dict[str, Any], seed: int, sampler: Any = None) -> Any:
    """The request's settings, with another sampler where one is given."""
    from harness.settings import CellSettings, engine_settings

    settings = request["settings"] if sampler is None else {**request["settings"], "sampler": sampler}
    return engine_settings(CellSettings.of(settings), seed, request["allow_imports"])


def hand_over(pipes: Pipes, engine: Any, film: Any, request: dict[str, Any], spp: int, **message: Any) -> None:
    """Leaves the film's arrays in the file `request["scratch"]` and waits until the parent has used them."""
    from harness.measure.films import Unwritten, leave

    overshoots, settings = bool(getattr(engine, "overshoots", False)), request["settings"]
    try:
        leave(film, request["scratch"], settings["width"], settings["height"], spp, overshoots)
    except Unwritten as error:
        pipes.send(did="unwritten", message=str(error))
        os._exit(0)
    pipes.send(did="point", spp=spp, overshoots=overshoots, **message)
    pipes.receive()


if __name__ == "__main__":
    main()

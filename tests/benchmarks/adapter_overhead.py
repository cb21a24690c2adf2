"""What an adapter costs its peer: `python -m tests.benchmarks.adapter_overhead [--engine mitsuba] [--spp N...] [--rounds N]`.

The peer's own call (`mitsuba.render`, evaluated and waited for; a session of LuxCore that runs until its count of samples is
reached, with the look at it every millisecond that its own examples have) and `render` of the engine take turns in one process,
on the same loaded scene with the same integrator, sampler, size and threads, in mirrored order (native, adapter, adapter,
native). Where a peer takes more samples than it was asked for, seconds are those of a sample that it took. Cycles, in a process
of its own (RAYBENCH_CYCLES_PYTHON), tells the seconds of its own render function, and takes the sampler sobol.
A round is one such turn of four calls. The table gives the median rate of both, and the geometric mean over rounds of the
seconds of the adapter over those of the peer, with the 95 % interval of Student's t for the logarithms: by processor time of
the process, which other processes disturb least, and by the wall clock (cycles: by the wall clock alone). A sampler with
patterns is rendered in whole ones.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import platform
import shlex
import statistics
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from typing import Any, NamedTuple

import scipy.stats  # noqa: F401  libraries of C++ that are loaded after pyluxcore end the process

import engines
from harness.config import paths
from tests.benchmarks.paired import interval

SHADER = {"name": "path_tracer", "max_depth": 6, "rr_depth": 1000}


class Seconds(NamedTuple):
    processor: float
    wall: float


class Pair(NamedTuple):
    """Both ways to take `spp` samples per pixel; each call waits until they are there, and says how many there are."""

    native: Callable[[], float]
    adapter: Callable[[], float]


def mitsuba_native(renderer: Any) -> Callable[[int], float]:
    """Mitsuba's own render call of so many samples per pixel, with what a warm renderer of its engine has loaded."""
    from engines.peers.mitsuba.shaders import path_node

    stage = renderer._stage
    mi, dr = stage.mi, stage.dr
    integrator = mi.load_dict(path_node(stage.settings.shader.options))
    seeds = iter(range(1, 1 << 32))

    def native(spp: int) -> float:
        image = mi.render(stage.loaded, integrator=integrator, spp=spp, seed=next(seeds))
        dr.eval(image)
        dr.sync_thread()
        return spp

    return native


def mitsuba_pair(scene: engines.Scene, settings: engines.Settings, spp: int) -> Pair:
    renderer: Any = engines.engine("mitsuba").prepare(scene, settings)
    renderer.warm_up()
    native = mitsuba_native(renderer)

    def adapter() -> float:
        renderer.render(spp)
        return spp

    return Pair(lambda: native(spp), adapter)


def luxcore_pair(scene: engines.Scene, settings: engines.Settings, spp: int) -> Pair:
    from engines.peers.luxcore import Engine

    renderer: Any = Engine().prepare(scene, settings)  # in this process: what its own process costs is another question
    renderer.warm_up()
    session = renderer._session
    pixels = renderer.film.width * renderer.film.height

    def samples() -> float:
        session.UpdateStats()
        return session.GetStats().Get("stats.renderengine.total.samplecount").GetFloat() / pixels

    def native() -> float:
        session.GetFilm().Clear()
        session.EndSceneEdit()
        while samples() < spp:
            time.sleep(0.001)
        session.BeginSceneEdit()
        return samples()

    def adapter() -> float:
        before = float(renderer.film.counts.mean())
        return float(renderer.render(spp).counts.mean()) - before

    return Pair(native, adapter)


def told_rounds(scene: engines.Scene, settings: engines.Settings, rounds: int, spp: int) -> list[tuple[Seconds, Seconds]]:
    """Of cycles, whose Python is another one: two calls a round, as its own render function took them, and as they took
    here, process boundary included. By the wall clock alone, which stands for both clocks."""
    renderer = engines.engine("engines.peers.cycles:Engine").prepare(scene, settings)
    renderer.warm_up()
    found = []
    for _ in range(rounds):
        before, begin = renderer.counters()["native_seconds"], time.perf_counter()
        for _ in range(2):
            renderer.render(spp)
        wall = time.perf_counter() - begin
        native = renderer.counters()["native_seconds"] - before
        found.append((Seconds(native, native), Seconds(wall, wall)))
    return found


PAIRS = {"mitsuba": mitsuba_pair, "luxcore": luxcore_pair}


def seconds_of(call: Callable[[], float], spp: int) -> Seconds:
    """Of `spp` samples, at the rate of those that the call took."""
    processor, wall = time.process_time(), time.perf_counter()
    share = spp / call()
    return Seconds((time.process_time() - processor) * share, (time.perf_counter() - wall) * share)


def measured(pair: Pair, rounds: int, spp: int) -> list[tuple[Seconds, Seconds]]:
    """Of each round, the seconds of two native calls and of two of the adapter."""
    for call in pair:
        call()
    found = []
    for number in range(rounds):
        first, second = (0, 1) if number % 2 == 0 else (1, 0)
        taken = {0: [], 1: []}
        for which in (first, second, second, first):
            taken[which].append(seconds_of(pair[which], spp))
        found.append(tuple(Seconds(*map(sum, zip(*taken[which], strict=True))) for which in (0, 1)))
    return found


def show(label: str, rounds: list[tuple[Seconds, Seconds]], paths_of_a_round: int) -> None:
    alone = all(side.processor == side.wall for sides in rounds for side in sides)
    for clock in ("wall",) if alone else Seconds._fields:
        native, adapter = ([getattr(side, clock) for side in sides] for sides in zip(*rounds, strict=True))
        mean, low, high = interval([b / a for a, b in zip(native, adapter, strict=True)])
        rates = [paths_of_a_round / statistics.median(side) / 1e6 for side in (native, adapter)]
        line = f"{label:34}{clock:11}{rates[0]:9.3f}{rates[1]:9.3f}{mean:11.4f}   {low:.4f} to {high:.4f}"
        print(line, flush=True)


def machine() -> str:
    """A line on processor and instruction set. Asked in a process of its own: pyluxcore and LLVM conflict."""
    from llvmlite import binding

    from harness.measure.machine import cpu_model

    features = binding.get_host_cpu_features()
    widest = next((name for name in ("avx512f", "avx2", "avx", "sse2", "neon") if features.get(name)), "unknown")
    return f"{cpu_model()}, {os.cpu_count()} cores, {widest} (LLVM target {binding.get_host_cpu_name()})"


def show_head(given: argparse.Namespace) -> None:
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        print(pool.submit(machine).result())
    version = engines.engine(given.engine).version
    print(f"Python {platform.python_version()}, {given.engine} {version}, load {os.getloadavg()[0]:.1f}")
    command = shlex.join(["python", "-m", "tests.benchmarks.adapter_overhead", *sys.argv[1:]])
    print(f"{given.size}x{given.size} pixels, threads {given.threads}, path_tracer {SHADER['max_depth']} deep: {command}")
    print(f"{'million paths/s':34}{'clock':11}{'native':>9}{'adapter':>9}{'seconds':>11}   95 % interval of the ratio")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--engine", choices=[*PAIRS, "cycles"], default="mitsuba")
    parser.add_argument("--scenes", nargs="+", default=["cornell_box"], metavar="NAME", help="names or paths")
    parser.add_argument("--samplers", nargs="+", metavar="NAME", help="default: random; of cycles sobol, the only one it has")
    parser.add_argument("--spp", nargs="+", type=int, default=[4, 16, 64], metavar="N", help="samples per pixel and call")
    parser.add_argument("--size", type=int, default=512, help="pixels a side")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--rounds", type=int, default=8, help="2 or more")
    given = parser.parse_args()
    if given.rounds < 2:
        parser.error("--rounds: 2 or more are expected")
    engine: Any = engines.engine(given.engine)
    show_head(given)
    for name in given.scenes:
        scene = engines.load_scene(paths.find("scenes", name))
        for sampler in given.samplers or ["sobol" if given.engine == "cycles" else "random"]:
            for wanted in given.spp:
                whole = engine.full_pattern({"name": sampler}, wanted) if given.engine == "mitsuba" else None
                spp, chosen = (wanted, sampler) if whole is None else (whole.spp, whole.sampler)
                settings = engines.Settings(
                    given.size, given.size, shader=SHADER, sampler=chosen, threads=given.threads, precision="float32"
                )
                if reason := engine.why_not(scene, settings):
                    parser.error(reason)
                if given.engine == "cycles":
                    rounds = told_rounds(scene, settings, given.rounds, spp)
                else:
                    rounds = measured(PAIRS[given.engine](scene, settings, spp), given.rounds, spp)
                show(f"{name}, {sampler}, {spp} spp", rounds, 2 * spp * given.size**2)


if __name__ == "__main__":
    main()

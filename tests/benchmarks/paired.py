"""Speed of this checkout over another's: `python -m tests.benchmarks.paired BASE [--scenes NAME...] [--rounds N] [--images]`.

    git worktree add ../base COMMIT            # or: mkdir ../base; git archive COMMIT | tar -x -C ../base
    python -m tests.benchmarks.paired ../base --rounds 8

Processes of the two checkouts alternate, in mirrored order (base, this, this, base). In each, one thread renders every
scene several times with warm kernels; its figure is the least process time. A round is one process of each checkout. The
table gives the geometric mean over rounds of paths/s of this checkout over paths/s of the base, with the 95 % interval of
Student's t for the logarithms. `--images` compares the films bit for bit.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import platform
import shlex
import statistics
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

HERE = Path(__file__).resolve().parents[2]
SIDE, DEPTH = 128, 6
RENDERS = 5
IMAGE_SPP = 16


class Case(NamedTuple):
    scene: str
    engine: str
    precision: str
    shader: str = "path_tracer"


CASES = {
    "cornell_box": Case("cornell_box", "numba", "float32"),
    "two_spheres": Case("two_spheres", "numba", "float32"),
    "two_spheres_float64": Case("two_spheres", "numba", "float64"),
    "cornell_mesh": Case("cornell_mesh", "numba", "float32"),
    "living_room": Case("living_room", "numba", "float32"),
    "study": Case("study", "numba", "float32"),
    "whitted_two_spheres": Case("two_spheres", "numba", "float32", "whitted"),
    "embree_cornell_mesh": Case("cornell_mesh", "embree", "float32"),
    "embree_cornell_mesh_float64": Case("cornell_mesh", "embree", "float64"),
}


def renderer_of(case: Case, checkout: Path) -> Any:
    import engines

    if not Path(engines.__file__).is_relative_to(checkout):
        raise SystemExit(f"{engines.__file__} was imported, not that of {checkout}")
    settings = engines.Settings(
        SIDE, SIDE, shader={"name": case.shader, "max_depth": DEPTH}, threads=1, precision=case.precision
    )
    scene = engines.load_scene(checkout / "scenes" / f"{case.scene}.yaml")
    renderer = engines.engine(case.engine).prepare(scene, settings)
    renderer.warm_up()
    return renderer


def process_seconds(renderer: Any, spp: int) -> float:
    since = time.process_time()
    renderer.render(spp)
    return time.process_time() - since


def film_hash(film: Any) -> str:
    arrays = (film.sums, film.squares, film.counts)
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()


def work(checkout: Path, job: dict[str, Any]) -> None:
    """What a process of a checkout does; prints one JSON object, case -> figure."""
    found: dict[str, Any] = {}
    for name in job["cases"]:
        renderer = renderer_of(CASES[name], checkout)
        if job["task"] == "images":
            found[name] = film_hash(renderer.render(IMAGE_SPP))
        elif job["task"] == "samples":  # a pixel, that take about job["seconds"]
            process_seconds(renderer, 4)
            found[name] = max(1, round(job["seconds"] / (process_seconds(renderer, 8) / 8)))
        else:
            spp = job["samples"][name]
            process_seconds(renderer, max(1, spp // 4))
            found[name] = SIDE * SIDE * spp / min(process_seconds(renderer, spp) for _ in range(RENDERS))
    print(json.dumps(found))


def ask(checkout: Path, **job: Any) -> dict[str, Any]:
    """Runs `work` in a process that imports raybench from `checkout`."""
    command = [sys.executable, __file__, str(checkout), "--job", json.dumps(job)]
    paths = {**os.environ, "PYTHONPATH": str(checkout)}
    done = subprocess.run(command, cwd=checkout, env=paths, stdout=subprocess.PIPE, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"the process of {checkout} ended with status {done.returncode}")
    return json.loads(done.stdout.splitlines()[-1])


def measured(base: Path, samples: dict[str, int], rounds: int) -> list[tuple[dict[str, float], dict[str, float]]]:
    """Of each round, paths per second of the base's cases and of this checkout's."""
    found = []
    for number in range(rounds):
        order = (base, HERE) if number % 2 == 0 else (HERE, base)
        rates = {checkout: ask(checkout, task="rates", cases=list(samples), samples=samples) for checkout in order}
        found.append((rates[base], rates[HERE]))
        print(f"round {number + 1} of {rounds}", file=sys.stderr)
    return found


def interval(ratios: list[float]) -> tuple[float, float, float]:
    """(geometric mean, low, high): the 95 % interval of Student's t for the mean of the logarithms."""
    from scipy.stats import t

    logs = [math.log(ratio) for ratio in ratios]
    mean, n = statistics.mean(logs), len(logs)
    half = float(t.ppf(0.975, n - 1)) * statistics.stdev(logs) / math.sqrt(n)
    return math.exp(mean), math.exp(mean - half), math.exp(mean + half)


def show(rounds: list[tuple[dict[str, float], dict[str, float]]]) -> None:
    print(f"{'':30}{'base':>9}{'this':>9}{'this/base':>11}   95 % interval")
    for name in rounds[0][0]:
        base, this = ([side[name] for side in sides] for sides in zip(*rounds, strict=True))
        mean, low, high = interval([b / a for a, b in zip(base, this, strict=True)])
        middle = [statistics.median(side) / 1e6 for side in (base, this)]
        print(f"{name:30}{middle[0]:9.3f}{middle[1]:9.3f}{mean:11.4f}   {low:.4f} to {high:.4f}")
    print("base, this: median million paths per second of process time")


def show_processor() -> None:
    """The processor and the widest vectors of which machine code is made, the load beside it."""
    import llvmlite
    from llvmlite import binding

    from harness.measure.machine import cpu_model

    features = binding.get_host_cpu_features()
    widest = next((name for name in ("avx512f", "avx2", "avx", "sse2", "neon") if features.get(name)), "unknown")
    print(f"{cpu_model()}, {os.cpu_count()} cores, {widest} (LLVM target {binding.get_host_cpu_name()})")
    print(f"Python {platform.python_version()}, llvmlite {llvmlite.__version__}, load {os.getloadavg()[0]:.1f}")


def show_machine() -> None:
    show_processor()
    command = shlex.join(["python", "-m", "tests.benchmarks.paired", *sys.argv[1:]])
    print(f"{SIDE}x{SIDE} pixels, depth {DEPTH}, one thread: {command}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("base", type=Path, metavar="BASE")
    parser.add_argument("--scenes", nargs="+", choices=CASES, default=list(CASES), metavar="NAME", help=", ".join(CASES))
    parser.add_argument("--rounds", type=int, default=6, help="2 or more")
    parser.add_argument("--seconds", type=float, default=0.15, help="of one render")
    parser.add_argument("--images", action="store_true", help="compare films bit for bit, time nothing")
    parser.add_argument("--job", type=json.loads, help=argparse.SUPPRESS)
    given = parser.parse_args()
    base = given.base.resolve()
    if given.job:
        return work(base, given.job)
    if not (base / "engines" / "__init__.py").exists() or given.rounds < 2:
        parser.error(f"{given.base} is no checkout of raybench" if given.rounds > 1 else "--rounds: 2 or more are expected")
    if given.images:
        before, now = (ask(checkout, task="images", cases=given.scenes) for checkout in (base, HERE))
        for name in given.scenes:
            print(f"{name:30} {'equal' if before[name] == now[name] else 'DIFFERENT'}")
        return sys.exit(before != now)
    ask(HERE, task="samples", cases=given.scenes, seconds=0.01)  # fills this checkout's code cache
    samples = ask(base, task="samples", cases=given.scenes, seconds=given.seconds)
    rounds = measured(base, samples, given.rounds)
    show_machine()
    show(rounds)


if __name__ == "__main__":
    main()

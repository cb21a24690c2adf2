"""Speed of this checkout over another's: `python -m tests.benchmarks.paired BASE [--scenes NAME...] [--rounds N] [--images]`.

    git worktree add ../base COMMIT            # or: mkdir ../base; git archive COMMIT | tar -x -C ../base
    python -m tests.benchmarks.paired ../base --rounds 8

A round is one process of each checkout, with warm kernels and one thread. The two render every scene in turn, in mirrored
order (base, this, this, base), a short time each: what slows the machine down meets both. The ratio of a round is the median
over its pairs. The table gives the geometric mean over rounds of paths/s of this checkout over paths/s of the base, with the
95 % interval of Student's t for the logarithms. A scene that the base lacks is taken from this checkout; a file, which numba
renders in float32, is the same for both. `--images` compares the films bit for bit.
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
PAIRS = 20
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
    "hall": Case("hall", "numba", "float32"),
    "classroom": Case("classroom", "numba", "float32"),
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
    shipped = [root / "scenes" / f"{case.scene}.yaml" for root in (checkout, HERE)]
    scene = engines.load_scene(next((file for file in shipped if file.exists()), case.scene))
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


def work(checkout: Path) -> None:
    """What a process of a checkout does: answers each line of JSON, a case and the samples a pixel that it shall render, with
    a line, the seconds that it took; without samples with the hash of a film. What else is printed goes to standard error."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    held, renderer = "", None
    for line in sys.stdin:
        name, spp = json.loads(line)
        if name != held:
            renderer = None  # the last one is freed first
            held, renderer = name, renderer_of(CASES.get(name, Case(name, "numba", "float32")), checkout)
        found = process_seconds(renderer, spp) if spp else film_hash(renderer.render(IMAGE_SPP))
        print(json.dumps(found), file=answers, flush=True)


class Worker:
    """A process that imports raybench from `checkout`, and does `work`."""

    def __init__(self, checkout: Path) -> None:
        command = [sys.executable, __file__, str(checkout), "--work"]
        paths = {**os.environ, "PYTHONPATH": str(checkout)}
        self.checkout = checkout
        self.process = subprocess.Popen(
            command, cwd=checkout, env=paths, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )

    def ask(self, name: str, spp: int) -> Any:
        try:
            self.process.stdin.write(json.dumps((name, spp)) + "\n")
            answer = self.process.stdout.readline()
        except BrokenPipeError:
            answer = ""
        if not answer:
            raise SystemExit(f"the process of {self.checkout} ended with status {self.process.wait()}")
        return json.loads(answer)

    def end(self) -> None:
        self.process.stdin.close()
        self.process.wait()


class Round(NamedTuple):
    """Of one case: paths per second of the base and of this checkout, and the latter over the former, medians over pairs."""

    base: float
    this: float
    ratio: float


def measured(base: Worker, this: Worker, name: str, seconds: float) -> Round:
    """A round of a case, whose renders take about so many seconds."""
    for worker in (this, base):  # warm
        worker.ask(name, 8)
    spp = max(1, round(seconds / (base.ask(name, 8) / 8)))
    pairs = []
    for number in range(PAIRS):
        order = (base, this) if number % 2 == 0 else (this, base)
        took = {worker: worker.ask(name, spp) for worker in order}
        pairs.append((took[base], took[this]))
    middle = [SIDE * SIDE * spp / statistics.median(side) for side in zip(*pairs, strict=True)]
    return Round(*middle, statistics.median(before / after for before, after in pairs))


def interval(ratios: list[float]) -> tuple[float, float, float]:
    """(geometric mean, low, high): the 95 % interval of Student's t for the mean of the logarithms."""
    from scipy.stats import t

    logs = [math.log(ratio) for ratio in ratios]
    mean, n = statistics.mean(logs), len(logs)
    half = float(t.ppf(0.975, n - 1)) * statistics.stdev(logs) / math.sqrt(n)
    return math.exp(mean), math.exp(mean - half), math.exp(mean + half)


def show(rounds: dict[str, list[Round]]) -> None:
    print(f"{'':30}{'base':>9}{'this':>9}{'this/base':>11}   95 % interval")
    for name, found in rounds.items():
        mean, low, high = interval([one.ratio for one in found])
        base, this = (statistics.median(getattr(one, side) for one in found) / 1e6 for side in ("base", "this"))
        print(f"{name:30}{base:9.3f}{this:9.3f}{mean:11.4f}   {low:.4f} to {high:.4f}")
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
    parser.add_argument("--scenes", nargs="+", default=list(CASES), metavar="NAME", help=f"{', '.join(CASES)}; or files")
    parser.add_argument("--rounds", type=int, default=6, help="2 or more")
    parser.add_argument("--seconds", type=float, default=0.06, help="of one render")
    parser.add_argument("--images", action="store_true", help="compare films bit for bit, time nothing")
    parser.add_argument("--work", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    base = given.base.resolve()
    if given.work:
        return work(base)
    given.scenes = [name if name in CASES else str(Path(name).resolve()) for name in given.scenes]
    if not (base / "engines" / "__init__.py").exists() or given.rounds < 2:
        parser.error(f"{given.base} is no checkout of raybench" if given.rounds > 1 else "--rounds: 2 or more are expected")
    if missing := [name for name in given.scenes if name not in CASES and not Path(name).exists()]:
        parser.error(f"--scenes: there is no file {missing[0]}; expected are files or names: {', '.join(CASES)}")
    rounds: dict[str, list[Round]] = {name: [] for name in given.scenes}
    differ = False
    for number in range(1 if given.images else given.rounds):
        workers = Worker(base), Worker(HERE)
        for name in given.scenes:
            if given.images:
                before, now = (worker.ask(name, 0) for worker in workers)
                differ |= before != now
                print(f"{name:30} {'equal' if before == now else 'DIFFERENT'}")
            else:
                rounds[name].append(measured(*workers, name, given.seconds))
        for worker in workers:
            worker.end()
        if not given.images:
            print(f"round {number + 1} of {given.rounds}", file=sys.stderr)
    if given.images:
        return sys.exit(differ)
    show_machine()
    show(rounds)


if __name__ == "__main__":
    main()

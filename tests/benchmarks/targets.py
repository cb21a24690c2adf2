"""Speed targets besides paths: `python tests/benchmarks/targets.py [ROW...]`. Rays against embreex's own loop, trees and their
memory, growth with size, threads, first pixels, each as one line. Paths against Mitsuba are in `speed.py`.

Contestants of a row take turns; each figure is the median over the turns, of seconds by the wall clock. So the machine must be
idle; `first` gives processor time as well.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import engines

TURNS = 5
RAYS = 1_000_000


def sphere_mesh(subdivisions: int) -> engines.Scene:
    """20 x 4^subdivisions triangles; 7 gives 327,680."""
    return engines.scene_from(
        {
            "raybench_scene": 1,
            "camera": {
                "type": "perspective",
                "eye": [0, 0, 3],
                "target": [0, 0, 0],
                "up": [0, 1, 0],
                "fov": 40,
                "resolution": [1000, 1000],
            },
            "materials": {"white": {"kd": 0.5}},
            "shapes": [{"procedural": {"name": "tessellated_sphere", "subdivisions": subdivisions}, "material": "white"}],
            "lights": [{"environment": {"radiance": 1}}],
        }
    )


def prepared(engine: str, scene: engines.Scene, accelerator: Any = "auto", threads: int = 2, **more: Any) -> Any:
    settings = engines.Settings(accelerator=accelerator, threads=threads, precision="float32", **more)
    renderer = engines.engine(engine).prepare(scene, settings)
    renderer.warm_up()
    return renderer


def incoherent(n: int) -> tuple[Any, Any]:
    """Rays from a sphere of twice the mesh's radius through random points within it."""
    rng = np.random.default_rng(1)
    start, through = rng.normal(size=(2, n, 3))
    start *= 2 / np.linalg.norm(start, axis=1, keepdims=True)
    through *= rng.random((n, 1)) ** (1 / 3) / np.linalg.norm(through, axis=1, keepdims=True)
    way = through - start
    return start, way / np.linalg.norm(way, axis=1, keepdims=True)


def coherent(n: int) -> tuple[Any, Any]:
    """Camera rays, row by row of a square image that the mesh fills."""
    side = int(n**0.5)
    x, y = np.meshgrid(*(np.linspace(-0.3, 0.3, side),) * 2)
    way = np.stack([x.ravel(), -y.ravel(), np.full(side * side, -1.0)], axis=1)
    return np.tile([0.0, 0.0, 3.0], (side * side, 1)), way / np.linalg.norm(way, axis=1, keepdims=True)


def in_turns(calls: dict[str, Callable[[], Any]]) -> dict[str, float]:
    """Median seconds of each call."""
    seconds: dict[str, list[float]] = {name: [] for name in calls}
    for call in calls.values():
        call()
    for turn in range(TURNS):
        for name in list(calls)[:: 1 if turn % 2 else -1]:
            start = time.perf_counter()
            calls[name]()
            seconds[name].append(time.perf_counter() - start)
    return {name: statistics.median(found) for name, found in seconds.items()}


def report(what: str, ratio: float, wanted: str, detail: str = "") -> None:
    print(f"{what:64} {ratio:8.3g}   {wanted:12} {detail}", flush=True)


def plain_embree(scene: engines.Scene) -> tuple[Any, Any]:
    """embreex's own scene of a mesh, and the mesh, which must be kept."""
    from embreex.mesh_construction import TriangleMesh
    from embreex.rtcore_scene import EmbreeScene

    mesh: Any = scene.shapes[0]
    theirs = EmbreeScene(robust=True)
    return theirs, TriangleMesh(theirs, mesh.vertices[mesh.faces].astype(np.float32))


def trace() -> None:
    """Incoherent and camera rays on 327,680 triangles."""
    scene = sphere_mesh(7)
    theirs, kept = plain_embree(scene)
    (origins, directions), eye = incoherent(RAYS), coherent(RAYS)
    narrow = origins.astype(np.float32), directions.astype(np.float32)
    embree, numba = prepared("embree", scene), prepared("numba", scene, "bvh")
    found = in_turns(
        {
            "embreex.run": lambda: theirs.run(*narrow, query="INTERSECT"),
            "embree": lambda: embree.trace(origins, directions),
            "numba bvh": lambda: numba.trace(origins, directions),
            "embree, camera": lambda: embree.trace(*eye),
            "numba bvh, camera": lambda: numba.trace(*eye),
        }
    )
    del kept
    rate = {name: RAYS / seconds / 1e6 for name, seconds in found.items()}
    detail = ", ".join(f"{name} {value:.2f}" for name, value in rate.items()) + " million rays/s"
    report("trace, embree on 2 threads over embreex.run", rate["embree"] / rate["embreex.run"], ">= 1.9", detail)
    report("trace, numba bvh over embree", rate["numba bvh"] / rate["embree"], ">= 0.8")
    report("trace, embree, camera rays over incoherent", rate["embree, camera"] / rate["embree"], ">= 1.5")


def build() -> None:
    """Seconds that prepare spends on the tree."""
    built = {"embree": ("embree", "embree")} | {q: ("numba", {"name": "bvh", "quality": q}) for q in ("fast", "high")}
    for subdivisions, wanted in ((7, {"fast": "<= 0.05 s", "high": "<= 0.5 s"}), (8, {"fast": "<= 0.79 s", "high": "none"})):
        scene, faces = sphere_mesh(subdivisions), 20 * 4**subdivisions
        seconds: dict[str, list[float]] = {label: [] for label in built}
        for _ in range(TURNS):
            for label, (engine, accelerator) in built.items():
                renderer = prepared(engine, scene, accelerator)
                seconds[label].append(renderer._accelerator.build_seconds)
        found = {label: statistics.median(values) for label, values in seconds.items()}
        size = renderer.counters()["accelerator_bytes"] / faces
        for quality, goal in wanted.items():
            detail = f"embree {found['embree']:.3f} s" + (f"; {size:.0f} bytes a triangle" if quality == "high" else "")
            report(f"build of {faces:,} triangles, numba bvh {quality}, s", found[quality], goal, detail)


def growth() -> None:
    """Cost of an incoherent ray from 20,480 to 1,310,720 triangles."""
    origins, directions = incoherent(RAYS // 4)
    for engine, name, wanted in (("numba", "bvh", "<= 2.35"), ("embree", "embree", "<= 2")):
        small, large = (prepared(engine, sphere_mesh(k), name) for k in (5, 8))
        found = in_turns(
            {
                "small": lambda small=small: small.trace(origins, directions),
                "large": lambda large=large: large.trace(origins, directions),
            }
        )
        report(f"cost of a ray, 1.3e6 over 2e4 triangles, {engine}", found["large"] / found["small"], wanted)
    narrow = origins.astype(np.float32), directions.astype(np.float32)
    (small, _one), (large, _other) = (plain_embree(sphere_mesh(k)) for k in (5, 8))
    found = in_turns(
        {"small": lambda: small.run(*narrow, query="INTERSECT"), "large": lambda: large.run(*narrow, query="INTERSECT")}
    )
    report("the same of embreex.run, one thread", found["large"] / found["small"], "-")


def threads() -> None:
    scene, shader = engines.load_scene("cornell_box"), {"name": "path_tracer", "max_depth": 6, "rr_depth": 1000}
    size = {"width": 512, "height": 512, "shader": shader, "sampler": "sobol"}
    for engine, name in (("numba", "auto"), ("numba", "bvh"), ("embree", "auto")):
        one, two = (prepared(engine, scene, name, k, **size) for k in (1, 2))
        found = in_turns({"one": lambda one=one: one.render(8), "two": lambda two=two: two.render(16)})
        report(f"speed-up with 2 threads, {engine} {name}", 2 * found["one"] / found["two"], ">= 1.85")


class Start(NamedTuple):
    """Seconds by the wall clock, and of all processes together."""

    wall: float
    processor: float


def started(code: str, cache: str) -> Start:
    """What a new Python process takes that runs `code`, with this folder as its cache of machine code."""
    before, since = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([sys.executable, "-c", code], check=True, env={**os.environ, "NUMBA_CACHE_DIR": cache})
    wall, after = time.perf_counter() - since, resource.getrusage(resource.RUSAGE_CHILDREN)
    return Start(wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)


def first() -> None:
    """New processes: importing the library; the first pixel of `cornell_box` (numba, path_tracer, float32) with an empty cache
    of machine code, and with a full one."""
    pixel = (
        "import engines; settings = engines.Settings(8, 8, shader='path_tracer', precision='float32'); "
        "engines.engine('numba').prepare(engines.load_scene('cornell_box'), settings).render(1)"
    )
    rows = {
        "import engines": ("import engines", "< 0.4 s"),
        "first pixel, empty cache": (pixel, "<= 5 s"),
        "first pixel, full cache": (pixel, "<= 1 s"),
    }
    found: dict[str, list[Start]] = {what: [] for what in rows}
    for _ in range(TURNS):
        with tempfile.TemporaryDirectory() as cache:
            for what, (code, _) in rows.items():
                found[what].append(started(code, cache))
    for what, (_, wanted) in rows.items():
        wall, processor = (statistics.median(clock) for clock in zip(*found[what], strict=True))
        report(f"new process, {what}, s", wall, wanted, f"processor time {processor:.2f} s")


def numpy() -> None:
    rays = incoherent(65_536)
    renderer = engines.engine("numpy").prepare(sphere_mesh(4), engines.Settings(accelerator="bvh"))
    found = in_turns({"it": lambda: renderer.trace(*rays)})
    report("numpy bvh, 5,120 triangles, million rays/s", len(rays[0]) / found["it"] / 1e6, ">= 0.3")


def memory() -> None:
    """Peak of a process that draws 1.3 million triangles at 1920 x 1080 with embree."""
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); import targets; "
        "targets.prepared('embree', targets.sphere_mesh(8), width=1920, height=1080).render(1); "
        # not getrusage: a child's begins with what its parent held
        "print(next(int(line.split()[1]) for line in open('/proc/self/status') if line.startswith('VmHWM')) / 2**20)"
    )
    command = [sys.executable, "-c", code, os.path.dirname(os.path.abspath(__file__))]
    peak = float(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
    report("peak memory, 1.3e6 triangles, 1920x1080, embree, GiB", peak, "< 1.2")


ROWS = {f.__name__: f for f in (trace, build, growth, threads, first, numpy, memory)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("rows", nargs="*", default=list(ROWS), help=", ".join(ROWS))
    for name in parser.parse_args().rows:
        ROWS[name]()


if __name__ == "__main__":
    main()

"""Whether the compiled engines of two checkouts render the same films, bit for bit.

    python -m tests.benchmarks.film_hashes BEFORE.json              # in one checkout
    python -m tests.benchmarks.film_hashes --against BEFORE.json    # in the other

It renders small films of every scene in `scenes/` with numba and embree in both precisions, and of some scenes with every
shader, sampler, accelerator and option of the path tracer.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

SCENES = Path("scenes")
SIDE, SPP = 32, 6
PATH = {"name": "path_tracer", "max_depth": 5, "rr_depth": 3}
VARIED = ("two_spheres", "still_life", "veach_plates", "lattice")
SHADERS: tuple[dict[str, Any], ...] = (
    {"name": "whitted", "max_depth": 4},
    {"name": "no_shadows"},
    {"name": "depth_map"},
    {"name": "albedo"},
    PATH | {"direct": "light"},
    PATH | {"direct": "bsdf"},
    PATH | {"transparent_shadows": True},
    PATH | {"hide_emitters": True},
    PATH | {"light_candidates": 4},
    PATH | {"light_sampler": "power"},
    PATH | {"light_sampler": "bvh"},
    PATH | {"light_sampler": "spatial"},
    PATH | {"guiding": "sd_tree"},
)
SAMPLERS = ("stratified", "sobol", "halton", "constant")
ACCELERATORS = ("none", "bvh", "grid", "area_hierarchy")


def cases() -> Iterator[dict[str, Any]]:
    """Scenes with engine, precision, shader, sampler and accelerator."""
    plain = {"shader": PATH, "sampler": "random", "accelerator": "auto", "precision": "float32", "engine": "numba"}
    scenes = sorted(path.name for path in SCENES.iterdir() if path.suffix in (".yaml", ".xml"))
    for scene in scenes:
        for engine in ("numba", "embree"):
            for precision in ("float32", "float64"):
                yield plain | {"scene": scene, "engine": engine, "precision": precision}
    for name in VARIED:
        one = plain | {"scene": f"{name}.yaml"}
        yield from (one | {"shader": shader} for shader in SHADERS)
        yield from (one | {"sampler": sampler} for sampler in SAMPLERS)
        yield from (one | {"accelerator": accelerator} for accelerator in ACCELERATORS)
        yield one | {"engine": "embree", "shader": SHADERS[0], "precision": "float64"}


def film_hash(case: dict[str, Any]) -> str:
    """The hash of a case's film, or what the engine says against it."""
    import engines

    given = dict(case)
    scene, engine = given.pop("scene"), given.pop("engine")
    try:
        settings = engines.Settings(SIDE, SIDE, threads=1, seed=7, **given)
        film = engines.engine(engine).prepare(engines.load_scene(SCENES / scene), settings).render(SPP)
    except (engines.Unsupported, engines.ConfigError) as error:
        return f"{type(error).__name__}: {error}"
    return hashlib.sha256(b"".join(array.tobytes() for array in (film.sums, film.squares, film.counts))).hexdigest()[:16]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", nargs="?", type=Path, help="file to write")
    parser.add_argument("--against", type=Path, help="file of another checkout")
    parser.add_argument("--only", default="", help="cases whose text contains this")
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    chosen = {json.dumps(case): case for case in cases() if given.only in json.dumps(case)}
    with ProcessPoolExecutor(given.processes) as pool:
        found = dict(zip(chosen, pool.map(film_hash, chosen.values()), strict=True))
    if given.out:
        given.out.write_text(json.dumps(found, indent=1))
    if given.against is None:
        return 0
    before = json.loads(given.against.read_text())
    differ = [key for key, value in found.items() if before.get(key) != value]
    for key in differ:
        print(f"differs: {key}: {before.get(key)} before, {found[key]} now")
    print(f"{len(found) - len(differ)} of {len(found)} films are equal")
    return 1 if differ else 0


if __name__ == "__main__":
    sys.exit(main())

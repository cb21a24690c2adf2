"""A results folder made of numbers with known truth: three engines, two scenes, two samplers, five seeds, and trouble.

Errors follow level * spp^(2 * slope) with lognormal noise over seeds; times are seconds per sample times a drift of the
block. `embree` is 3 % too bright on `two_spheres`. One cell failed, one timed out, one engine lacks a feature.
"""

import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.store import validation
from harness.store.events import line_of
from harness.store.records import Manifest
from harness.store.results import Results, results_of
from harness.store.validation import FORMAT_VERSION

SLOPES = {"random": -0.5, "sobol": -0.7}
SECONDS_PER_SPP = {"numpy": 0.4, "numba": 0.02, "embree": 0.0125}
COMPILE_SECONDS = {"numpy": 0.0, "numba": 2.5, "embree": 3.1}
BUILD_SECONDS = {"numpy": 0.05, "numba": 0.01, "embree": 0.004}
SCENES = {"cornell_box": 0.5, "two_spheres": 0.2}
"""Scene: relMSE at one sample per pixel."""
TARGETS = [1e-1, 1e-2, 1e-3]
SPP = [2**k for k in range(9)]
BIASED = ("two_spheres", "embree")
BIAS = 0.03


class Size(NamedTuple):
    width: int = 48
    height: int = 36


SMALL = Size()


def picture(scene: str, size: Size) -> np.ndarray:
    """A smooth radiance image (h, w, 3) with two discs and a bright lamp; the scenes differ."""
    y, x = np.mgrid[0 : size.height, 0 : size.width]
    u, v = (x + 0.5) / size.width, (y + 0.5) / size.height
    turn = 0.0 if scene == "cornell_box" else 1.0
    image = np.stack([0.3 + 0.4 * (u if turn else 1 - u), 0.3 + 0.3 * v, 0.25 + 0.4 * (1 - u if turn else u)], axis=2)
    for cx, cy, r, colour in ((0.33, 0.6, 0.18, (0.7, 0.2, 0.15)), (0.7, 0.65, 0.15, (0.15, 0.3, 0.8))):
        image[np.hypot((u - cx) * size.width / size.height, v - cy) < r] = colour
    image[(abs(u - 0.5) < 0.12) & (v < 0.1)] = (6, 5, 3)
    return image


def write_folder(folder: Path, size: Size = SMALL, seeds: int = 5, with_images: bool = True, threads=(1, 2)) -> Path:
    """Writes manifest, events, references and images; returns the folder."""
    rng = np.random.default_rng(42)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "manifest.json").write_text(json.dumps(manifest()))
    events = [
        {
            "event": "run",
            "time": "2026-11-21T03:00:00Z",
            "run_id": "r1",
            "config_name": "synthetic",
            "command": ["raybench", "run", "synthetic.yaml"],
        },
        {"event": "targets", "metric": "relmse_e0.01", "targets": TARGETS},
    ]
    events += [write_reference(folder, scene, size, rng) for scene in SCENES]
    drift = rng.lognormal(0, 0.05, seeds)
    for block in range(seeds):
        for case in rng.permutation(np.array(list(cases(threads)), dtype=object)):
            cell = done_cell(folder, tuple(case), block, float(drift[block]), size, rng, with_images)
            events.append(cell | {"order": len(events)})
        events += troubles(block, size)
    with (folder / "events.jsonl").open("w") as file:
        file.writelines(json.dumps(event) + "\n" for event in events)
    return folder


def write_reported(folder: Path) -> Path:
    """A folder of three seeds with everything that is derived from it; returns the report's path."""
    from harness.report import write_derived

    return write_derived(write_folder(folder, Size(64, 48), seeds=3))


def arranged(folder: Path, events: Iterable[Mapping[str, Any]], config: Mapping[str, Any] | None = None) -> Results:
    """The results of events that are plain data, and of a manifest that has no more than this of a config."""
    manifest = Manifest(raybench_results=FORMAT_VERSION, config={"raybench_experiment": 1, "include": [], **(config or {})})
    return results_of(folder, manifest, [validation.event(event, "an event") for event in events])


def cases(threads):
    """(scene, engine, accelerator, sampler, threads, label) of the cells that work."""
    for scene in SCENES:
        for sampler in SLOPES:
            yield scene, "numpy", "bvh", sampler, 1, None
            for engine in ("numba", "embree"):
                for count in threads:
                    yield scene, engine, "bvh" if engine == "numba" else "embree", sampler, count, None
        yield scene, "numba", "bvh", "random", 1, "A/A"


def base_cell(case, block, size):
    scene, engine, accelerator, sampler, threads, label = case
    return {
        "event": "cell",
        "cell_id": "-".join(map(str, (*case, block))).replace("/", ""),
        "env_id": "env0",
        "label": label,
        "state": "done",
        "message": "",
        "block": block,
        "order": 0,
        "seed": 1000 + block,
        "scene": scene,
        "scene_hash": "s" + scene,
        "engine": engine,
        "engine_version": "1.0",
        "shader": {"name": "path_tracer", "max_depth": 6},
        "sampler": {"name": sampler},
        "accelerator": {"name": accelerator},
        "precision": "float64",
        "threads": threads,
        "width": size.width,
        "command": f"raybench render {scene} --engine {engine} --seed {1000 + block} -o image.exr",
        "height": size.height,
        "reference_id": reference_id(scene, size),
        "phases": {},
        "points": [],
        "counters": {},
        "smooth_sampler": sampler == "random",
        "reproducible": True,
        "machine": {"load_1m": 0.5, "steal_seconds": 0.0, "involuntary_switches": 3, "contended": False},
    }


def done_cell(folder, case, block, drift, size, rng, with_images):
    scene, engine, _, sampler, threads, _ = case
    cell = base_cell(case, block, size)
    serial = 0.1
    per_spp = SECONDS_PER_SPP[engine] * drift * (serial + (1 - serial) / threads) * rng.lognormal(0, 0.01)
    luck = rng.lognormal(0, 0.03)
    biased = BIAS**2 if (scene, engine) == BIASED else 0.0
    for spp in SPP:
        if spp * per_spp > 12:
            break
        error = SCENES[scene] * luck * spp ** (2 * SLOPES[sampler]) * rng.lognormal(0, 0.02) + biased
        keep = with_images and spp in (4, 16, 64, 256)
        image = write_image(folder, cell, spp, error - biased, size, rng) if keep else None
        cell["points"].append(
            {
                "spp": spp,
                "seconds": spp * per_spp,
                "rays": spp * size.width * size.height * 7,
                "metrics": metrics(error),
                "image": image,
            }
        )
    cell["phases"] = {
        "import_seconds": 0.8,
        "load_seconds": 0.05,
        "build_seconds": BUILD_SECONDS[engine],
        "compile_seconds": COMPILE_SECONDS[engine],
        "render_seconds": cell["points"][-1]["seconds"],
    }
    cell["counters"] = {"rays": cell["points"][-1]["rays"], "accelerator_bytes": 4096.0}
    return cell


def metrics(error):
    return {
        "relmse_e0.01": error * 1.01,
        "relmse_e0.01_corrected": error,
        "relmse_e0.01_se": 1e-5 + error * 0.02,
        "relmse_e0.01_trimmed": error * 0.9,
        "mse": error * 0.3,
        "mse_corrected": error * 0.29,
        "mse_se": error * 0.006,
        "mae": error**0.5,
        "mape": error**0.5,
        "smape": error**0.5,
        "psnr": -10 * np.log10(error * 0.2),
        "ssim": float(1 / (1 + error)),
        "nonfinite": 0.0,
        "mean_r": 0.5,
        "mean_g": 0.5,
        "mean_b": 0.5,
    }


def troubles(block, size):
    """Cells that did not make it: skipped, failed (first block) and timed out (last blocks)."""
    skipped = base_cell(("two_spheres", "numba", "grid", "random", 1, None), block, size)
    skipped.update(state="skipped", message='grid <small> cannot hold infinite planes & has "no" fallback')
    timeout = base_cell(("cornell_box", "numpy", "none", "random", 1, None), block, size)
    timeout.update(state="timeout", message="no answer within 5m")
    failed = base_cell(("cornell_box", "mitsuba", "auto", "random", 2, None), block, size)
    failed.update(state="failed", message="ImportError: No module named 'mitsuba'")
    return [skipped, timeout, *([failed] if block == 0 else [])]


def manifest():
    return {
        "raybench_results": FORMAT_VERSION,
        "config": {
            "raybench_experiment": 1,
            "name": "synthetic",
            "resolution": [48, 36],
            "include": [],
            "repeats": 5,
            "equivalence": {"image": 0.02, "tile": 0.5},
            "quality": {"metric": "relmse", "epsilon": 0.01, "targets": TARGETS},
        },
        "command": ["raybench", "run", "synthetic.yaml"],
        "git": {"commit": "0123abc", "dirty": True},
        "versions": {"python": "3.12", "numpy": "2.4", "numba": "0.68"},
        "machine": {"cpu": "Synthetic 2-core at 3 GHz", "cores": 2, "memory_gib": 8.0, "system": "Linux"},
    }


def write_image(folder, cell, spp, error, size, rng):
    """The scene's picture under noise whose relMSE is `error`, times the bias of the biased engine."""
    from engines.image import write_image as write

    truth = picture(cell["scene"], size)
    noise = (rng.gamma(0.5, 1.0, truth.shape) - 0.5) / np.sqrt(0.5)
    image = truth + np.sqrt(error) * np.sqrt(truth**2 + 0.01) * noise
    if (cell["scene"], cell["engine"]) == BIASED:
        image += BIAS * truth
    path = Path("images") / cell["cell_id"] / f"spp{spp:04d}.exr"
    (folder / path).parent.mkdir(parents=True, exist_ok=True)
    write(folder / path, image)
    return str(path)


def write_reference(folder, scene, size, rng):
    """A reference of two replicates in the format of harness.run.references."""
    from engines.film import Film
    from harness.run import references

    wanted = references.PlannedReference(scene, scene, "s" + scene, reference_asked(scene, size), {})
    truth = picture(scene, size)
    film = Film(size.width, size.height)
    for _ in range(2):
        film.add(truth + rng.normal(0, 0.004, truth.shape) * np.sqrt(truth))
    references._save(wanted.folder(folder / "references"), wanted, film, 60.0)
    return json.loads(line_of(references.event(wanted, folder / "references")))


def reference_asked(scene, size):
    return {
        "scene": scene,
        "replicates": 2,
        "replicate_spp": 4096,
        "engine": "embree",
        "width": size.width,
        "height": size.height,
        "shader": {"name": "path_tracer", "max_depth": 6},
        "seed": 9000,
    }


def reference_id(scene, size):
    from harness.hashing import digest

    return digest(reference_asked(scene, size))

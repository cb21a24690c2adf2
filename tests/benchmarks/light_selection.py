"""How much sooner a choice of lights brings `many_lights` to relMSE 0.01, where the camera sees the lamps and where it does
not; and how many samples the lamps that it sees need by themselves: `python -m tests.benchmarks.light_selection [rounds]`.

Processor seconds of `render` of one thread, tables included; samples from which on the error is below the target are
interpolated. Ratios to even choice with the same seed, which takes turns with the others, as geometric means with 95 %
intervals of Student's t for the logarithms.

With names of scenes in place of the rounds: the variance of a sample with four candidates over that with one, each relative
to the square of the pixel's mean, as the mean over pixels without the largest hundredth.
"""

from __future__ import annotations

import math
import sys
import time
from typing import Any

import numpy as np

import engines
from engines import Settings
from harness.config import paths
from tests.benchmarks.paired import interval

TARGET, EPSILON, REFERENCE_SPP = 0.01, 0.01, 2048
COUNTS = sorted({round(1.08**k) for k in range(64)})
WAYS: dict[str, dict[str, Any]] = {
    "uniform": {},
    "bvh": {"light_sampler": "bvh"},
    "spatial": {"light_sampler": "spatial"},
    "4 candidates": {"light_candidates": 4},
    "8 candidates": {"light_candidates": 8},
    "spatial, 2 candidates": {"light_sampler": "spatial", "light_candidates": 2},
}


def renderer(seed: int, scene: str = "many_lights", sampler: str = "sobol", **options: Any) -> Any:
    """One that is ready to render."""
    shader = {"name": "path_tracer", "max_depth": 6, **options}
    settings = Settings(192, 128, shader=shader, sampler=sampler, seed=seed, threads=1, precision="float32")
    made = engines.engine("numba").prepare(engines.load_scene(paths.find("scenes", scene)), settings)
    made.warm_up()
    return made


def reached(seed: int, reference: Any, whole: Any, **options: Any) -> tuple[float, float]:
    """(samples per pixel, seconds) from which on relMSE is below the target, relative to the image `whole`."""
    made, spp, seconds, before = renderer(seed, **options), 0, 0.0, (0.0, 0.0, math.inf)
    while True:
        start = time.process_time()
        more = next(count for count in COUNTS if count > spp) - spp
        film = made.render(more)
        seconds, spp = seconds + time.process_time() - start, spp + more
        error = float(np.mean((film.mean() - reference) ** 2 / (whole**2 + EPSILON)))
        if error < TARGET:
            share = math.log(before[2] / TARGET) / math.log(before[2] / error)
            return before[0] + share * (spp - before[0]), before[1] + share * (seconds - before[1])
        before = spp, seconds, error


def relative_variance(scene: str, candidates: int, parts: int = 24, spp: int = 8) -> float:
    """Of one sample of independent numbers, from films of `spp` samples."""
    made = renderer(3, scene, "random", light_candidates=candidates)
    means = np.diff([made.render(spp).mean() * (part + 1) for part in range(parts)], axis=0, prepend=0.0)
    mean = means.mean(axis=0).mean(axis=2, keepdims=True)
    relative = (spp * means.var(axis=0, ddof=1) / (mean**2 + 1e-3 * mean.mean() ** 2)).mean(axis=2)
    return float(np.mean(np.sort(relative, axis=None)[: relative.size * 99 // 100]))


def main() -> None:
    if sys.argv[1:] and not sys.argv[1].isdigit():
        for scene in sys.argv[1:]:
            one, four = (relative_variance(scene, candidates) for candidates in (1, 4))
            print(f"{scene:14} {one:.3f} {four:.3f}, ratio {four / one:.3f}")
        return
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 7
    for hidden in (False, True):
        view = {"hide_emitters": hidden}
        whole = renderer(9000, light_sampler="bvh", **view).render(REFERENCE_SPP).mean()
        if not hidden:
            lamps = renderer(9000, max_depth=1).render(REFERENCE_SPP).mean()
            alone = np.mean([reached(seed, lamps, whole, max_depth=1)[0] for seed in range(1, 1 + rounds)])
            print(f"the lamps that are seen, alone: {alone:.1f} samples per pixel")
        turns = [[reached(seed, whole, whole, **options, **view) for options in WAYS.values()] for seed in range(1, 1 + rounds)]
        found = dict(zip(WAYS, np.array(turns).transpose(1, 0, 2), strict=True))
        print("lamps hidden" if hidden else "lamps seen")
        for way, numbers in found.items():
            spp, seconds = numbers.mean(axis=0)
            ratio, low, high = interval(list(numbers[:, 1] / found["uniform"][:, 1]))
            print(f"{way:22} {spp:5.1f} spp {seconds:.3f} s, ratio {ratio:.3f} ({low:.3f} to {high:.3f})")


if __name__ == "__main__":
    main()

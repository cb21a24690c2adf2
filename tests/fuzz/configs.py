"""Experiment files and renderers' files, damaged; experiments with overrides, too."""

from __future__ import annotations

from pathlib import Path
from random import Random

import yaml

import engines
from harness import config
from tests.fuzz.mutate import NUMBERS, SYNTAX, mutated_bytes, mutated_text, mutated_tree

FULL = """\
raybench_experiment: 1
name: all keys
matrix:
  scene: [cornell_box, two_spheres]
  engine: [numpy, numba]
  threads: [1, 2]
  accelerator: [none, {name: grid}]
  shader: [{name: path_tracer, max_depth: 6}]
  sampler: [random, {name: stratified, strata: 16}]
zip: [{precision: [float32, float64], resolution: [[8, 8], [16, 12]]}]
exclude: [{engine: numpy, threads: {ge: 2}}]
include: [{scene: cornell_box, engine: embree, accelerator: embree}]
extend: [{where: {engine: numba}, set: {precision: float32}}]
budget: {max_time: 20s, max_spp: 1024, timeout: 5m}
checkpoints: {ratio: 1.4142, start: 1}
repeats: 3
order: {seed: 1}
reference: {engine: numba, spp: 128, seed: 9000}
quality: {metric: relmse, epsilon: 1e-2, targets: [1.0e-1, 1e-2, 0.001]}
images: last
aa_twin: true
verify: {cases: [stability], quick: true, timeout: 5m}
"""
TREE = yaml.safe_load(FULL)
RENDERER = """\
raybench_renderer: 1
name: mine
version: "1"
command: [render, "{scene}", "{image}", --spp, "{spp}", --seed, "{seed}", --depth, "{shader.max_depth}"]
environment: {SIZE: "{width}x{height}"}
shaders: [{name: path_tracer, max_depth: 6}]
samplers: [random]
scene_format: mitsuba
image: pfm
threads: 1
time: {pattern: "took (?P<s>[0-9.]+)"}
"""
ALSO_NAMED = ("--set",)
"""A message may say that an override is wrong instead of naming the file."""
OVERRIDES = ("budget.max_time=5s", "matrix.engine=[numpy]", "repeats=", "=", "a.b.c=1", "quality.targets=[.inf]", "budget.=")


def _damaged(random: Random, text: str) -> bytes:
    way = random.randrange(3)
    if way == 0:
        return yaml.safe_dump(mutated_tree(random, yaml.safe_load(text)), sort_keys=False).encode()
    return mutated_text(random, text).encode() if way == 1 else mutated_bytes(random, text.encode())


def write(random: Random, folder: Path) -> None:
    """A folder with `a.yaml` and perhaps `set.txt`, or with a renderer's file `r.yaml`."""
    if random.random() < 0.25:
        (folder / "r.yaml").write_bytes(_damaged(random, RENDERER))
        return
    (folder / "a.yaml").write_bytes(_damaged(random, FULL))
    if random.random() < 0.2:
        (folder / "set.txt").write_text(random.choice(OVERRIDES) + random.choice(["", *NUMBERS, *SYNTAX]), newline="")


def read(folder: Path) -> None:
    """Reads what is there, as `raybench plan` does before it loads scenes."""
    if (folder / "r.yaml").exists():
        engines.engine(str(folder / "r.yaml"))
        return
    overrides = folder / "set.txt"
    config.load(folder / "a.yaml", [overrides.read_bytes().decode()] if overrides.exists() else [])

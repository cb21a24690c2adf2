"""Loops over lanes are vector code: the machine code of stages of cornell_box, and of costly BSDFs, in float32, made for a
processor with 256-bit vectors and no fast gather (Haswell), whatever the machine has beyond that."""

import json
import os
import re
import subprocess
import sys
from contextlib import nullcontext
from functools import partial
from pathlib import Path

import numpy as np

from tests.needs import needs

ROOT = Path(__file__).resolve().parents[2]
PACKED = re.compile(r"^\s+(vmulp[sd]|vpmulld|vpmuludq|vfn?m(?:add|sub)\d+p[sd])\s.*%ymm", re.MULTILINE)
SCALAR = re.compile(r"^\s+(v?muls[sd]|vfn?m(?:add|sub)\d+s[sd]|imull)\s", re.MULTILINE)
STAGES = {"draw": 20, "surface": 40, "shade": 40, "frosted glass": 290, "principled": 210}
"""Multiplications in vector registers that each stage has at least: half of what was counted."""

pytestmark = needs("avx2")


def assembly(names, unrolls_early=False):
    """The assembly of stages, by name; with `unrolls_early` as Numba compiles them by itself."""
    import engines
    from engines.choices import SAMPLERS, SHADERS, resolve
    from engines.kernels.compile import jit
    from engines.kernels.features import SceneFeatures
    from engines.kernels.flatten import flatten
    from engines.kernels.flatten.materials import leaf_features, model_of
    from engines.kernels.integrators.interface import Uses
    from engines.kernels.stages import sampler, scattering, shade, surface
    from engines.scene import Dielectric, Principled

    if unrolls_early:
        jit._without_early_unrolling = nullcontext
    for module in (sampler, scattering, shade, surface):
        module.compile_stage = lambda function: jit.compile_stage(function, on_disk=False)
    features = flatten(engines.load_scene("cornell_box"), np.float32, np.float32).features
    integrator = shade.integrator_of(resolve("shader", "path_tracer", SHADERS))

    def bsdf(leaf):
        features = SceneFeatures(**leaf_features([leaf]))
        return scattering._stage(features, model_of(leaf), Uses(value=True, sample=True), np.float32)

    make = {
        "frosted glass": lambda: bsdf(Dielectric(1.5, (0.2, 0.3), distribution="beckmann")),
        "principled": lambda: bsdf(Principled(clearcoat=1.0, spec_trans=0.5, anisotropic=0.5)),
        "draw": lambda: sampler.stages(resolve("sampler", "sobol", SAMPLERS), np.float32)[1],
        "surface": lambda: surface.stage(features, np.float32),
        "shade": lambda: shade.stage(integrator, shade.shade_features(integrator, features), features, np.float32),
    }
    return {name: make[name]()._library.get_asm_str() for name in names}


def multiplications(names, unrolls_early=False):
    """(in vector registers, of single numbers) of each stage, from a process that compiles for Haswell."""
    program = (
        "import json; from tests.kernels.test_vectorisation import assembly;"
        f"print(json.dumps(assembly({list(names)!r}, {unrolls_early})))"
    )
    environment = {**os.environ, "NUMBA_CPU_NAME": "haswell", "NUMBA_CPU_FEATURES": "+avx2,+fma"}
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return {name: (len(PACKED.findall(asm)), len(SCALAR.findall(asm))) for name, asm in json.loads(done.stdout).items()}


def is_vector_code(packed, scalar, least):
    return packed >= least and 2 * scalar <= packed


def test_stages_are_vector_code():
    counted = multiplications(STAGES)
    assert {name for name, count in counted.items() if not is_vector_code(*count, STAGES[name])} == set(), counted


def test_a_stage_that_is_unrolled_too_early_is_noticed():
    packed, scalar = multiplications(["draw"], unrolls_early=True)["draw"]
    assert not is_vector_code(packed, scalar, STAGES["draw"])


def test_vectors_have_the_full_width_of_the_processor_whatever_llvm_prefers_for_it():
    program = (
        "from engines.kernels.compile import jit; from numba.core.registry import cpu_target;"
        "print(cpu_target.target_context.codegen().magic_tuple()[1] or 'generic')"
    )
    environment = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_CPU")}
    run = partial(subprocess.run, [sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    assert run(env=environment).stdout.split() == ["generic"]
    assert run(env={**environment, "NUMBA_CPU_NAME": "skylake"}).stdout.split() == ["skylake"]

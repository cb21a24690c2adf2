"""Stages that hold a plugin's light and BSDF are kept on disk: another process loads them, and an edit compiles them anew."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PLUGINS = """
import numpy as np

from engines.plugin import (
    BSDF, BSDFSample, LaneBSDF, Light, LightSample, Spectrum, Vec3, const, cosine_direction, cosine_pdf, dot, inline,
)

GAIN = 2.0


@inline
def brighter(x):
    return x * const(GAIN, x)


@inline
def light(light, p, normal, u0, u1):
    x, y, z = light.parameters[:3]
    to = Vec3(x, y, z) - p
    distance = np.sqrt(dot(to, to))
    one = const(1.0, x)
    return LightSample(to * (one / distance), distance, light.color * brighter(one / distance), one)


@inline
def evaluate(parameters, si, wi):
    return Spectrum(Vec3(parameters[0], parameters[1], parameters[2]), cosine_pdf(si.normal, wi))


@inline
def pdf(parameters, si, wi):
    return cosine_pdf(si.normal, wi)


@inline
def sample(parameters, si, u_lobe, u0, u1, lobes):
    wi, one = cosine_direction(si.normal, u0, u1), const(1.0, u0)
    weight = Spectrum(Vec3(parameters[0], parameters[1], parameters[2]), one)
    return BSDFSample(wi, weight, cosine_pdf(si.normal, wi), False, True)


@inline
def albedos(parameters, si):
    albedo = Vec3(parameters[0], parameters[1], parameters[2])
    return albedo, albedo


lamp = Light("lamp", light, options={"color": (1, 1, 1), "position": (0, 3, 0)}, positions=("position",))
paper = BSDF("paper", LaneBSDF(evaluate, pdf, sample, albedos), options={"albedo": (0.5, 0.5, 0.5)})
"""
PROGRAM = """
import json, sys
import numpy as np
import engines
from engines.kernels.compile import jit
from engines.kernels.flatten import flatten
from engines.kernels.flatten.lights import LightModel, MODELS
from engines.kernels.flatten.plugins import kind_of
from engines.kernels.integrators.interface import Uses
from engines.kernels.stages import light, scattering

compiled = []
class Observed(jit.CFunc):
    def compile(self):
        super().compile()
        compiled.append((self._pyfunc.__name__, self.cache_hits))
jit.CFunc = Observed

for name in sys.argv[1:]:  # other plugins that this process has seen before
    kind_of(MODELS, name, LightModel(None, 1))
scene = engines.scene_from({
    "raybench_scene": 1, "camera": {"type": "perspective", "eye": [0, 0, 5], "target": [0, 0, 0]},
    "materials": {"paper": {"plugin": {"type": "own:paper"}}, "grey": {"kd": 0.5}},
    "shapes": [
        {"sphere": {"center": [0, 0, 0], "radius": 1}, "material": "paper"},
        {"sphere": {"center": [3, 0, 0], "radius": 1}, "material": "grey"},
    ],
    "lights": [{"plugin": {"type": "own:lamp"}}],
}, allow_imports=True)
features = flatten(scene, np.float64, np.float64).features
light.stage(features, False, False, np.float64)
scattering.stages(features, Uses(value=True, sample=True), np.float64)
print(json.dumps(compiled))
"""


@pytest.fixture(scope="module")
def stages(tmp_path_factory):
    """A function that compiles the stages of `own.py` in a process of its own: (stage, whether it came from disk) of each."""
    folder = tmp_path_factory.mktemp("plugins")

    def run(source, *others):
        (folder / "own.py").write_text(source)
        environment = {
            **os.environ,
            "NUMBA_CACHE_DIR": str(folder / "cache"),
            "PYTHONPATH": f"{ROOT}:{folder}",
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        done = subprocess.run(
            [sys.executable, "-c", PROGRAM, *others], cwd=folder, env=environment, capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stderr
        return [(name, bool(hits)) for name, hits in json.loads(done.stdout)]

    assert run(PLUGINS) == [("light_stage", False), ("scattering", False), ("scattering", False)]
    return run


@pytest.mark.parametrize(
    ("before", "after", "anew"),
    [
        ("GAIN = 2.0", "GAIN = 3.0", "light_stage"),
        ("wi, weight, cosine_pdf(si.normal, wi), False, True", "wi, weight, one, False, True", "scattering"),
    ],
    ids=["a constant of a function that the light calls", "the BSDF"],
)
def test_an_edit_is_compiled_anew_and_the_rest_is_loaded_whatever_other_plugins_the_process_has_seen(
    stages, before, after, anew
):
    assert PLUGINS.count(before) == 1
    found = stages(PLUGINS.replace(before, after), "shade", "gobo")
    assert [name for name, from_disk in found if not from_disk] == [anew] and len(found) == 3

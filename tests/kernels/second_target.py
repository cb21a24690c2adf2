"""Compiles lane functions and integrators to PTX, the code of NVIDIA's GPUs, without a GPU: a program that
`test_second_target` runs, since it replaces what the functions take from their target before they are imported.

Numba's own `numba.cuda` compiles, with NVIDIA's library NVVM of the package `nvidia-cuda-nvcc-cu12`. The program prints a
mapping: for each function how many instructions it has, how many of them are of float64, and how many are calls.
"""

# ruff: noqa: E402
import json
import math
import os
import re
import sys
import types as python_types
from collections import namedtuple
from importlib.util import find_spec
from pathlib import Path
from typing import Any, get_type_hints

TARGET = "engines.kernels.lane.target"


def folder() -> Path:
    """Where NVVM lies. Raises ModuleNotFoundError."""
    found = find_spec("nvidia.cuda_nvcc")
    if found is None or not found.submodule_search_locations:
        raise ModuleNotFoundError("no nvidia-cuda-nvcc-cu12 is installed")
    return Path(next(iter(found.submodule_search_locations)))


os.environ["CUDA_HOME"] = str(folder())

from numba import cuda, types
from numba.core.typed_passes import NopythonTypeInference
from numba.core.untyped_passes import IRProcessing
from numba.cuda import compiler, dispatcher, libdevice

target = python_types.ModuleType(TARGET)
target.sqrt, target.floor = math.sqrt, libdevice.floorf
sys.modules[TARGET] = target

from engines.kernels.compile.vec3 import Vec3
from engines.kernels.compile.weak_literals import NoLiteralPairs, WeakLiterals
from engines.kernels.features import SceneFeatures
from engines.kernels.flatten import lights, materials
from engines.kernels.flatten.shapes import ANALYTIC
from engines.kernels.integrators import aov, path_tracer, whitted
from engines.kernels.integrators.interface import Draws, SurfaceInteraction
from engines.kernels.integrators.interface import Path as RayPath
from engines.kernels.lane import camera as lane_camera
from engines.kernels.lane import media, sampler, tilt
from engines.kernels.lane.bsdf.interface import Scattering
from engines.kernels.lane.lights import Light, LightSample, sample_environment_all_around
from engines.kernels.lane.shapes import plane, sphere, triangle
from engines.kernels.lane.shapes.triangle import VertexUV
from engines.kernels.rows import BSDF_PARAMETERS, LIGHT_PARAMETERS, SHAPE_PARAMETERS, CameraRow

CAPABILITY = (8, 0)
REAL, WORD = types.float32, types.uint32


def with_weak_literals(define: Any) -> Any:
    def pipelines(self: Any) -> list[Any]:
        (manager,) = define(self)
        manager.add_pass_after(WeakLiterals, IRProcessing)
        manager.add_pass_after(NoLiteralPairs, NopythonTypeInference)
        manager.finalize()
        return [manager]

    return pipelines


compiler.CUDACompiler.define_pipelines = with_weak_literals(compiler.CUDACompiler.define_pipelines)
dispatcher.get_current_device = lambda: python_types.SimpleNamespace(compute_capability=CAPABILITY)


def of(hint: Any) -> Any:
    """The type of a value with this annotation."""
    plain = {float: REAL, int: types.int32, bool: types.boolean, Any: types.float32[::1]}
    if hint in plain:
        return plain[hint]
    if not hasattr(hint, "_fields"):  # tuple[float, ...]
        return types.UniTuple(REAL, LIGHT_PARAMETERS)
    parts = [of(part) for part in get_type_hints(hint).values()]
    return types.BaseTuple.from_types(parts, hint)


def functions() -> dict[str, tuple[Any, tuple[Any, ...]]]:
    """Functions by name, and the types of what they take."""
    path = types.BaseTuple.from_types([REAL if part == types.int32 else part for part in of(RayPath)], RayPath)
    vector, numbers, si = of(Vec3), types.UniTuple(REAL, BSDF_PARAMETERS), of(SurfaceInteraction)
    step = (si, of(LightSample), of(Scattering), of(Draws), path, types.UniTuple(REAL, 8))
    wide = types.BaseTuple.from_types([types.float64] * 3, Vec3)
    found: dict[str, tuple[Any, tuple[Any, ...]]] = {
        "path_tracer.step": (path_tracer.INTEGRATOR.step, step),
        "path_tracer.crossing_step": (path_tracer.INTEGRATOR.crossing_step, (*step, types.boolean)),
        "path_tracer.medium_step": (path_tracer.INTEGRATOR.medium_step, (*step, types.boolean, types.boolean)),
        "media.flight": (media.flight, (vector, vector, REAL, REAL)),
        "media.flight_weight": (media.flight_weight, (vector, vector, REAL, types.boolean)),
        "media.transmittance": (media.transmittance, (vector, REAL)),
        "media.sample_phase": (media.sample_phase, (REAL, vector, REAL, REAL)),
        "media.environment": (sample_environment_all_around, (of(Light), vector, vector, REAL, REAL)),
        "whitted": (whitted.WHITTED.step, step),
        "no_shadows": (whitted.NO_SHADOWS.step, step),
        "albedo": (aov.ALBEDO.step, step),
        "depth_map": (aov.DEPTH_MAP.step, step),
        "bump": (tilt.bump, (of(tilt.Tilted), vector, vector, REAL, REAL)),
        "normal_map": (tilt.normal_map, (of(tilt.Tilted), types.boolean, types.boolean, vector, vector)),
        "terminator": (tilt.terminator, (vector, vector, vector)),
        "ray_frame": (triangle.ray_frame, (vector,)),
        "triangle_distance": (triangle.triangle_distance, (vector, vector, vector)),
        "sphere_distance (float64)": (sphere.sphere_distance, (wide, wide, wide, types.float64)),
        "plane_distance (float64)": (plane.plane_distance, (wide, wide, wide, wide)),
    }
    found |= shapes(vector, wide) | cameras(wide)
    for each in (sampler.random, sampler.stratified, sampler.unscrambled, sampler.owen_scrambled, sampler.rotated):
        found[f"sampler.{each.__name__}"] = each, (WORD, WORD, WORD, WORD, WORD, types.int64)
    features = SceneFeatures(diffuse=True, mirror=True, refraction=True, tangents=True, spec_trans=True, clearcoat=True)
    for kind, model in materials.MODELS.items():
        lane, name = model.lane(features), f"bsdf {kind}"
        found[f"{name}.evaluate"] = lane.evaluate, (numbers, si, vector)
        found[f"{name}.pdf"] = lane.pdf, (numbers, si, vector)
        found[f"{name}.sample"] = lane.sample, (numbers, si, REAL, REAL, REAL, types.int64)
        found[f"{name}.albedos"] = lane.albedos, (numbers, si)
    for kind, model in lights.MODELS.items():
        if model.sample is not None:
            found[f"light {kind}.sample"] = model.sample, (of(Light), vector, vector, REAL, REAL)
        if model.pdf is not None:
            found[f"light {kind}.pdf"] = model.pdf, (types.UniTuple(REAL, LIGHT_PARAMETERS), vector, REAL, REAL, REAL)
    return found


def shapes(vector: Any, wide: Any) -> dict[str, tuple[Any, tuple[Any, ...]]]:
    """Where rays of float32 meet shapes, and texture coordinates there."""
    numbers, double, real = types.UniTuple(types.float64, SHAPE_PARAMETERS), types.float64, types.NumberClass(REAL)
    uv = types.BaseTuple.from_types([double] * len(VertexUV._fields), VertexUV)
    found: dict[str, tuple[Any, tuple[Any, ...]]] = {
        "triangle.intersection": (triangle.intersection, (*[vector] * 8, types.boolean)),
        "triangle.coordinates (float64)": (triangle.mesh_coordinates, (double, double, wide, wide, wide, uv, uv, uv)),
        "sphere.intersection (float64)": (sphere.intersection, (vector, vector, wide, double, real)),
        "sphere.coordinates (float64)": (sphere.coordinates, (wide, wide, double)),
        "plane.intersection (float64)": (plane.intersection, (vector, vector, wide, wide, real)),
        "plane.coordinates (float64)": (plane.coordinates, (wide, wide, wide)),
    }
    for shape, known in ANALYTIC.items():
        name, lane = shape.__name__.lower(), known.lane
        found[f"{name}.distance (float64)"] = lane.distance, (wide, wide, numbers)
        found[f"{name}.intersection (float64)"] = lane.intersection, (vector, vector, numbers, real)
        found[f"{name}.coordinates (float64)"] = lane.coordinates, (wide, numbers)
    return found


def cameras(wide: Any) -> dict[str, tuple[Any, tuple[Any, ...]]]:
    """Rays of cameras, all in float64."""
    row, double = namedtuple("row", CameraRow.fields), types.float64
    camera = types.BaseTuple.from_types([wide if each.kind == "vector" else double for each in CameraRow.fields.values()], row)
    plain = lane_camera.perspective, lane_camera.orthographic, lane_camera.perspective_arctan
    found = {f"camera.{each.__name__} (float64)": (each, (camera, double, double)) for each in plain}
    return found | {"camera.thin_lens (float64)": (lane_camera.thin_lens, (camera, *[double] * 4))}


def _of(word: str, code: list[str]) -> int:
    return sum(bool(re.search(rf"\b{word}\b", line.split("\t")[0])) for line in code)


def main() -> None:
    found = {}
    for name, (function, arguments) in functions().items():
        ptx, _ = cuda.compile_ptx(function.py_func, arguments, cc=CAPABILITY, device=True)
        code = re.findall(r"^\t(?!\.)(.*);$", ptx, re.MULTILINE)
        found[name] = {"instructions": len(code), "float64": _of("f64", code), "calls": _of("call", code)}
    json.dump(found, sys.stdout)


if __name__ == "__main__":
    main()

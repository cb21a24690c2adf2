"""What a plugin for the jitted engines is written with: one lane's vectors and selections, and the objects that carry it.

A shader is a function `step(si, light, bsdf, draws, path, options) -> ScatterResult`, decorated with `inline`, in a
`Shader` (see `engines.kernels.integrators.interface`); a sampler is `draw(pixel, sample, dimension, seed_key) -> float in
[0, 1)`. Sixteen lanes run as vector code when the function has no branches: use `select`. With branches it stays right and
is slower.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select
from engines.kernels.integrators.interface import Draws, Path, ScatterResult, SurfaceInteraction, finish
from engines.kernels.lane.bsdf.interface import BSDFSample, Scattering, Spectrum
from engines.kernels.lane.fresnel import reflect, refract
from engines.kernels.lane.lights.sample import LightSample
from engines.kernels.lane.sampling import cosine_direction, cosine_pdf, power_heuristic
from engines.kernels.lane.vector import Vec3, cross, dot, largest, length, select3, tangents, total, unit


@dataclass(frozen=True, slots=True)
class Shader:
    """A shader as a plugin: give it to `Settings.shader`, or name it in YAML as `module:attribute`.

    `jitted` is the step of the numba and embree engines, `numpy` the function of the reference (either may be missing:
    then that engine declines by `why_not`). The step's `options` argument holds eight numbers: the values of `options` in
    order. `lights`: "one" light sample a vertex, or "all" for a call per light.
    """

    name: str
    jitted: Callable[..., Any] | None = None
    numpy: Callable[..., Any] | None = None
    options: Mapping[str, float] = field(default_factory=dict)
    lights: str = "one"


@dataclass(frozen=True, slots=True)
class Sampler:
    """A sampler as a plugin: pure functions of (pixel, sample, dimension, seed); see `Shader` for the two engines."""

    name: str
    jitted: Callable[..., Any] | None = None
    numpy: Callable[..., Any] | None = None
    options: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera as a plugin: `jitted(x, y, width, height, options) -> (ox, oy, oz, dx, dy, dz)`, float64, pixels from the
    top left; `numpy(x, y, width, height, options)` the same over arrays, giving origins and directions (n, 3)."""

    name: str
    jitted: Callable[..., Any] | None = None
    numpy: Callable[..., Any] | None = None


__all__ = [
    "BSDFSample", "Camera", "Draws", "LightSample", "Path", "Sampler", "ScatterResult", "Scattering", "Shader", "Spectrum",
    "SurfaceInteraction", "Vec3", "const", "cosine_direction", "cosine_pdf", "cross", "dot", "finish", "inline", "largest",
    "length", "power_heuristic", "reflect", "refract", "select", "select3", "tangents", "total", "unit",
]  # fmt: skip

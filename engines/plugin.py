"""What a plugin for the jitted engines is written with: one lane's vectors and selections, and the objects that carry it.

A shader is a function `step(si, light, bsdf, draws, path, options) -> ScatterResult`, decorated with `inline`, in a
`Shader` (see `engines.kernels.integrators.interface`); a sampler is `draw(pixel, sample, dimension, seed_key) -> float in
[0, 1)`; a `Light`, a `BSDF` and a `Camera` are named by scenes. Sixteen lanes run as vector code when a function has no
branches: use `select`. With branches it stays right and is slower.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from engines.errors import UnknownName
from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select
from engines.kernels.integrators.interface import Draws, Path, ScatterResult, SurfaceInteraction, finish
from engines.kernels.lane.bsdf.interface import BSDFSample, LaneBSDF, Scattering, Spectrum
from engines.kernels.lane.fresnel import reflect, refract
from engines.kernels.lane.lights import LightSample
from engines.kernels.lane.sampling import cosine_direction, cosine_pdf, power_heuristic
from engines.kernels.lane.vector import Vec3, cross, dot, largest, length, tangents, total, unit

select3 = select  # the former name, where it chooses vectors


@dataclass(frozen=True, slots=True)
class Shader:
    """A shader as a plugin: give it to `Settings.shader`, or name it in YAML as `module:attribute`.

    `jitted` is the step of the engines numba and embree, `numpy(context, origins, directions, pixels, sample) -> (n, 3)`
    the radiance along n rays for the engine numpy. An engine whose function is missing does not support the shader.
    `options`: names and defaults, at most eight numbers; a mapping `{"name": ..., option: value}` changes single ones. The
    step's `options` argument holds their values in order, in eight numbers, `context.options` by name.
    `lights`: "one" light sample per vertex, or "all" for a call per light.
    """

    name: str
    jitted: Callable[..., Any] | None = None
    numpy: Callable[..., Any] | None = None
    options: Mapping[str, float] = field(default_factory=dict)
    lights: str = "one"


@dataclass(frozen=True, slots=True)
class Sampler:
    """A sampler as a plugin: `jitted(pixel, sample, dimension, seed_key)`, all uint32, gives a float in [0, 1);
    `numpy(pixels, sample, dimension, seed)` gives its 32 bits, (n,) uint32. Both are pure functions; see `Shader` for the
    engines.

    `options`: names and default numbers, as of a `Shader`. Where there are any, `jitted` gets a fifth argument, their values in
    order, and `numpy` a mapping.

    `smooth`: whether its samples are independent, so that the error falls smoothly with every sample.
    """

    name: str
    jitted: Callable[..., Any] | None = None
    numpy: Callable[..., Any] | None = None
    options: Mapping[str, float] = field(default_factory=dict)
    smooth: bool = False


@dataclass(frozen=True, slots=True)
class Camera:
    """A camera as a plugin: `jitted(x, y, width, height, options) -> (ox, oy, oz, dx, dy, dz)`, float64, pixels from the
    top left; `numpy(x, y, width, height, options)` the same over arrays, giving origins and directions (n, 3).

    `options` as of a `Light`: `jitted` gets their numbers in order, `numpy` a mapping. None: a scene may give any, and
    their order there counts.
    """

    name: str
    jitted: Callable[..., Any] | None = None
    numpy: Callable[..., Any] | None = None
    options: Mapping[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class Light:
    """A light as a plugin. It has no surface that rays could hit, and is not seen.

    `options`: names and defaults, numbers or three numbers each. `jitted(light, p, normal, u0, u1) -> LightSample` from
    the point p: `light.color` is the option `color` (white where there is none), `light.parameters` starts with the other
    options in order, triples as three numbers, at most `engines.kernels.layout.LIGHT_PARAMETERS`. `positions` names the
    options that are points: the engine may move them, and p, by a vector.

    `numpy(options, p, normal, u0, u1) -> (wi, distance, radiance, pdf)` is the same over arrays: vectors (3, n), numbers
    (n,), `options` a mapping. Normals are 0 in media.
    """

    name: str
    jitted: Callable[..., Any] | None = None
    numpy: Callable[..., Any] | None = None
    options: Mapping[str, Any] = field(default_factory=dict)
    positions: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in self.positions:
            if name not in self.options:
                raise UnknownName(f"option among the positions of the light {self.name!r}", name, self.options)


@dataclass(frozen=True, slots=True)
class BSDF:
    """A BSDF as a plugin.

    `options` as of a `Light`, at most `engines.kernels.layout.BSDF_PARAMETERS` numbers. `jitted` are the lane functions,
    whose `parameters` are the options in order, triples as three numbers. `numpy` is an object with

        evaluate(options, at, wi) -> (3, n)     f, without the cosine
        pdf(options, at, wi) -> (n,)            per solid angle, of `sample`
        sample(options, at, uc, u0, u1, lobes) -> (wi (3, n), weight (3, n), pdf (n,))
        albedos(options) -> (diffuse, albedo)   three numbers each

    of a mapping `options` and an `engines.numpy_reference.interaction.SurfaceInteraction` of n points. The flags say
    which specular lobes it has, and whether it reads `si.tangent` (`tangents`). With `transmission` lobes that are not
    specular transmit, too: `evaluate` and `pdf` are then called for directions on the far side. Without it they reflect only.
    """

    name: str
    jitted: LaneBSDF | None = None
    numpy: Any = None
    options: Mapping[str, Any] = field(default_factory=dict)
    specular_reflection: bool = False
    specular_transmission: bool = False
    tangents: bool = False
    transmission: bool = False


__all__ = [
    "BSDF",
    "BSDFSample",
    "Camera",
    "Draws",
    "LaneBSDF",
    "Light",
    "LightSample",
    "Path",
    "Sampler",
    "ScatterResult",
    "Scattering",
    "Shader",
    "Spectrum",
    "SurfaceInteraction",
    "Vec3",
    "const",
    "cosine_direction",
    "cosine_pdf",
    "cross",
    "dot",
    "finish",
    "inline",
    "largest",
    "length",
    "power_heuristic",
    "reflect",
    "refract",
    "select",
    "tangents",
    "total",
    "unit",
]

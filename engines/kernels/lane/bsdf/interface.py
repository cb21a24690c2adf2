"""What a BSDF model offers to integrators.

Directions are unit and point away from the surface, `wo` to the viewer and `wi` to the light; the ray's own direction
is -wo. f is the value of the BSDF, per steradian; cos is that between `wi` and the shading normal.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const
from engines.kernels.compile.vec3 import BLACK, ZERO, Vec3

ALL, SPECULAR_REFLECTION, SPECULAR_TRANSMISSION = range(3)
"""Which lobes `sample` chooses from: by chance among all, or one of the specular ones with certainty."""


class Spectrum(NamedTuple):
    """A colour times a number, kept apart: factors are multiplied as numbers first, and the colour once."""

    color: Vec3
    scale: float


class BSDFSample(NamedTuple):
    """A direction. `weight` is f cos / pdf; `pdf` per solid angle, inf for a specular event."""

    wi: Vec3
    weight: Spectrum
    pdf: float
    transmitted: bool
    """It leaves on the far side of the surface."""
    valid: bool
    """Something is reflected or transmitted; where not, the path ends."""


class Scattering(NamedTuple):
    """What an integrator reads of the BSDF at a vertex. A light's direction is that of the vertex's light
    sample."""

    value: Spectrum
    """f cos of the light's direction, 0 where specular lobes alone would reach it."""
    pdf: float
    """With which `sample` would have chosen the light's direction."""
    sample: BSDFSample
    reflection: BSDFSample
    """The specular reflection."""
    transmission: BSDFSample
    diffuse: Vec3
    """Albedo of the diffuse part."""
    albedo: Vec3
    """A colour that represents the material where no light is computed."""
    through: bool
    """The light lies on the far side, from where `value` is transmitted."""
    null: bool
    """The sample goes straight on as if no surface were there, where an integrator tells such samples from others."""
    eta_scale: float
    """eta^2 where `sample` is refracted, eta being the index of refraction behind the surface over that before it; else 1."""


class LaneBSDF(NamedTuple):
    """A model's lane functions. `parameters` are the numbers of its material, `si` a SurfaceInteraction.

    evaluate(parameters, si, wi) -> Spectrum: f cos
    pdf(parameters, si, wi) -> float: per solid angle, of `sample` with all lobes
    sample(parameters, si, u_lobe, u0, u1, lobes) -> BSDFSample
    albedos(parameters, si) -> (diffuse, albedo), as in `Scattering`
    transmittance(parameters, direction, normal) -> Vec3: the mean weight of what goes straight on, of a model with a null lobe

    only_delta(parameters) -> bool: whether all lobes of a material are deltas; None for the model of which no material is so

    `ior` is the place of the index of refraction inside among the parameters of a model that refracts, else None.
    """

    evaluate: Any
    pdf: Any
    sample: Any
    albedos: Any
    transmittance: Any = None
    ior: int | None = None
    only_delta: Any = None


@inline
def no_sample():
    """A sample that ends the path."""
    return BSDFSample(BLACK, Spectrum(BLACK, ZERO), ZERO, False, False)


@inline
def no_value(parameters, si, wi):
    """The value of a model that has delta lobes alone."""
    return Spectrum(BLACK, const(0.0, si.t))


@inline
def no_pdf(parameters, si, wi):
    """The pdf of such a model."""
    return ZERO


@inline
def always_delta(parameters):
    """`only_delta` of a model that has delta lobes alone."""
    return True


@inline
def delta(wi, color, scale, transmitted, valid):
    """A specular event."""
    return BSDFSample(wi, Spectrum(color, scale), math.inf, transmitted, valid)

"""The BSDF at a vertex: its value and pdf for the light's direction, and a sample by this vertex's random numbers.

Where a scene has one model, the shade stage calls it in its own loop, and nothing is stored. Where it has several, each
model has a stage of its own that runs only in batches of which some lane has hit it, and the shade stage loads the
results.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from engines.kernels.compile.jit import compile_stage, inline
from engines.kernels.compile.records import lane_numbers
from engines.kernels.compile.values import const
from engines.kernels.features import SceneFeatures
from engines.kernels.flatten.materials import MODELS
from engines.kernels.integrators.interface import Draws, SurfaceInteraction, Uses
from engines.kernels.lane.bsdf.interface import (
    ALL,
    SPECULAR_REFLECTION,
    SPECULAR_TRANSMISSION,
    BSDFSample,
    Scattering,
    Spectrum,
    no_sample,
)
from engines.kernels.lane.vector import Vec3, select3
from engines.kernels.layout import LANES, ray_batch

_FEATURES = ("diffuse", "specular_reflection", "specular_transmission", "tangents")


@inline
def load_interaction(rays, lane):
    return SurfaceInteraction(
        rays.miss[lane], rays.t[lane], rays.point[lane], rays.normal[lane], rays.geometric_normal[lane],
        rays.direction[lane], rays.origin[lane], rays.front[lane], rays.tangent[lane], rays.emission[lane],
        rays.light_pdf[lane],
    )  # fmt: skip


@inline
def load_draws(rays, lane):
    return Draws(rays.draw[3, lane], rays.draw[4, lane], rays.draw[5, lane], rays.draw[6, lane])


@cache
def _make_scatter(kind: int, features: SceneFeatures, uses: Uses) -> Any:
    """The function (rays, lane, si, draws) -> Scattering of the model `kind`, as far as an integrator uses it."""
    bsdf = MODELS[kind].lane(features)
    evaluate, pdf_of, sample_of, albedos = bsdf.evaluate, bsdf.pdf, bsdf.sample, bsdf.albedos
    use_value, use_sample, use_specular, use_albedos = uses

    @inline
    def scatter(rays, lane, si, draws):
        parameters, wi, zero = lane_numbers(rays.bsdf, lane), rays.wi[lane], const(0.0, si.t)
        none = Vec3(zero, zero, zero)
        value, pdf, diffuse, albedo = Spectrum(none, zero), zero, none, none
        sample, reflection, transmission = no_sample(zero), no_sample(zero), no_sample(zero)
        if use_value:
            value, pdf = evaluate(parameters, si, wi), pdf_of(parameters, si, wi)
        if use_sample:
            sample = sample_of(parameters, si, draws.lobe, draws.u0, draws.u1, ALL)
        if use_specular:
            reflection = sample_of(parameters, si, draws.lobe, draws.u0, draws.u1, SPECULAR_REFLECTION)
            transmission = sample_of(parameters, si, draws.lobe, draws.u0, draws.u1, SPECULAR_TRANSMISSION)
        if use_albedos:
            diffuse, albedo = albedos(parameters, si)
            diffuse, albedo = select3(si.miss, none, diffuse), select3(si.miss, none, albedo)
        return Scattering(value, pdf, sample, reflection, transmission, diffuse, albedo)

    return scatter


@inline
def _load_scattering(rays, lane, si, draws):
    """What the stages of the models have stored."""
    zero = const(0.0, si.t)
    return Scattering(
        Spectrum(rays.value_color[lane], rays.value_scale[lane]), rays.value_pdf[lane],
        BSDFSample(rays.sample_wi[lane], Spectrum(rays.sample_color[lane], rays.sample_scale[lane]),
                   rays.sample_pdf[lane], rays.sample_transmitted[lane], rays.sample_valid[lane]),
        BSDFSample(rays.reflection_wi[lane], Spectrum(rays.reflection_color[lane], rays.reflection_scale[lane]),
                   zero, False, rays.reflection_valid[lane]),
        BSDFSample(rays.transmission_wi[lane], Spectrum(rays.transmission_color[lane], rays.transmission_scale[lane]),
                   zero, rays.transmission_through[lane], rays.transmission_valid[lane]),
        rays.diffuse_albedo[lane], rays.albedo[lane],
    )  # fmt: skip


def make_scattering(features: SceneFeatures, uses: Uses) -> Any:
    """The function (rays, lane, si, draws) -> Scattering that the shade stage calls."""
    if len(features.bsdfs) > 1:
        return _load_scattering
    kind = features.bsdfs[0] if features.bsdfs else 0
    return _make_scatter(kind, features.only(*_FEATURES), uses)


def _make(kind: int, features: SceneFeatures, uses: Uses, real: Any) -> Any:
    scatter = _make_scatter(kind, features, uses)
    use_value, use_sample, use_specular, use_albedos = uses

    def scattering(batch, scene_address):
        rays, hits = ray_batch(batch, real), np.int64(0)
        for lane in range(np.uint64(LANES)):
            hits += np.int64(rays.bsdf_model[lane] == kind) & np.int64(rays.alive[lane])
        if hits == 0:
            return
        for lane in range(np.uint64(LANES)):
            if rays.bsdf_model[lane] == kind:
                found = scatter(rays, lane, load_interaction(rays, lane), load_draws(rays, lane))
                if use_value:
                    rays.value_color[lane] = found.value.color
                    rays.value_scale[lane] = found.value.scale
                    rays.value_pdf[lane] = found.pdf
                if use_sample:
                    rays.sample_wi[lane] = found.sample.wi
                    rays.sample_color[lane] = found.sample.weight.color
                    rays.sample_scale[lane] = found.sample.weight.scale
                    rays.sample_pdf[lane] = found.sample.pdf
                    rays.sample_transmitted[lane] = found.sample.transmitted
                    rays.sample_valid[lane] = found.sample.valid
                if use_specular:
                    rays.reflection_wi[lane] = found.reflection.wi
                    rays.reflection_color[lane] = found.reflection.weight.color
                    rays.reflection_scale[lane] = found.reflection.weight.scale
                    rays.reflection_valid[lane] = found.reflection.valid
                    rays.transmission_wi[lane] = found.transmission.wi
                    rays.transmission_color[lane] = found.transmission.weight.color
                    rays.transmission_scale[lane] = found.transmission.weight.scale
                    rays.transmission_through[lane] = found.transmission.transmitted
                    rays.transmission_valid[lane] = found.transmission.valid
                if use_albedos:
                    rays.diffuse_albedo[lane] = found.diffuse
                    rays.albedo[lane] = found.albedo

    return scattering


def stages(features: SceneFeatures, uses: Uses, real: Any) -> list[Any]:
    """One stage for each model of a scene that has several; none where it has one."""
    if len(features.bsdfs) < 2 or not any(uses):
        return []
    return [_stage(kind, features.only(*_FEATURES), uses, real) for kind in features.bsdfs]


@cache
def _stage(kind: int, features: SceneFeatures, uses: Uses, real: Any) -> Any:
    return compile_stage(_make(kind, features, uses, real))

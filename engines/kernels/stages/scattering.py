"""The BSDF at a vertex: its value and pdf for the light's direction, and a sample by this vertex's random numbers.

Where a scene has masks or tilted normals, both act around the model's functions (docs/transport.md, "Wrappers"). An emitter
that hides from the camera has only a sample that goes straight on.

Where a scene has one model, the shade stage calls it in its own loop, and nothing is stored. Where it has several, or paths are
guided, each model has a stage of its own that runs only in batches in which some lane has it, and the shade stage loads the
results.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from engines.kernels.compile.jit import compile_stage, inline
from engines.kernels.compile.records import lane_numbers
from engines.kernels.compile.values import const, select
from engines.kernels.features import SceneFeatures, per_features
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
from engines.kernels.lane.tilt import is_consistent, terminator
from engines.kernels.lane.vector import Vec3, dot
from engines.kernels.layout import DIRECTION_U0, DIRECTION_U1, LANES, LOBE, MISS, ROULETTE, ray_batch, scene_table


@inline
def load_interaction(rays, scene, lane):
    hit = rays.hit[lane]
    return SurfaceInteraction(
        hit.kind == MISS,
        rays.t[lane],
        hit.point,
        hit.normal,
        hit.geometric_normal,
        rays.direction[lane],
        rays.origin[lane],
        hit.front,
        hit.tangent,
        hit.emission,
        hit.light_pdf,
        scene.bsdf_tables,
    )


@inline
def load_draws(rays, lane):
    return Draws(rays.draw[LOBE, lane], rays.draw[DIRECTION_U0, lane], rays.draw[DIRECTION_U1, lane], rays.draw[ROULETTE, lane])


# ---- tilted normals and masks, around the functions of a model ---------------------------------------------------------


@inline
def _scaled(sample, factor):
    weight = Spectrum(sample.weight.color, sample.weight.scale * factor)
    return BSDFSample(sample.wi, weight, sample.pdf, sample.transmitted, sample.valid)


@inline
def _tilt_at(rays, lane, wi):
    """(whether the lane's normals agree on the side of `wi`, the factor of what is scattered there)."""
    untilted, normal = rays.wrapped.untilted_normal[lane], rays.hit.normal[lane]
    return is_consistent(untilted, normal, wi), terminator(rays.wrapped.outer_normal[lane], normal, wi)


@inline
def _tilted_sample(rays, lane, sample):
    there, factor = _tilt_at(rays, lane, sample.wi)
    found = _scaled(sample, factor)
    return BSDFSample(found.wi, found.weight, found.pdf, found.transmitted, found.valid & there)


@inline
def _straight_on(si, share):
    one = const(1.0, si.t)
    return BSDFSample(si.direction, Spectrum(Vec3(one, one, one), share), math.inf, True, True)


@inline
def _masked_sample(rays, lane, si, sample):
    """The model's sample as far as the surface is there, else the ray itself."""
    found = BSDFSample(sample.wi, sample.weight, sample.pdf * rays.wrapped.opacity[lane], sample.transmitted, sample.valid)
    return select(rays.wrapped.passing[lane], _straight_on(si, const(1.0, si.t)), found)


@inline
def _beyond_mask(rays, lane, si, transmission):
    """Of the lobes apart: what a mask lets through takes the place of the refraction."""
    opacity = rays.wrapped.opacity[lane]
    return select(opacity < 1.0, _straight_on(si, 1.0 - opacity), transmission)


@inline
def _unless_absent(absent, si, value, sample, eta_scale):
    """(value, sample, eta_scale), and where the surface is absent those of nothing."""
    one = const(1.0, si.t)
    value = Spectrum(value.color, select(absent, 0.0, value.scale))
    return value, select(absent, _straight_on(si, one), sample), select(absent, one, eta_scale)


def tells_null(features: SceneFeatures) -> bool:
    """Whether samples of null lobes are told from others."""
    return features.transparent or (features.hidden_emitters and features.null_lobes)


@cache
def _make_value(evaluate: Any, pdf_of: Any, masks: bool, tilts: bool) -> Any:
    """The function (rays, lane, si, parameters, wi) -> (f cos, pdf) of a model, and of what acts around it."""

    @inline
    def value_at(rays, lane, si, parameters, wi):
        value, pdf = evaluate(parameters, si, wi), pdf_of(parameters, si, wi)
        if tilts:
            there, factor = _tilt_at(rays, lane, wi)
            value = Spectrum(value.color, select(there, value.scale * factor, 0.0))
            pdf = select(there, pdf, 0.0)
        if masks:
            value, pdf = Spectrum(value.color, value.scale * rays.wrapped.opacity[lane]), pdf * rays.wrapped.opacity[lane]
        return value, pdf

    return value_at


@inline
def _towards(si, wi, value, pdf):
    """A direction that no model has sampled, as a sample of weight f cos, the density of which follows (`stages.guiding`)."""
    return BSDFSample(wi, value, pdf, dot(si.normal, wi) < 0.0, value.scale > 0.0)


@per_features
def _make_scatter(features: SceneFeatures, kind: int, uses: Uses) -> Any:
    """The function (rays, lane, si, draws) -> Scattering of the model `kind`, as far as an integrator uses it."""
    bsdf, light_through = MODELS[kind].lane(features), features.transmission
    masks, tilts, hides, guided = features.masks, features.tilts, features.hidden_emitters, features.guided
    has_null_lobe, asks_null = bsdf.transmittance is not None, tells_null(features)
    sample_of, albedos, value_at = bsdf.sample, bsdf.albedos, _make_value(bsdf.evaluate, bsdf.pdf, masks, tilts)
    bends, ior = bsdf.ior is not None, bsdf.ior or 0
    use_value, use_sample, use_specular, use_albedos = uses

    @inline
    def scatter(rays, lane, si, draws):
        parameters, wi, zero = lane_numbers(rays.bsdf, lane), rays.light_sample.wi[lane], const(0.0, si.t)
        none = Vec3(zero, zero, zero)
        value, pdf, diffuse, albedo = Spectrum(none, zero), zero, none, none
        sample, reflection, transmission = no_sample(), no_sample(), no_sample()
        null, eta_scale = False, const(1.0, si.t)
        if use_value:
            value, pdf = value_at(rays, lane, si, parameters, wi)
        if use_sample:
            sample = sample_of(parameters, si, draws.lobe, draws.u0, draws.u1, ALL)
            if bends:
                refracted = sample.transmitted & (not rays.wrapped.passing[lane]) if masks else sample.transmitted
                eta_scale = _eta_scale(si, parameters[ior], refracted)
            if tilts:
                sample = _tilted_sample(rays, lane, sample)
            if masks:
                sample = _masked_sample(rays, lane, si, sample)
            if guided:
                found = _towards(si, rays.guide.wi[lane], *value_at(rays, lane, si, parameters, rays.guide.wi[lane]))
                sample = select(rays.guide.by_tree[lane], found, sample)
                if bends:
                    eta_scale = select(rays.guide.by_tree[lane], _eta_scale(si, parameters[ior], found.transmitted), eta_scale)
            if asks_null:
                null = (has_null_lobe & sample.transmitted) | (masks & rays.wrapped.passing[lane])
            if hides:
                value, sample, eta_scale = _unless_absent(rays.crossing.absent[lane], si, value, sample, eta_scale)
                null = null | rays.crossing.absent[lane]
        if use_specular:
            reflection = sample_of(parameters, si, draws.lobe, draws.u0, draws.u1, SPECULAR_REFLECTION)
            transmission = sample_of(parameters, si, draws.lobe, draws.u0, draws.u1, SPECULAR_TRANSMISSION)
            if tilts:
                reflection = _tilted_sample(rays, lane, reflection)
                transmission = _tilted_sample(rays, lane, transmission)
            if masks:
                reflection = _scaled(reflection, rays.wrapped.opacity[lane])
                transmission = _beyond_mask(rays, lane, si, transmission)
        if use_albedos:
            diffuse, albedo = albedos(parameters, si)
            if masks:
                diffuse = diffuse * rays.wrapped.opacity[lane]
            diffuse, albedo = select(si.miss, none, diffuse), select(si.miss, none, albedo)
        through = light_through & (dot(si.normal, wi) < zero)
        return Scattering(value, pdf, sample, reflection, transmission, diffuse, albedo, through, null, eta_scale)

    return scatter


@inline
def _eta_scale(si, ior, refracted):
    eta = select(refracted, select(si.front, ior, 1.0 / ior), 1.0)
    return eta * eta


@cache
def _make_load_scattering(light_through: bool, bends: bool) -> Any:
    """The function (rays, lane, si, draws) -> Scattering that the stages of the models have stored."""

    @inline
    def load(rays, lane, si, draws):
        through = light_through & (dot(si.normal, rays.light_sample.wi[lane]) < 0.0)
        of = rays.scatter[lane]
        return Scattering(
            of.value,
            of.pdf,
            of.sample,
            of.reflection,
            of.transmission,
            of.diffuse,
            of.albedo,
            through,
            of.null,
            of.eta_scale if bends else const(1.0, si.t),
        )

    return load


@inline
def _kept(part):
    return part


@inline
def _dropped(part):
    return None


@cache
def _make_used(uses: Uses, null: bool, bends: bool) -> Any:
    """The function Scattering -> the same with None for the parts that no integrator reads, which are not stored."""
    value, sample, specular, albedos, null_of, eta_scale = (
        _kept if used else _dropped for used in (*uses, uses.sample and null, uses.sample and bends)
    )

    @inline
    def used(of):
        return Scattering(
            value(of.value),
            value(of.pdf),
            sample(of.sample),
            specular(of.reflection),
            specular(of.transmission),
            albedos(of.diffuse),
            albedos(of.albedo),
            None,
            null_of(of.null),
            eta_scale(of.eta_scale),
        )

    return used


def keeps_eta_scale(features: SceneFeatures) -> bool:
    """Whether paths keep `Path.eta_scale`: some model bends what it transmits, or paths are guided."""
    return features.guided or any(MODELS[kind].lane(features).ior is not None for kind in features.bsdfs)


def in_stages(features: SceneFeatures) -> bool:
    """Whether models have stages of their own, before that of the integrator."""
    return len(features.bsdfs) > 1 or (features.guided and len(features.bsdfs) > 0)


def make_scattering(features: SceneFeatures, uses: Uses) -> Any:
    """The function (rays, lane, si, draws) -> Scattering that the shade stage calls."""
    if in_stages(features):
        return _make_load_scattering(features.transmission, uses.sample and keeps_eta_scale(features))
    kind = features.bsdfs[0] if features.bsdfs else 0
    return _make_scatter(features, kind, uses)


def _make(features: SceneFeatures, kind: int, uses: Uses, real: Any) -> Any:
    scatter, alone = _make_scatter(features, kind, uses), len(features.bsdfs) == 1
    bends = uses.sample and keeps_eta_scale(features)
    used = _make_used(uses, tells_null(features) or features.hidden_emitters, bends)

    def scattering(batch, scene_address):
        rays, scene, hits = ray_batch(batch, real), scene_table(scene_address, real), np.int64(0)
        for lane in range(np.uint64(LANES)):
            hits += np.int64(alone or rays.bsdf_model[lane] == kind) & np.int64(rays.alive[lane])
        if hits == 0:
            return
        for lane in range(np.uint64(LANES)):
            if alone or rays.bsdf_model[lane] == kind:
                rays.scatter[lane] = used(scatter(rays, lane, load_interaction(rays, scene, lane), load_draws(rays, lane)))

    return scattering


def stages(features: SceneFeatures, uses: Uses, real: Any) -> list[Any]:
    """One stage for each model of a scene that has several, or whose paths are guided; else none."""
    if not in_stages(features) or not any(uses):
        return []
    return [_stage(features, kind, uses, real) for kind in features.bsdfs]


@per_features
def _stage(features: SceneFeatures, kind: int, uses: Uses, real: Any) -> Any:
    return compile_stage(_make(features, kind, uses, real))

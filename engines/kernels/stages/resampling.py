"""Of several candidates for a lane's light sample one is picked, much in proportion to what it adds to a diffuse surface
without shadows: resampled importance sampling (docs/transport.md). All loops over lanes are vector code."""

from __future__ import annotations

import math

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.integrators.path_tracer import BSDF_ONLY, DIRECT_OPTION, MIS
from engines.kernels.lane.sampling import is_delta, power_heuristic
from engines.kernels.lane.vector import Vec3, dot
from engines.kernels.layout import LANES, LIGHT, MEDIUM, ROULETTE

STEPS = (12664746, 9560334)
"""How far candidate k + 1 lies from candidate k in the numbers that place it on its light, in units of 2^-24."""
EVEN = 0.1
"""Share of the picks that do not depend on the targets."""
LEAST_TARGET = 1e-6
"""Share of the targets below which one gets no even share: a light in the plane of the surface is in front by rounding."""
PICK = ROULETTE
"""The draw that picks, which roulette reads as well."""


@inline
def keep_draws(rays):
    """Keeps the vertex's random numbers."""
    for lane in range(np.uint64(LANES)):
        for k in range(3):  # POINT_U0, POINT_U1, LIGHT
            rays.drawn[k, lane] = rays.draw[k, lane]


@inline
def choose_all(rays, candidate):
    """Every lane turns to the same candidate."""
    for lane in range(np.uint64(LANES)):
        rays.candidate[lane] = candidate


@inline
def draw_candidates(rays, count, real):
    """The random numbers of each lane's candidate."""
    one, below_one, unit = real(1), real(1.0 - np.finfo(real).epsneg), real(2.0**-24)
    for lane in range(np.uint64(LANES)):
        candidate = rays.candidate[lane]
        for k in range(2):
            shift = real((candidate * np.int32(STEPS[k])) & np.int32(0xFFFFFF)) * unit
            u, wrap = rays.drawn[k, lane], one - shift
            shifted = select(u >= wrap, u - wrap, u + shift)
            rays.draw[k, lane] = select(shifted < below_one, shifted, below_one)
        share = (real(candidate) + rays.drawn[2, lane]) / real(count)
        rays.draw[LIGHT, lane] = select(share < below_one, share, below_one)


@inline
def store_targets(rays, scene, candidate, media, real):
    """The target of the light sample that the batch holds, which is that of the same candidate in every lane. Where there are
    `media`, vertices in them have no cosine and no side."""
    zero, through = real(0), scene.lit_through != 0
    delta_only, mis = scene.options[DIRECT_OPTION] == BSDF_ONLY, scene.options[DIRECT_OPTION] == MIS
    for lane in range(np.uint64(LANES)):
        wi, li, pdf = rays.light_sample.wi[lane], rays.light_sample.radiance[lane], rays.light_sample.pdf[lane]
        luminance = 0.212671 * li.x + 0.715160 * li.y + 0.072169 * li.z
        cosine, anywhere = abs(dot(rays.hit.normal[lane], wi)), through
        if media:
            in_medium = rays.hit.kind[lane] == MEDIUM
            cosine, anywhere = select(in_medium, real(1), cosine), through | in_medium
        weight = select(mis, power_heuristic(pdf, cosine * (1.0 / math.pi)), 1.0)
        reaches = (pdf > zero) & (anywhere | (dot(rays.hit.geometric_normal[lane], wi) > zero))
        reaches = reaches & ((not delta_only) | is_delta(pdf))
        rays.targets[candidate, lane] = select(reaches, luminance * cosine * weight, zero)


@inline
def _add_targets(rays, count, real):
    """Adds up the targets of each lane's candidates."""
    for lane in range(np.uint64(LANES)):
        rays.target_sum[lane] = real(0)
    for k in range(count):
        for lane in range(np.uint64(LANES)):
            rays.target_sum[lane] = rays.target_sum[lane] + rays.targets[k, lane]


@inline
def pick(rays, count, real):
    """Each lane turns to a candidate: the last with a target that begins at or below a random share of their sum. Before that
    every target that counts takes a share of the mean."""
    zero = real(0)
    _add_targets(rays, count, real)
    share = real(EVEN / (1.0 - EVEN)) / real(count)
    for k in range(count):
        for lane in range(np.uint64(LANES)):
            target, whole = rays.targets[k, lane], rays.target_sum[lane]
            rays.targets[k, lane] = select(target > LEAST_TARGET * whole, target + share * whole, target)
    _add_targets(rays, count, real)
    for lane in range(np.uint64(LANES)):
        rays.candidate[lane] = 0
        rays.target[lane] = zero
        rays.target_begin[lane] = zero
    for k in range(count):
        for lane in range(np.uint64(LANES)):
            target, begin = rays.targets[k, lane], rays.target_begin[lane]
            takes = (target > zero) & (begin <= rays.draw[PICK, lane] * rays.target_sum[lane])
            rays.candidate[lane] = select(takes, np.int32(k), np.int32(rays.candidate[lane]))
            rays.target[lane] = select(takes, target, rays.target[lane])
            rays.target_begin[lane] = begin + target


@inline
def weigh(rays, count, real):
    """The light sample that the batch holds, which was picked, over its target, times the mean of all targets."""
    zero, share = real(0), real(1.0 / count)
    for lane in range(np.uint64(LANES)):
        total = rays.target_sum[lane]
        nothing = total == zero
        scaled = rays.light_sample.radiance[lane] * (total * share / rays.target[lane])
        rays.light_sample.radiance[lane] = select(nothing, Vec3(zero, zero, zero), scaled)
        rays.light_sample.pdf[lane] = select(nothing, zero, rays.light_sample.pdf[lane])

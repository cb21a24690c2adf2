"""The light sample at a vertex: one of one light, or one of several candidates (resampled importance sampling).

Resampling (Talbot, Cline and Egbert 2005) draws M candidates from the light sampler's density, picks one much in proportion
to what it adds to a diffuse surface without shadows, and scales it so that the expectation is that of one candidate;
docs/transport.md has the proof.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from engines.numpy_reference.context import Context, Vertex
from engines.numpy_reference.distribution import BELOW_ONE, last_begun
from engines.numpy_reference.lights.interface import LightSample
from engines.numpy_reference.vectors import Array, Indices

STEPS = (12664746, 9560334)
"""How far candidate k + 1 lies from candidate k in (u0, u1), in units of 2^-24: 1/g and 1/g^2 with g^3 = g + 1, the additive
sequence of Roberts (2018)."""
LUMINANCE = np.array([[0.212671], [0.715160], [0.072169]])
EVEN = 0.1
"""Share of the picks that do not depend on the targets."""
LEAST_TARGET = 1e-6
"""Share of the targets below which one gets no even share: a light in the plane of the surface is in front by rounding."""


class SampledLight(NamedTuple):
    """n light samples, one a vertex. No sample: its `weight` is 0."""

    light: LightSample
    inverse_pmf: Array
    """(n,) 1 / the probability with which the light sampler chooses the light."""
    scale: Array
    """(n,) the factor that makes `light.weight` an estimate of all lights: `inverse_pmf`, unless candidates were resampled."""

    def take(self, vertices: Indices) -> SampledLight:
        """Some of the samples."""
        light = LightSample(*(field.take(vertices, axis=-1) for field in self.light))
        return SampledLight(light, self.inverse_pmf[vertices], self.scale[vertices])


def sample_light(context: Context, at: Vertex, u0: Array, u1: Array, u: Array) -> SampledLight:
    """A light by `u` (n,), and a place on it by `u0` and `u1` (n,). With `direct: bsdf` delta lights only are sampled."""
    chosen, rest, inverse_pmf = context.light_sampler.choose(at.point, at.geometric, u)
    useful = chosen >= 0
    if context.options["direct"] == "bsdf":
        useful &= context.lights.delta[chosen]
    kept, light = np.flatnonzero(useful), LightSample.empty(u.size)
    here = at.take(kept)
    light.put(kept, context.lights.sample(chosen[kept], here.point, here.normal, u0[kept], u1[kept], rest[kept]))
    return SampledLight(light, inverse_pmf, inverse_pmf)


def resample_light(context: Context, at: Vertex, u0: Array, u1: Array, u: Array, pick: Array, count: int) -> SampledLight:
    """One of `count` candidates, picked in proportion to their targets by `pick` (n,)."""
    candidates = [
        sample_light(
            context, at, _shifted(u0, k * STEPS[0]), _shifted(u1, k * STEPS[1]), np.minimum((k + u) / count, BELOW_ONE)
        )
        for k in range(count)
    ]
    targets = np.array([_target(context, at, candidate) for candidate in candidates])
    whole = targets.sum(axis=0)
    targets = np.where(targets > LEAST_TARGET * whole, targets + EVEN / (1.0 - EVEN) / count * whole, targets)
    picked, _, total = last_begun(targets, pick)
    # that candidate, times the mean of all targets over its own
    vertex, found = np.arange(u.size), SampledLight(LightSample.empty(u.size), np.ones(u.size), np.zeros(u.size))
    for k, candidate in enumerate(candidates):
        mine = vertex[(picked == k) & (total != 0.0)]
        light, inverse_pmf, scale = candidate.take(mine)
        found.light.put(mine, light)
        found.inverse_pmf[mine], found.scale[mine] = inverse_pmf, scale * (total[mine] / count / targets[k, mine])
    return found


def _shifted(u: Array, steps: int) -> Array:
    """frac(u + steps 2^-24) of numbers in [0, 1)."""
    shift = steps % 2**24 * 2.0**-24
    return np.minimum(np.where(u >= 1.0 - shift, u - (1.0 - shift), u + shift), BELOW_ONE)


def _target(context: Context, at: Vertex, candidate: SampledLight) -> Array:
    """(n,) luminance of Li |n . wi| over the density of the candidate, times its weight beside samples of a diffuse BSDF: 0
    where nothing of it is scattered. In media 1 stands in the place of the cosine."""
    light = candidate.light
    reached = (light.weight > 0.0).any(axis=0)
    if not context.lit_through:
        reached &= at.faces(light.wi)
    cosine = at.cosine(light.wi)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
        target = (LUMINANCE * light.weight).sum(axis=0) * cosine * candidate.inverse_pmf
        if context.options["direct"] == "mis":
            target *= 1.0 / (1.0 + (cosine * (1.0 / np.pi) / (light.pdf / candidate.inverse_pmf)) ** 2)
    return np.where(reached, target, 0.0)

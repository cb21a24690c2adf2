"""Whitted's rule, and the same without shadows: every light at every hit, mirror and refraction followed to the end."""

from __future__ import annotations

import math

from engines.kernels.jit import const, inline, select
from engines.kernels.materials import mirrored, refracted
from engines.kernels.shaders.step import Step
from engines.kernels.vector import Vec3, dot, select3, total

EVERY_LIGHT = True
BRANCHES = True


@inline
def local(hit, material, light, path, ambient):
    """(radiance, direct): emission and the ambient term; and what the light sample adds to the diffuse part."""
    zero = const(0.0, hit.t)
    none = Vec3(zero, zero, zero)
    radiance = path.throughput * (material.emission + material.kd * ambient)
    cos = dot(hit.normal, light.wi)
    lit = (not hit.miss) & (cos > zero) & (dot(hit.geometric, light.wi) > zero) & (light.pdf > zero)
    direct = path.throughput * material.kd * light.radiance * (select(lit, cos, zero) * const(1.0 / math.pi, cos))
    return radiance, select3(lit, direct, none)


@inline
def step(hit, material, light, draws, path, options, needs):
    zero, one = const(0.0, hit.t), const(1.0, hit.t)
    none = Vec3(zero, zero, zero)
    radiance, direct = local(hit, material, light, path, options[1])
    mirror, bent, through, scale, ks, kt = none, none, False, one, none, none
    if needs.mirror or needs.refraction:
        glass = refracted(hit.direction, hit.normal, material.ior)
        mirror, bent, scale, through = (
            mirrored(hit.direction, hit.normal),
            glass.direction,
            glass.scale,
            not glass.total,
        )
        f = select(material.fresnel, glass.reflectance, one)
        g = select(material.fresnel, one - glass.reflectance, one)
        ks, kt = path.throughput * material.ks * f, path.throughput * material.kt * (g * scale)
    deeper = (path.depth < options[0]) & (not hit.miss)
    reflects = deeper & (total(ks) > zero) & (dot(hit.geometric, mirror) > zero)
    side = dot(hit.geometric, bent)
    refracts = deeper & (total(kt) > zero) & (select(through, -side, side) > zero)
    # the refraction goes on in the lane, the mirror ray waits: both where there are both
    return Step(
        radiance, direct, reflects | refracts, select3(refracts, bent, mirror), refracts & through,
        select3(refracts, kt, ks), const(math.inf, hit.t), reflects & refracts, mirror, ks,
    )  # fmt: skip

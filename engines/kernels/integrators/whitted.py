"""Whitted's rule: every light at every hit, specular reflection and transmission followed to the end."""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.integrators.interface import MAX_DEPTH, Integrator, ScatterResult, Uses, finish
from engines.kernels.lane.vector import BLACK, dot, total

AMBIENT = 1
"""Place among the options."""


@inline
def local(si, light, bsdf, path, ambient):
    """(radiance, direct): emission and the ambient term; and what the light sample adds."""
    radiance = path.throughput * (si.emission + bsdf.diffuse * ambient)
    value = bsdf.value
    side = dot(si.geometric_normal, light.wi)
    lit = (not si.miss) & (value.scale > 0.0) & (select(bsdf.through, -side, side) > 0.0) & (light.pdf > 0.0)
    direct = path.throughput * value.color * light.radiance * select(lit, value.scale, 0.0)
    return radiance, select(lit, direct, BLACK)


@inline
def whitted(si, light, bsdf, draws, path, options):
    radiance, direct = local(si, light, bsdf, path, options[AMBIENT])
    reflection, transmission = bsdf.reflection, bsdf.transmission
    ks = path.throughput * reflection.weight.color * reflection.weight.scale
    kt = path.throughput * transmission.weight.color * transmission.weight.scale
    deeper = (path.depth < options[MAX_DEPTH]) & (not si.miss)
    reflects = deeper & reflection.valid & (total(ks) > 0.0) & (dot(si.geometric_normal, reflection.wi) > 0.0)
    side = dot(si.geometric_normal, transmission.wi)
    through = transmission.transmitted
    refracts = deeper & transmission.valid & (total(kt) > 0.0) & (select(through, -side, side) > 0.0)
    # the refraction goes on in the lane, the mirror ray waits: both where there are both
    return ScatterResult(
        radiance=radiance,
        direct=direct,
        alive=reflects | refracts,
        direction=select(refracts, transmission.wi, reflection.wi),
        transmitted=refracts & through,
        throughput=select(refracts, kt, ks),
        pdf=math.inf,
        branch=reflects & refracts,
        branch_direction=reflection.wi,
        branch_throughput=ks,
    )


WHITTED = Integrator(whitted, Uses(value=True, specular=True, albedos=True), every_light=True, branches_at_specular=True)


@inline
def no_shadows(si, light, bsdf, draws, path, options):
    """Direct light without visibility, plus the ambient term; specular reflection and transmission are black."""
    radiance, direct = local(si, light, bsdf, path, options[AMBIENT])
    return finish(si.t, radiance, direct)


NO_SHADOWS = Integrator(no_shadows, Uses(value=True, albedos=True), every_light=True, shadows=False)

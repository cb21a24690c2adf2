"""Unidirectional path tracing: emission, one light sample a vertex, one lobe, Russian roulette (docs/transport.md)."""

from __future__ import annotations

import math

from engines.kernels.jit import const, inline, select
from engines.kernels.materials import cosine_direction, cosine_pdf, mirrored, refracted
from engines.kernels.shaders.step import Step
from engines.kernels.vector import Vec3, dot, largest, select3, total

EVERY_LIGHT = False
BRANCHES = False
LIGHT_ONLY, BSDF_ONLY, MIS = 0, 1, 2
DIRECT = {"light": LIGHT_ONLY, "bsdf": BSDF_ONLY, "mis": MIS}


@inline
def weight(mine, other):
    """The power heuristic, safe for infinite pdfs: 1 where `mine` is infinite."""
    ratio = other / mine
    return const(1.0, mine) / (const(1.0, mine) + ratio * ratio)


@inline
def step(hit, material, light, draws, path, options, needs):
    zero, one = const(0.0, hit.t), const(1.0, hit.t)
    none = Vec3(zero, zero, zero)
    max_depth, rr_depth, direct = options[0], options[1], options[2]
    use_light, use_bsdf = direct == const(LIGHT_ONLY, direct), direct == const(BSDF_ONLY, direct)

    # emission: what the light strategy would have found too counts for less
    unlisted = material.light_pdf <= zero
    only = select(unlisted | (path.pdf > const(3e38, path.pdf)), one, zero)
    w = select(use_light, only, select(use_bsdf, one, weight(path.pdf, material.light_pdf)))
    radiance = path.throughput * material.emission * w

    # lobes
    kd, ks, kt, d, r, t = material.kd, none, none, total(material.kd), zero, zero
    through, bent, mirror, scale = False, hit.direction, hit.direction, one
    if needs.mirror or needs.refraction:
        glass = refracted(hit.direction, hit.normal, material.ior)
        mirror, bent, scale = mirrored(hit.direction, hit.normal), glass.direction, glass.scale
        through = not glass.total
        f = select(material.fresnel, glass.reflectance, one)
        g = select(material.fresnel, one - glass.reflectance, one)
        ks, kt = material.ks * f, material.kt * g
        r, t = total(ks), total(kt)
    q = d + r + t
    goes_on = (path.depth < max_depth) & (q > zero)

    # direct light on the diffuse lobe
    share = d / select(q > zero, q, one)
    cos = dot(hit.normal, light.wi)
    p_b = share * cos * const(1.0 / math.pi, cos)
    w = weight(light.pdf, p_b)
    w = select(use_light, one, select(use_bsdf, select(light.pdf > const(3e38, light.pdf), one, zero), w))
    lit = goes_on & (cos > zero) & (dot(hit.geometric, light.wi) > zero) & (light.pdf > zero)
    arriving = path.throughput * kd * light.radiance * (select(lit, cos, zero) * const(1.0 / math.pi, cos) * w)
    arriving = select3(lit, arriving, none)

    # one lobe carries the path on
    diffuse = cosine_direction(hit.normal, draws.u0, draws.u1)
    above = dot(hit.geometric, diffuse) > zero
    pdf = share * cosine_pdf(hit.normal, diffuse)
    throughput, direction, alive, far = kd * (q / select(d > zero, d, one)), diffuse, above, False
    if needs.mirror or needs.refraction:
        u = draws.lobe * q
        is_diffuse, is_mirror = u < d, (u >= d) & (u < d + r)
        is_glass = u >= d + r
        far = is_glass & through
        side = dot(hit.geometric, select3(is_mirror, mirror, bent))
        side = select(far, -side, side)
        throughput = select3(is_diffuse, throughput, select3(
            is_mirror, ks * (q / select(r > zero, r, one)), kt * (q / select(t > zero, t, one)) * scale))  # fmt: skip
        direction = select3(is_diffuse, diffuse, select3(is_mirror, mirror, bent))
        alive = select(is_diffuse, above, side > zero)
        pdf = select(is_diffuse, pdf, const(math.inf, pdf))
    throughput = path.throughput * throughput
    alive = goes_on & alive

    # roulette
    survival = largest(throughput)
    survival = select(survival < const(0.95, survival), survival, const(0.95, survival))
    plays = path.depth >= rr_depth
    alive = alive & ((draws.roulette < survival) | (not plays))
    throughput = throughput * select(plays, one / select(survival > zero, survival, one), one)
    return Step(radiance, arriving, alive, direction, far, throughput, pdf, False, none, none)

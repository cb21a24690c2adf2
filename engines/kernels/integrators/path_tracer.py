"""Unidirectional path tracing: emission, one light sample per vertex, one lobe, Russian roulette (docs/transport.md)."""

from __future__ import annotations

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.integrators.interface import MAX_DEPTH, Integrator, ScatterResult, Uses
from engines.kernels.lane.sampling import is_delta, power_heuristic
from engines.kernels.lane.vector import BLACK, dot, largest

LIGHT_ONLY, BSDF_ONLY, MIS = 0, 1, 2
DIRECT = {"light": LIGHT_ONLY, "bsdf": BSDF_ONLY, "mis": MIS}
RR_DEPTH, DIRECT_OPTION, LIGHT_CANDIDATES = 1, 2, 3
"""Places among the integrator's options; the light stage reads the last two as well."""


@inline
def _path_step(si, light, bsdf, draws, path, options, crosses, in_medium):
    """One vertex, on a surface or `in_medium`. Where the sample `crosses` the surface, that is no vertex: depth and pdf stay,
    and there is no roulette."""
    max_depth, rr_depth, direct = options[MAX_DEPTH], options[RR_DEPTH], options[DIRECT_OPTION]
    use_light, use_bsdf = direct == LIGHT_ONLY, direct == BSDF_ONLY

    # emission: what the light strategy would have found too counts for less
    unlisted = si.light_pdf <= 0.0
    only = select(unlisted | is_delta(path.pdf), 1.0, 0.0)
    w = select(use_light, only, select(use_bsdf, 1.0, power_heuristic(path.pdf, si.light_pdf)))
    radiance = path.throughput * si.emission * w

    sample = bsdf.sample
    goes_on = (path.depth < max_depth) & (not si.miss)

    # direct light
    w = power_heuristic(light.pdf, bsdf.pdf)
    w = select(use_light, 1.0, select(use_bsdf, select(is_delta(light.pdf), 1.0, 0.0), w))
    value = bsdf.value
    side = dot(si.geometric_normal, light.wi)
    faces = in_medium | (select(bsdf.through, -side, side) > 0.0)
    lit = goes_on & (value.scale > 0.0) & faces & (light.pdf > 0.0)
    li = path.throughput * value.color * light.radiance * (select(lit, value.scale, 0.0) * w)

    # one lobe carries the path on
    side = dot(si.geometric_normal, sample.wi)
    leaves = in_medium | (select(sample.transmitted, -side, side) > 0.0)
    alive = (goes_on | (crosses & (not si.miss))) & sample.valid & leaves
    throughput = path.throughput * (sample.weight.color * sample.weight.scale)

    # roulette, as if refraction did not scale radiance
    survival = largest(throughput) * (path.eta_scale * bsdf.eta_scale)
    survival = select(survival < 0.95, survival, 0.95)
    plays = (path.depth >= rr_depth) & (not crosses)
    alive = alive & ((draws.roulette < survival) | (not plays))
    throughput = throughput * select(plays, 1.0 / select(survival > 0.0, survival, 1.0), 1.0)
    return ScatterResult(
        radiance=radiance,
        direct=select(lit, li, BLACK),
        alive=alive,
        direction=sample.wi,
        transmitted=sample.transmitted,
        throughput=throughput,
        pdf=select(crosses, path.pdf, sample.pdf),
        branch=False,
        branch_direction=BLACK,
        branch_throughput=BLACK,
    )


@inline
def step(si, light, bsdf, draws, path, options):
    return _path_step(si, light, bsdf, draws, path, options, False, False)


@inline
def _crossing_step(si, light, bsdf, draws, path, options, crosses):
    return _path_step(si, light, bsdf, draws, path, options, crosses, False)


INTEGRATOR = Integrator(
    step, Uses(value=True, sample=True), crossing_step=_crossing_step, medium_step=_path_step, roulette=True
)

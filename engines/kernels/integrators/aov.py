"""Images of what is there, without light."""

from __future__ import annotations

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.integrators.interface import Integrator, Uses, finish
from engines.kernels.lane.vector import BLACK, Vec3, largest, length

MAX_POINT = 3
"""Place among the options of the first of three coordinates."""


@inline
def albedo(si, light, bsdf, draws, path, options):
    """The material's albedo (the first of kd, ks and kt that is not black), and emission where that is black, as MobileRT's
    shader of the diffuse material shows it."""
    shown = select(largest(bsdf.albedo) > 0.0, bsdf.albedo, select(si.miss, BLACK, si.emission))
    return finish(si.t, shown, BLACK)


ALBEDO = Integrator(albedo, Uses(albedos=True), lit=False)


@inline
def depth_map(si, light, bsdf, draws, path, options):
    """Grey by distance, max(0, (D - t)/D) with D = 1.1 |max_point - origin|, and black where nothing is hit."""
    far = 1.1 * length(Vec3(options[MAX_POINT], options[MAX_POINT + 1], options[MAX_POINT + 2]) - si.origin)
    grey = (far - si.t) / select(far > 0.0, far, 1.0)
    grey = select((not si.miss) & (grey > 0.0) & (far > 0.0), grey, 0.0)
    return finish(si.t, Vec3(grey, grey, grey), BLACK)


DEPTH_MAP = Integrator(depth_map, Uses(), lit=False)

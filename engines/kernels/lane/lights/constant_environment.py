"""The environment of one radiance, sampled by the cosine rule."""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select
from engines.kernels.lane.lights.sample import LightSample
from engines.kernels.lane.sampling import cosine_direction, cosine_pdf


@inline
def sample(light, p, normal, u0, u1):
    zero, one = const(0.0, u0), const(1.0, u0)
    wi = cosine_direction(normal, u0, u1)
    pdf = cosine_pdf(normal, wi)
    scale = select(pdf > zero, one / pdf, zero)
    return LightSample(wi, const(math.inf, u0), light.color * scale, pdf)

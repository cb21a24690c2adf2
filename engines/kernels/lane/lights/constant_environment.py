"""The environment of one radiance, sampled by the cosine rule."""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.lane.lights.sample import LightSample
from engines.kernels.lane.sampling import cosine_direction, cosine_pdf


@inline
def sample(light, p, normal, u0, u1):
    wi = cosine_direction(normal, u0, u1)
    pdf = cosine_pdf(normal, wi)
    scale = select(pdf > 0.0, 1.0 / pdf, 0.0)
    return LightSample(wi, math.inf, light.color * scale, pdf)

"""Sampling of directions, their pdfs, and the power heuristic."""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.lane.target import sqrt
from engines.kernels.lane.vector import dot, sin_cos_turn, tangents


@inline
def cosine_direction(n, u0, u1):
    """A direction about n with pdf cos/pi per solid angle."""
    radius = sqrt(u0)
    sine, cosine = sin_cos_turn(u1)
    t, b = tangents(n)
    return t * (radius * cosine) + b * (radius * sine) + n * sqrt(1.0 - u0)


@inline
def cosine_pdf(n, w):
    """Per solid angle, of the unit direction `w` around the normal `n`; 0 below the surface."""
    cos = dot(n, w)
    return select(cos > 0.0, cos, 0.0) * (1.0 / math.pi)


@inline
def is_delta(pdf):
    """Whether a pdf is that of a delta distribution: infinite. The bound is a float32 that no finite density comes near."""
    return pdf > 3e38


@inline
def power_heuristic(mine, other):
    """The weight of a sample with pdf `mine` beside a strategy with pdf `other` (Veach 1997), safe for infinite pdfs: 1
    where `mine` is infinite."""
    ratio = other / mine
    return 1.0 / (1.0 + ratio * ratio)

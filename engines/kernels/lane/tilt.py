"""Shading normals that bump and normal maps tilt (docs/transport.md, "Wrappers")."""

from __future__ import annotations

import math
from typing import NamedTuple

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.lane.target import sqrt
from engines.kernels.lane.vector import Vec3, cross, dot, frame_of_tangent, to_world


class Tilted(NamedTuple):
    """A shading normal, and the derivatives of the surface whose normal it is."""

    normal: Vec3
    dp_du: Vec3
    dp_dv: Vec3
    seen: bool
    """Whether the viewer sees its front. Where not, the normal is the one before."""


@inline
def towards_viewer(tilted, n, wo):
    """(`tilted`, reflected at `n` where the viewer would see its back, and `n` where that is no help; whether it is seen)."""
    if dot(n, wo) * dot(tilted, wo) > 0.0:
        return tilted, True
    turned = n * (2.0 * dot(n, tilted)) - tilted
    if dot(turned, wo) > 0.0:
        return turned, True
    return n, False


@inline
def bump(frame, ng, wo, h_u, h_v):
    """Of the surface displaced along its normal by a height with the derivatives h_u and h_v; float64."""
    n = frame.normal
    dp_du = frame.dp_du + n * (h_u - dot(n, frame.dp_du))
    dp_dv = frame.dp_dv + n * (h_v - dot(n, frame.dp_dv))
    across = cross(dp_du, dp_dv)
    square = dot(across, across)
    if not square > 0.0:
        return Tilted(n, frame.dp_du, frame.dp_dv, True)
    tilted = across * (1.0 / math.sqrt(square))
    if dot(tilted, ng) < 0.0:
        tilted = -tilted
    normal, seen = towards_viewer(tilted, n, wo)
    return Tilted(normal, dp_du, dp_dv, seen)


@inline
def normal_map(frame, front, through, wo, color):
    """Along the vector 2 color - 1 in the frame of the surface; float64. Met from behind, the vector is mirrored where the
    surface is opaque, and turned half around the normal and mirrored where light passes `through` it."""
    a, b = 2.0 * color.x - 1.0, 2.0 * color.y - 1.0
    if not front:
        a, b = (-a, b) if through else (a, -b)
    x = Vec3(a, b, 2.0 * color.z - 1.0)
    square = dot(x, x)
    n = frame.normal
    if not square > 0.0:
        return Tilted(n, frame.dp_du, frame.dp_dv, True)
    tilted = to_world(frame_of_tangent(n, frame.dp_du), x * (1.0 / math.sqrt(square)))
    normal, seen = towards_viewer(tilted, n, wo)
    return Tilted(normal, frame.dp_du, frame.dp_dv, seen)


@inline
def is_consistent(untilted, normal, wi):
    """Whether a direction is on the same side of both normals."""
    return dot(untilted, wi) * dot(normal, wi) > 0.0


@inline
def _tan2(a, b):
    """The squared tangent of the angle between two unit vectors, 0 of equal ones; held below 1e30."""
    across, cos = cross(a, b), dot(a, b)
    square = cos * cos
    return dot(across, across) / select(square > 1e-30, square, 1e-30)


@inline
def terminator(outer, normal, wi):
    """The factor that softens the shadow's edge where `normal` is tilted from `outer` (Estevez, Lecocq and Stein 2019)."""
    alpha2 = _tan2(outer, normal) / 8.0
    alpha2 = select(alpha2 < 1.0, alpha2, 1.0)
    factor = 2.0 / (1.0 + sqrt(1.0 + alpha2 * _tan2(outer, wi)))
    return select(alpha2 > 0.0, factor, 1.0)

"""The local frame at a surface: z along the shading normal, x along the shape's tangent."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.lane.target import sqrt
from engines.kernels.lane.vector import Vec3, cross, dot, tangents


class Frame(NamedTuple):
    """Unit vectors, right-handed."""

    s: Vec3
    t: Vec3
    n: Vec3


@inline
def frame_of_normal(n):
    """A frame about n whose tangents follow no shape."""
    s, t = tangents(n)
    return Frame(s, t, n)


@inline
def frame_of_tangent(n, tangent):
    """The frame about n whose s is as near to `tangent` as can be; `frame_of_normal` where that is parallel to n, or 0."""
    across = tangent - n * dot(n, tangent)
    square = dot(across, across)
    good = square > 1e-8 * dot(tangent, tangent)
    s = across * (1.0 / sqrt(select(good, square, 1.0)))
    s0, t0 = tangents(n)
    s = select(good, s, s0)
    return Frame(s, select(good, cross(n, s), t0), n)


@inline
def to_local(frame, v):
    return Vec3(dot(frame.s, v), dot(frame.t, v), dot(frame.n, v))


@inline
def to_world(frame, v):
    return frame.s * v.x + frame.t * v.y + frame.n * v.z


@cache
def frame_at(anisotropic: bool) -> Any:
    """The function (si) -> frame at a SurfaceInteraction, along the shape's tangent where some material is anisotropic."""

    @inline
    def frame(si):
        if anisotropic:
            return frame_of_tangent(si.normal, si.tangent)
        return frame_of_normal(si.normal)

    return frame

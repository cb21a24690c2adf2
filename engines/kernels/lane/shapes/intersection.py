"""The point where a ray meets a shape."""

from __future__ import annotations

from typing import NamedTuple

from engines.kernels.compile.vec3 import Vec3


class ShapeIntersection(NamedTuple):
    """Normals are those of the shape's own front side. `t` is not below inf where the shape does not confirm the hit."""

    t: float
    scale: float
    """The largest number that rounding in float64 has scaled with, besides coordinates and distance: the radius of what is
    round."""
    u: float
    v: float
    """Barycentric weights of a triangle's second and third vertex; 0 elsewhere."""
    point: Vec3
    normal: Vec3
    """Geometric normal, unit."""
    shading_normal: Vec3
    tangent: Vec3
    """Derivative of the point by the shape's first coordinate, of any length; 0 where it has none."""

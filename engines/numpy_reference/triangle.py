"""Watertight triangles (Woop, Benthin and Wald 2013), in float64.

Seen along the ray, a triangle becomes a flat one around the origin, and the signs of three edge functions say whether
it holds the origin. The two products of an edge function are rounded monotonically, so its sign is right or zero, and
both triangles of a shared edge see exactly opposite values: with zero counted as inside, no ray slips between them.
"""

from __future__ import annotations

import numpy as np

from engines.numpy_reference.vectors import Array, Indices


class Triangles:
    """All triangles of a scene that have an area. `a`, `b`, `c`, `normal` (3, m), the normal unit and on the front;
    `area` (m,); `vertex_normals` (3, 3, m) by vertex and axis, NaN where flat; `rank` (m,) ascending.

    `data` (3, 9, m) holds the vertices once for each axis a ray may mainly follow, that axis last.
    """

    def __init__(self, corners: Array, normal: Array, area: Array, vertex_normals: Array | None, rank: Indices) -> None:
        self.a, self.b, self.c = corners
        self.normal, self.area, self.vertex_normals, self.rank = normal, area, vertex_normals, rank
        self.data = np.stack([corners[:, _turned(axis)].reshape(9, -1) for axis in range(3)])

    def boxes(self) -> tuple[Array, Array]:
        """Lower and upper corners, (3, m) each."""
        return (
            np.minimum(np.minimum(self.a, self.b), self.c),
            np.maximum(np.maximum(self.a, self.b), self.c),
        )

    @staticmethod
    def rays(origin: Array, direction: Array) -> tuple[Indices, Array]:
        """The axis that each ray mainly follows (n,); its origin with that axis last, and its shear (6, n)."""
        axis = np.abs(direction).argmax(axis=0)
        order = np.stack([(axis + 1) % 3, (axis + 2) % 3, axis])
        x, y, z = np.take_along_axis(direction, order, axis=0)
        return axis, np.concatenate([np.take_along_axis(origin, order, axis=0), np.stack([x / z, y / z, 1.0 / z])])

    @staticmethod
    def distance(triangle: Array, ray: Array) -> Array:
        """t > 0 inside the triangle, inf elsewhere; the arguments broadcast after their first axis."""
        u, v, w, depth = _edge_functions(triangle, ray)
        inside = np.minimum(np.minimum(u, v), w) >= 0.0
        inside |= np.maximum(np.maximum(u, v), w) <= 0.0
        t = depth / (u + v + w)  # NaN where all three vanish: a triangle seen from its edge is not hit
        inside &= t > 0.0
        return np.where(inside, t, np.inf)

    @staticmethod
    def barycentric(triangle: Array, ray: Array) -> tuple[Array, Array]:
        """Weights of the second and third vertex at the hit, for rays that hit."""
        u, v, w, _ = _edge_functions(triangle, ray)
        total = u + v + w
        return v / total, w / total


def _turned(axis: int) -> list[int]:
    return [(axis + 1) % 3, (axis + 2) % 3, axis]


def _edge_functions(triangle: Array, ray: Array) -> tuple[Array, Array, Array, Array]:
    """Twice the signed areas that weigh a, b and c as seen along the ray, and t times their sum."""
    ax, ay, az, bx, by, bz, cx, cy, cz = triangle
    ox, oy, oz, shear_x, shear_y, shear_z = ray
    az, bz, cz = az - oz, bz - oz, cz - oz
    ax, ay = (ax - ox) - shear_x * az, (ay - oy) - shear_y * az
    bx, by = (bx - ox) - shear_x * bz, (by - oy) - shear_y * bz
    cx, cy = (cx - ox) - shear_x * cz, (cy - oy) - shear_y * cz
    u = cx * by - cy * bx
    v = ax * cy - ay * cx
    w = bx * ay - by * ax
    return u, v, w, (u * az + v * bz + w * cz) * shear_z

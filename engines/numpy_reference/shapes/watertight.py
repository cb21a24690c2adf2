"""Watertight intersection of rays and triangles (Woop, Benthin and Wald 2013), in float64.

Seen along the ray, a triangle becomes a flat one around the origin, and the signs of three edge functions say whether
it holds the origin. The two products of an edge function are rounded monotonically, so its sign is right or zero; where
it is zero, the rounding errors decide. Signs are exact then, and exactly opposite for both triangles of a shared edge:
with a true zero counted as inside, no ray slips between them.
"""

from __future__ import annotations

import numpy as np

from engines.numpy_reference.vectors import EPSILON, Array, Indices


def rays(origin: Array, direction: Array) -> tuple[Indices, Array]:
    """The axis that each ray mainly follows (n,); its origin with that axis last, and its shear (6, n)."""
    axis = np.abs(direction).argmax(axis=0)
    order = np.stack([(axis + 1) % 3, (axis + 2) % 3, axis])
    x, y, z = np.take_along_axis(direction, order, axis=0)
    return axis, np.concatenate([np.take_along_axis(origin, order, axis=0), np.stack([x / z, y / z, 1.0 / z])])


def copies_by_axis(corners: Array) -> Array:
    """(3, 9, m): the vertices (3, 3, m), by vertex and axis, once for each axis a ray may mainly follow, that axis last."""
    return np.stack([corners[:, _turned(axis)].reshape(9, -1) for axis in range(3)])


def distance(triangle: Array, ray: Array) -> Array:
    """t > 0 inside the triangle, inf elsewhere; the arguments broadcast after their first axis."""
    x, y, z = _seen_along(triangle, ray)
    u, v, w = edges = _edge_functions(x, y)
    inside = np.minimum(np.minimum(u, v), w) >= 0.0
    inside |= np.maximum(np.maximum(u, v), w) <= 0.0
    t = np.full(inside.shape, np.inf)
    hit = np.nonzero(inside)
    if hit[0].size:
        t[hit] = _depth(*(tuple(values[hit] for values in group) for group in (x, y, z, edges)))
    return t


def barycentric(triangle: Array, ray: Array) -> tuple[Array, Array]:
    """Weights of the second and third vertex at the hit, for rays that hit."""
    x, y, _ = _seen_along(triangle, ray)
    u, v, w = _exact_where_zero(x, y, _edge_functions(x, y))
    total = u + v + w
    return v / total, w / total


Corners = tuple[Array, Array, Array]
"""One number for each of the corners a, b, c."""


def _turned(axis: int) -> list[int]:
    return [(axis + 1) % 3, (axis + 2) % 3, axis]


def _seen_along(triangle: Array, ray: Array) -> tuple[Corners, Corners, Corners]:
    """The corners as the ray sees them: x and y sideways from it, z along it in units of t."""
    ax, ay, az, bx, by, bz, cx, cy, cz = triangle
    ox, oy, oz, shear_x, shear_y, shear_z = ray
    az, bz, cz = az - oz, bz - oz, cz - oz
    x = ((ax - ox) - shear_x * az, (bx - ox) - shear_x * bz, (cx - ox) - shear_x * cz)
    y = ((ay - oy) - shear_y * az, (by - oy) - shear_y * bz, (cy - oy) - shear_y * cz)
    return x, y, (az * shear_z, bz * shear_z, cz * shear_z)


def _edge_functions(x: Corners, y: Corners) -> Corners:
    """Twice the signed areas that weigh a, b and c: of the right sign, or zero."""
    (ax, bx, cx), (ay, by, cy) = x, y
    return cx * by - cy * bx, ax * cy - ay * cx, bx * ay - by * ax


def _exact_where_zero(x: Corners, y: Corners, edges: Corners) -> Corners:
    """Edge functions whose two products have been rounded to the same number, from what the rounding has left."""
    exact = []
    for edge, i, j in zip(edges, (2, 0, 1), (1, 2, 0), strict=True):
        zero = edge == 0.0
        exact.append(np.where(zero, _lost(x[i], y[j]) - _lost(y[i], x[j]), edge) if zero.any() else edge)
    return tuple(exact)


def _lost(a: Array, b: Array) -> Array:
    """a b minus its rounded value, exactly (Dekker 1971)."""
    (a_high, a_low), (b_high, b_low) = _halves(a), _halves(b)
    return ((a_high * b_high - a * b) + a_high * b_low + a_low * b_high) + a_low * b_low


def _halves(a: Array) -> tuple[Array, Array]:
    """Two numbers of 26 bits that make `a` (Veltkamp 1968)."""
    scaled = 134_217_729.0 * a  # 2^27 + 1
    high = scaled - (scaled - a)
    return high, a - high


def _depth(x: Corners, y: Corners, z: Corners, edges: Corners) -> Array:
    """t where it is certainly positive, else inf.

    It lies between the depths of the corners. Where these have both signs, t must exceed the bound of its rounding
    error (Pharr, Jakob and Humphreys, Physically Based Rendering, 3.9.6), or rays that leave a needle would hit it.
    """
    u, v, w = edges = _exact_where_zero(x, y, edges)
    total = u + v + w
    t = (u * z[0] + v * z[1] + w * z[2]) / total
    far_x, far_y, far_z, far_edge = (np.abs(np.stack(group)).max(axis=0) for group in (x, y, z, edges))
    ulp = 0.5 * EPSILON
    error_x, error_y, error_z = 5 * ulp * (far_x + far_z), 5 * ulp * (far_y + far_z), 3 * ulp * far_z
    error_edge = 2.0 * (2 * ulp * far_x * far_y + error_y * far_x + error_x * far_y)
    error = 3.0 * (3 * ulp * far_edge * far_z + error_edge * far_z + error_z * far_edge) / np.abs(total)
    certain = (t > error) | (np.minimum(np.minimum(z[0], z[1]), z[2]) > 0.0)
    inside = (np.minimum(np.minimum(u, v), w) >= 0.0) | (np.maximum(np.maximum(u, v), w) <= 0.0)
    # t is NaN where all edges vanish: a triangle seen from its edge is not hit
    return np.where(inside & certain & (t > 0.0), t, np.inf)

"""What grid and tree share: boxes of the primitives, the ray of one lane, and the test of one primitive.

Primitives are numbered triangles first, then spheres. Boxes are padded by a few ulps of the scene's extent, so a ray in a
box face, or along a cell wall, is inside by a margin and needs no special case.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.kernels import block as at
from engines.kernels.jit import const, fetch, inline, kernel, select
from engines.kernels.shapes import Frame, ray_frame, shear, sphere_distance, triangle_distance
from engines.kernels.surface import row3, wide
from engines.kernels.vector import Vec3, extent
from engines.kernels.world import SPHERE_REALS, SPHERES, TRIANGLES, VERTICES, World

PAD_ULPS = 16.0


class Ray(NamedTuple):
    """One lane's ray: origin, unit direction, 1/direction (finite), its shear frame, and `slack`: how far rounding may shift
    what is seen from this origin, in metres."""

    o: Vec3
    d: Vec3
    inverse: Vec3
    frame: Frame
    slack: float


@inline
def finite_inverse(x, tiny):
    """1/x, but finite: a component too small to move the ray across the scene acts as if it were `tiny`."""
    return const(1.0, x) / select(abs(x) > tiny, x, select(x >= const(0.0, x), tiny, -tiny))


@inline
def ray_of(lanes, lane, origin, direction, eps, real):
    o, d = at.get3(lanes, origin, lane), at.get3(lanes, direction, lane)
    tiny = real(1e-18)
    inverse = Vec3(finite_inverse(d.x, tiny), finite_inverse(d.y, tiny), finite_inverse(d.z, tiny))
    return Ray(o, d, inverse, ray_frame(d), extent(o) * real(PAD_ULPS * eps))


@inline
def corner_distance(ray, corners, i):
    """Distance to triangle i of an array of nine numbers a triangle."""
    a = shear(ray.frame, row3(corners, 9 * i) - ray.o)
    b = shear(ray.frame, row3(corners, 9 * i + 3) - ray.o)
    c = shear(ray.frame, row3(corners, 9 * i + 6) - ray.o)
    return triangle_distance(a, b, c)


@inline
def ball_distance(ray, spheres, i, real):
    center, radius = row3(spheres, i * SPHERE_REALS), fetch(spheres, i * SPHERE_REALS + 3)
    return real(sphere_distance(wide(ray.o), wide(ray.d), center, radius))


def corners(world: World) -> NDArray[Any]:
    """(triangles, 9) vertices of each triangle."""
    return world.arrays[VERTICES][world.arrays[TRIANGLES]].reshape(-1, 9)


def boxes(world: World) -> NDArray[Any]:
    """(n, 6) lower and upper corners of triangles, then spheres, padded, in the tracing precision."""
    real = world.real
    result = np.empty((len(world.arrays[TRIANGLES]) + len(world.arrays[SPHERES]), 6), real)
    _fill_boxes(
        world.arrays[VERTICES], world.arrays[TRIANGLES], world.arrays[SPHERES], real(padding(world)), result
    )  # fmt: skip
    return result


def padding(world: World) -> float:
    """Metres by which boxes are padded."""
    size = float(np.abs(world.bounds - world.center).max()) + float(np.ptp(world.bounds, axis=0).max())
    return size * PAD_ULPS * float(np.finfo(world.real).eps)


@kernel
def _fill_boxes(vertices, triangles, spheres, pad, result):
    n = len(triangles)
    for i in range(n):
        a, b, c = triangles[i, 0], triangles[i, 1], triangles[i, 2]
        for axis in range(3):
            x, y, z = vertices[a, axis], vertices[b, axis], vertices[c, axis]
            result[i, axis] = min(x, y, z) - pad
            result[i, 3 + axis] = max(x, y, z) + pad
    for i in range(len(spheres)):
        for axis in range(3):
            result[n + i, axis] = spheres[i, axis] - spheres[i, 3] - pad
            result[n + i, 3 + axis] = spheres[i, axis] + spheres[i, 3] + pad


def primitive_count(world: World) -> int:
    return len(world.arrays[TRIANGLES]) + len(world.arrays[SPHERES])


def fill_records(
    world: World, unit: float, first: int, last: int, records: NDArray[np.float32], order: NDArray[np.int32]
) -> None:
    """Boxes (n, 8) of primitives first .. last - 1 in multiples of `unit`, a power of two: lower and negated upper corner,
    padded, rounded outwards."""
    shapes = world.arrays[VERTICES], world.arrays[TRIANGLES], world.arrays[SPHERES]
    rounding = 0.0 if world.real == np.float32 else 2.0**-23
    _fill_records(*shapes, padding(world), rounding, unit, first, last, records, order)


@kernel
def _fill_records(vertices, triangles, spheres, pad, rounding, unit, first, last, records, order):
    n = len(triangles)
    for i in range(first, last):
        order[i] = i
        records[i, 3] = records[i, 7] = 0
        for axis in range(3):
            if i < n:
                x, y, z = (
                    vertices[triangles[i, 0], axis],
                    vertices[triangles[i, 1], axis],
                    vertices[triangles[i, 2], axis],
                )
                low, high = np.float64(min(x, y, z)), np.float64(max(x, y, z))
            else:
                center, radius = spheres[i - n, axis], spheres[i - n, 3]
                low, high = center - radius, center + radius
            low, high = (low - pad) / unit, (high + pad) / unit
            records[i, axis] = low - abs(low) * rounding
            records[i, 4 + axis] = -(high + abs(high) * rounding)

"""What accelerators share: boxes of the primitives; of grids and area hierarchies the ray of one lane, and the test of one
primitive.

Primitives are numbered triangles first, then spheres, then analytic shapes, then instances. Boxes are padded by a few ulps of
the scene's extent, so a ray in a box face, or along a cell wall, is inside by a margin and needs no special case.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.kernels.compile.jit import inline, kernel
from engines.kernels.compile.records import Row, vector
from engines.kernels.compile.values import select
from engines.kernels.flatten import FlatScene
from engines.kernels.lane.shapes.sphere import sphere_distance
from engines.kernels.lane.shapes.triangle import Shear, ray_frame, shear, triangle_distance
from engines.kernels.lane.vector import Vec3, extent, to_float64
from engines.kernels.layout import LANES, SceneTable

PAD_ULPS = 16.0


class CornersRow(Row):
    """The vertices of a triangle."""

    a = vector()
    b = vector()
    c = vector()


class Ray(NamedTuple):
    """One lane's ray: origin, unit direction, 1/direction (finite), its shear frame, and `error_bound`: how far rounding may
    shift what is seen from this origin, in metres."""

    o: Vec3
    d: Vec3
    inverse: Vec3
    frame: Shear
    error_bound: float


@inline
def clear_hits(rays, shadow, instances):
    """No ray has hit anything yet."""
    for lane in range(np.uint64(LANES)):
        if shadow:
            rays.shadow.occluded[lane] = 0
        else:
            rays.primitive[lane] = -1
            if instances:
                rays.instance[lane] = -1


@inline
def finite_inverse(x, tiny):
    """1/x, but finite: a component too small to move the ray across the scene acts as if it were `tiny`."""
    return 1.0 / select(abs(x) > tiny, x, select(x >= 0.0, tiny, -tiny))


@inline
def make_ray(o, d, eps, real):
    """The ray from o along d, in arithmetic of relative precision `eps`."""
    tiny = real(1e-18)
    inverse = Vec3(finite_inverse(d.x, tiny), finite_inverse(d.y, tiny), finite_inverse(d.z, tiny))
    return Ray(o, d, inverse, ray_frame(d), extent(o) * real(PAD_ULPS * eps))


@inline
def distance_to_triangle(ray, corners, i):
    """Distance to triangle i of an array of `CornersRow`."""
    a = shear(ray.frame, corners[i].a - ray.o)
    b = shear(ray.frame, corners[i].b - ray.o)
    c = shear(ray.frame, corners[i].c - ray.o)
    return triangle_distance(a, b, c)


@inline
def distance_to_sphere(ray, spheres, i, real):
    """Distance to sphere i of the scene's."""
    return real(sphere_distance(to_float64(ray.o), to_float64(ray.d), spheres[i].center, spheres[i].radius))


def corners(flat: FlatScene) -> NDArray[Any]:
    """(triangles, 9) vertices of each triangle."""
    return flat.arrays[SceneTable.vertices][flat.arrays[SceneTable.triangles]].reshape(-1, 9)


def primitive_ids(flat: FlatScene) -> NDArray[np.int32]:
    """(n,) ids of triangles, then spheres, then analytic shapes, of a scene without instances."""
    kinds = SceneTable.triangle_primitives, SceneTable.sphere_primitives, SceneTable.analytic_primitives
    return np.concatenate([flat.arrays[kind] for kind in kinds])


def primitive_counts(flat: FlatScene) -> tuple[int, int, int, int]:
    """How many triangles, spheres, analytic shapes and instances there are."""
    fields = SceneTable.triangles, SceneTable.spheres, SceneTable.analytic_bounds, SceneTable.instance_bounds
    triangles, spheres, analytic, instances = (len(flat.arrays[field]) for field in fields)
    return triangles, spheres, analytic, instances


def boxes(flat: FlatScene) -> NDArray[Any]:
    """(n, 6) lower and upper corners of primitives, padded, in the tracing precision."""
    result = np.empty((sum(primitive_counts(flat)), 6), flat.real)
    _fill_boxes(*_shapes(flat), flat.real(padding(flat)), result)
    return result


def padding(flat: FlatScene) -> float:
    """Metres by which boxes are padded."""
    size = float(np.abs(flat.bounds - flat.center).max()) + float(np.ptp(flat.bounds, axis=0).max())
    return size * PAD_ULPS * float(np.finfo(flat.real).eps)


def _shapes(flat: FlatScene) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]:
    """Vertices, triangles, spheres, and the bounds of analytic shapes and of instances."""
    fields = SceneTable.vertices, SceneTable.triangles, SceneTable.spheres
    vertices, triangles, spheres = (flat.arrays[field] for field in fields)
    bounds = flat.arrays[SceneTable.analytic_bounds], flat.arrays[SceneTable.instance_bounds]
    return vertices, triangles, spheres, np.concatenate(bounds)


@kernel
def _fill_boxes(vertices, triangles, spheres, analytic, pad, result):
    n, end = len(triangles), len(triangles) + len(spheres)
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
    for i in range(len(analytic)):
        for axis in range(3):
            result[end + i, axis] = analytic[i, axis] - pad
            result[end + i, 3 + axis] = analytic[i, 3 + axis] + pad


def rounding(flat: FlatScene) -> float:
    """The share of a number by which it is rounded outwards to float32: that of the batch needs none."""
    return 0.0 if flat.real == np.float32 else 2.0**-23


@inline
def outward(low, high, pad, rounding, unit):
    """(lower, negated upper) end of a padded interval in multiples of `unit`, a power of two, rounded outwards to float32."""
    low, high = (low - pad) / unit, (high + pad) / unit
    return np.float32(low - abs(low) * rounding), np.float32(-(high + abs(high) * rounding))


def fill_records(
    flat: FlatScene, unit: float, first: int, last: int, records: NDArray[np.float32], order: NDArray[np.int32]
) -> None:
    """Boxes (n, 8) of primitives first .. last - 1 in multiples of `unit`, a power of two: lower and negated upper corner,
    padded, rounded outwards."""
    _fill_records(*_shapes(flat), padding(flat), rounding(flat), unit, first, last, records, order)


@kernel
def _fill_records(vertices, triangles, spheres, analytic, pad, rounding, unit, first, last, records, order):
    n, end = len(triangles), len(triangles) + len(spheres)
    for i in range(first, last):
        order[i] = i
        records[i, 3] = records[i, 7] = 0
        for axis in range(3):
            if i < n:
                x, y, z = (vertices[triangles[i, 0], axis], vertices[triangles[i, 1], axis], vertices[triangles[i, 2], axis])
                low, high = np.float64(min(x, y, z)), np.float64(max(x, y, z))
            elif i < end:
                center, radius = spheres[i - n, axis], spheres[i - n, 3]
                low, high = center - radius, center + radius
            else:
                low, high = analytic[i - end, axis], analytic[i - end, 3 + axis]
            records[i, axis], records[i, 4 + axis] = outward(low, high, pad, rounding, unit)

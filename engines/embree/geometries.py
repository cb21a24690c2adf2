"""The shapes that are solved in float64 and not by Embree: their bounding boxes and their distances.

Each has two functions of compiled code: bounds (scene, i) -> lowest and highest coordinates, and distance
(scene, i, o, d, origin_primitive) -> float64, not below inf where shape i is missed.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.lane.shapes.sphere import sphere_distance
from engines.kernels.lane.shapes.triangle import ray_frame, shear, triangle_distance
from engines.kernels.lane.vector import Vec3, to_float64
from engines.kernels.stages.linear import analytic_distance

TRIANGLES, SPHERES, ANALYTIC, INSTANCES = range(4)
"""Numbers of geometries in an RTCScene; that of the first instance, which the others follow."""


@inline
def exact_distance(o, d, scene, face):
    """Distance in float64 to a face of the scene, inf where it is missed; edges count, as in every engine."""
    o, frame, row = to_float64(o), ray_frame(to_float64(d)), scene.triangles[face]
    a = shear(frame, to_float64(scene.vertices[row.a]) - o)
    b = shear(frame, to_float64(scene.vertices[row.b]) - o)
    c = shear(frame, to_float64(scene.vertices[row.c]) - o)
    return triangle_distance(a, b, c)


@inline
def _triangle_bounds(scene, i):
    row = scene.triangles[i]
    low = high = to_float64(scene.vertices[row.a])
    for vertex in (row.b, row.c):
        p = to_float64(scene.vertices[vertex])
        low = Vec3(min(low.x, p.x), min(low.y, p.y), min(low.z, p.z))
        high = Vec3(max(high.x, p.x), max(high.y, p.y), max(high.z, p.z))
    return low, high


@inline
def _triangle_distance(scene, i, o, d, origin_primitive):
    t = exact_distance(o, d, scene, i)
    return select(scene.triangle_primitives[i] == origin_primitive, np.inf, t)


@inline
def _sphere_bounds(scene, i):
    center, radius = scene.spheres[i].center, scene.spheres[i].radius
    half = Vec3(radius, radius, radius)
    return center - half, center + half


@inline
def _sphere_distance(scene, i, o, d, origin_primitive):
    return sphere_distance(to_float64(o), to_float64(d), scene.spheres[i].center, scene.spheres[i].radius)


@inline
def _analytic_bounds(scene, i):
    box, k = scene.analytic_bounds, 6 * i
    return Vec3(box[k], box[k + 1], box[k + 2]), Vec3(box[k + 3], box[k + 4], box[k + 5])


def _make_analytic_distance(kinds: tuple[int, ...]) -> Any:
    distance_of = analytic_distance(kinds)

    @inline
    def distance(scene, i, o, d, origin_primitive):
        t = distance_of(scene, i, to_float64(o), to_float64(d))
        return select(scene.analytic_primitives[i] == origin_primitive, np.inf, t)

    return distance


def bounds_and_distance(geometry: int, analytic: tuple[int, ...]) -> tuple[Any, Any]:
    """The two functions of a geometry; `analytic` are the kinds of its shapes where it is that of analytic shapes."""
    if geometry == ANALYTIC:
        return _analytic_bounds, _make_analytic_distance(analytic)
    return (_sphere_bounds, _sphere_distance) if geometry == SPHERES else (_triangle_bounds, _triangle_distance)

"""Rays in the coordinates of groups, and what they meet there back in the world's.

An intersector that walks a group keeps the ray there in a second batch, `inner`, whose `origin_instance` is the instance. Its
searches are those of any batch: distances are the group's, and the primitive that the ray leaves is none where it leaves
another instance.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.lane.vector import Vec3, dot, largest, length, to_float64, to_real


class LocalRay(NamedTuple):
    """A ray in a group's coordinates, and how long a metre along it is there, in float64."""

    origin: Any
    direction: Any
    length: float


@inline
def to_group(instance, v):
    """A difference of points, in a group's coordinates. All are float64."""
    return Vec3(dot(instance.in_x, v), dot(instance.in_y, v), dot(instance.in_z, v))


@inline
def to_scene(instance, v):
    """A difference of points of a group, in the scene's coordinates."""
    return Vec3(dot(instance.out_x, v), dot(instance.out_y, v), dot(instance.out_z, v))


@inline
def normal_to_scene(instance, n):
    """The unit vector along M^-T n: fronts stay fronts where the matrix mirrors."""
    turned = instance.in_x * n.x + instance.in_y * n.y + instance.in_z * n.z
    return turned * (1.0 / length(turned))


@inline
def point_to_group(instance, p):
    """A point in a group's coordinates."""
    return to_group(instance, p - instance.moved)


@inline
def local_ray(instance, origin, direction, real):
    """A ray in a group's coordinates."""
    turned = to_group(instance, to_float64(direction))
    stretch = length(turned)
    start = point_to_group(instance, to_float64(origin))
    return LocalRay(to_real(start, real), to_real(turned * (1.0 / stretch), real), stretch)


@inline
def reach(instance, p, radius):
    """The largest number that makes up the coordinates of a point of a round shape, on the way to the group and back: rounding
    errors grow where the matrix is ill-conditioned."""
    size = Vec3(abs(p.x) + radius, abs(p.y) + radius, abs(p.z) + radius)
    x, y, z = _abs(instance.out_x), _abs(instance.out_y), _abs(instance.out_z)
    place = _products(x, y, z, size) + _abs(instance.moved)
    local = _products(_abs(instance.in_x), _abs(instance.in_y), _abs(instance.in_z), place)
    return max(largest(place), largest(_products(x, y, z, local)))


@inline
def _products(x, y, z, v):
    return Vec3(dot(x, v), dot(y, v), dot(z, v))


@inline
def _abs(v):
    return Vec3(abs(v.x), abs(v.y), abs(v.z))


@inline
def enter(rays, inner, scene, lane, i, shadow, real):
    """Puts a lane's ray, or its shadow ray, into the coordinates of instance i. Searches end a little later there, as t is
    rounded on the way there and back."""
    instance = scene.instances[i]
    wider = 1.0 + 8.0 * np.finfo(real).eps
    if shadow:
        ray = local_ray(instance, rays.shadow.origin[lane], rays.shadow.direction[lane], real)
        inner.shadow.origin[lane] = ray.origin
        inner.shadow.direction[lane] = ray.direction
        inner.shadow.t_max[lane] = real(np.float64(rays.shadow.t_max[lane]) * ray.length)
        inner.shadow.occluded[lane] = 0
    else:
        ray = local_ray(instance, rays.origin[lane], rays.direction[lane], real)
        inner.origin[lane] = ray.origin
        inner.direction[lane] = ray.direction
        inner.t[lane] = real(np.float64(rays.t[lane]) * ray.length * wider)
        inner.primitive[lane] = -1
    inner.origin_instance[lane] = i
    same = rays.origin_instance[lane] == i
    inner.origin_primitive[lane] = select(same, np.int64(rays.origin_primitive[lane]), np.int64(-1))


@inline
def leave(rays, inner, scene, lane, shadow, real):
    """Takes what a lane's ray has met in an instance where it is nearer than what the ray has met before, or as near and of a
    shape before it."""
    if shadow:
        if inner.shadow.occluded[lane] != 0:
            rays.shadow.occluded[lane] = 1
        return
    if inner.primitive[lane] < 0:
        return
    i = np.int64(inner.origin_instance[lane])
    instance = scene.instances[i]
    t = real(np.float64(inner.t[lane]) / length(to_group(instance, to_float64(rays.direction[lane]))))
    nearest, found, other = rays.t[lane], np.int64(rays.primitive[lane]), np.int64(rays.instance[lane])
    before = found >= np.int64(instance.behind) if other < 0 else i < other
    if t < nearest or (t == nearest and found >= 0 and before):
        rays.t[lane] = t
        rays.primitive[lane] = np.int64(inner.primitive[lane])
        rays.instance[lane] = i

"""Tests of a whole batch against lists: planes (which no tree can hold), a few spheres, other analytic shapes."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from engines.kernels.compile.dispatch import dispatch
from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import select
from engines.kernels.flatten.shapes import analytic_shape
from engines.kernels.lane.shapes.plane import plane_distance
from engines.kernels.lane.shapes.sphere import sphere_distance
from engines.kernels.lane.vector import dot, extent, to_float64, to_real
from engines.kernels.layout import LANES


@inline
def may_meet(rays, lane, primitive):
    """The lane's ray and shadow ray do not leave this primitive, which they would meet again within rounding."""
    return primitive != rays.origin_primitive[lane]


@inline
def keep_nearer(rays, scene, lane, t, primitive, valid, instances):
    """Takes a hit at distance t, in no instance, when it is nearer than the lane's, or as near and of a shape and a primitive
    before it. With `instances` the lane's may lie in one."""
    nearest, found = rays.t[lane], rays.primitive[lane]
    before = primitive < found
    if instances:
        before = is_before(scene, primitive, found, rays.instance[lane])
    better = valid & ((t < nearest) | ((t == nearest) & before))
    rays.t[lane] = select(better, t, nearest)
    rays.primitive[lane] = select(better, np.int64(primitive), found)
    if instances:
        rays.instance[lane] = select(better, np.int64(-1), np.int64(rays.instance[lane]))


@inline
def is_before(scene, primitive, found, instance):
    """Whether a primitive outside of groups comes before `found`, one of an instance (-1 for none), in the order of shapes."""
    return primitive < select(instance < 0, np.int64(found), np.int64(scene.instances[_row(instance)].behind))


@inline
def _row(instance):
    return select(instance < 0, np.int64(0), np.int64(instance))


@inline
def block_shadow(rays, lane, t, valid):
    """Marks the lane's shadow ray as blocked when t lies inside it."""
    blocked = valid & (t < rays.shadow.t_max[lane])
    rays.shadow.occluded[lane] = select(blocked, np.int64(1), rays.shadow.occluded[lane])


@inline
def _some_near(origin, direction, end, center, radius, real):
    """Whether some ray may meet a sphere, in the batch's precision: false only where float64 would find none. The bound covers
    the rounding of coordinates to that precision and of what is computed from them."""
    near, where = np.int32(0), to_real(center, real)
    slack, least = real(64.0 * np.finfo(real).eps), real(1e-37)
    place, square = extent(where), real(radius * radius * (1.0 + 1e-6))
    for lane in range(np.uint64(LANES)):
        d, to = direction[lane], where - origin[lane]
        size = extent(to) + extent(origin[lane]) + place
        along, bound = dot(to, d), square + (slack * size * size + least)
        distance = dot(to, to)
        ahead = (not (along < real(0))) | (not (distance > bound))
        meets = ahead & (not (distance * dot(d, d) - along * along > bound * dot(d, d)))
        near |= np.int32(1 if meets & (end[lane] > real(0)) else 0)
    return near != 0


@inline
def closest_planes(rays, scene, real, instances):
    for i in range(scene.n_planes):
        point, normal, primitive = scene.planes[i].point, scene.planes[i].normal, scene.plane_primitives[i]
        for lane in range(np.uint64(LANES)):
            o, d = to_float64(rays.origin[lane]), to_float64(rays.direction[lane])
            t = real(plane_distance(o, d, point, normal))
            keep_nearer(rays, scene, lane, t, primitive, (t > real(0)) & may_meet(rays, lane, primitive), instances)


@inline
def closest_spheres(rays, scene, first, last, real):
    """Of the spheres first .. last - 1, as below."""
    for i in range(first, last):
        center, radius, primitive = scene.spheres[i].center, scene.spheres[i].radius, scene.sphere_primitives[i]
        if not _some_near(rays.origin, rays.direction, rays.t, center, radius, real):
            continue
        for lane in range(np.uint64(LANES)):
            o, d = to_float64(rays.origin[lane]), to_float64(rays.direction[lane])
            t = real(sphere_distance(o, d, center, radius))
            keep_nearer(rays, scene, lane, t, primitive, t < real(np.inf), False)


@inline
def occluded_planes(rays, scene, real):
    for i in range(scene.n_planes):
        point, normal, primitive = scene.planes[i].point, scene.planes[i].normal, scene.plane_primitives[i]
        for lane in range(np.uint64(LANES)):
            o, d = to_float64(rays.shadow.origin[lane]), to_float64(rays.shadow.direction[lane])
            t = real(plane_distance(o, d, point, normal))
            block_shadow(rays, lane, t, (t > real(0)) & may_meet(rays, lane, primitive))


@inline
def occluded_spheres(rays, scene, first, last, real):
    for i in range(first, last):
        center, radius = scene.spheres[i].center, scene.spheres[i].radius
        if not _some_near(rays.shadow.origin, rays.shadow.direction, rays.shadow.t_max, center, radius, real):
            continue
        for lane in range(np.uint64(LANES)):
            o, d = to_float64(rays.shadow.origin[lane]), to_float64(rays.shadow.direction[lane])
            t = real(sphere_distance(o, d, center, radius))
            block_shadow(rays, lane, t, True)


@cache
def analytic_distance(kinds: tuple[int, ...]) -> Any:
    """The function (scene, i, o, d) -> distance in float64 to analytic shape i of the scene, one of these kinds; not
    below inf where it is missed, or met from behind the origin."""
    distance_of = dispatch(tuple((kind, analytic_shape(kind).lane.distance) for kind in kinds), branches=True)
    several, only = len(kinds) > 1, kinds[0]

    @inline
    def distance(scene, i, o, d):
        kind = np.int64(scene.primitives[scene.analytic_primitives[i]].shape) if several else np.int64(only)
        return distance_of(kind, np.inf, o, d, scene.analytic[i].parameters)

    return distance


@cache
def make_analytic_test(kinds: tuple[int, ...], shadow: bool) -> Any:
    """The function (rays, scene, first, last, real) that tests the batch's rays, or its shadow rays, against the analytic
    shapes first .. last - 1, of these kinds."""
    if not kinds:
        return nothing
    distance = analytic_distance(kinds)

    @inline
    def test(rays, scene, first, last, real):
        if shadow:
            origin, direction = rays.shadow.origin, rays.shadow.direction
        else:
            origin, direction = rays.origin, rays.direction
        for i in range(first, last):
            primitive = scene.analytic_primitives[i]
            for lane in range(np.uint64(LANES)):
                t = real(distance(scene, i, to_float64(origin[lane]), to_float64(direction[lane])))
                if shadow:
                    block_shadow(rays, lane, t, may_meet(rays, lane, primitive))
                else:
                    valid = (t < real(np.inf)) & may_meet(rays, lane, primitive)
                    keep_nearer(rays, scene, lane, t, primitive, valid, False)

    return test


@inline
def nothing(rays, scene, first, last, real):
    """Stands for the test of shapes that the scene lacks."""

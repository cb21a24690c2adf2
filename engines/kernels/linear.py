"""Tests of a whole block against lists: planes (which no tree can hold), and a few spheres."""

from __future__ import annotations

import numpy as np

from engines.kernels import block as at
from engines.kernels.jit import LANES, count, fetch, get, get_int, inline, put, put_int, select, table
from engines.kernels.shapes import plane_distance, sphere_distance
from engines.kernels.surface import row3, wide
from engines.kernels.world import (
    N_PLANES,
    N_SPHERES,
    PLANE_RANK,
    PLANE_REALS,
    PLANES,
    SPHERE_RANK,
    SPHERE_REALS,
    SPHERES,
)


@inline
def nearer(lanes, lane, t, rank, valid):
    """Takes a hit at distance t when it is nearer than the lane's, or as near and lower in rank."""
    best, held = get(lanes, at.T, lane), get_int(lanes, at.RANK, lane)
    better = valid & ((t < best) | ((t == best) & (rank < held)))
    put(lanes, at.T, lane, select(better, t, best))
    put_int(lanes, at.RANK, lane, select(better, held - held + rank, held))


@inline
def closest_planes(lanes, world, real):
    planes, ranks = table(world, PLANES, np.float64), table(world, PLANE_RANK, np.int32)
    for i in range(count(world, N_PLANES)):
        point, normal = row3(planes, i * PLANE_REALS), row3(planes, i * PLANE_REALS + 3)
        rank = fetch(ranks, i)
        for lane in range(np.uint64(LANES)):
            o, d = wide(at.get3(lanes, at.ORIGIN, lane)), wide(at.get3(lanes, at.DIRECTION, lane))
            t = real(plane_distance(o, d, point, normal))
            nearer(lanes, lane, t, rank, (t > real(0)) & (rank != get_int(lanes, at.LEFT, lane)))


@inline
def closest_spheres(lanes, world, real):
    spheres, ranks = table(world, SPHERES, np.float64), table(world, SPHERE_RANK, np.int32)
    for i in range(count(world, N_SPHERES)):
        center, radius = row3(spheres, i * SPHERE_REALS), fetch(spheres, i * SPHERE_REALS + 3)
        rank = fetch(ranks, i)
        for lane in range(np.uint64(LANES)):
            o, d = wide(at.get3(lanes, at.ORIGIN, lane)), wide(at.get3(lanes, at.DIRECTION, lane))
            t = real(sphere_distance(o, d, center, radius))
            nearer(lanes, lane, t, rank, t < real(np.inf))


@inline
def block_shadow(lanes, lane, t, valid):
    """Marks the lane's shadow ray as blocked when t lies inside it."""
    hidden = get_int(lanes, at.OCCLUDED, lane)
    blocked = valid & (t < get(lanes, at.SHADOW_T, lane))
    put_int(lanes, at.OCCLUDED, lane, select(blocked, hidden - hidden + 1, hidden))


@inline
def occluded_planes(lanes, world, real):
    planes, ranks = table(world, PLANES, np.float64), table(world, PLANE_RANK, np.int32)
    for i in range(count(world, N_PLANES)):
        point, normal = row3(planes, i * PLANE_REALS), row3(planes, i * PLANE_REALS + 3)
        rank = fetch(ranks, i)
        for lane in range(np.uint64(LANES)):
            o, d = wide(at.get3(lanes, at.SHADOW_ORIGIN, lane)), wide(at.get3(lanes, at.TO_LIGHT, lane))
            t = real(plane_distance(o, d, point, normal))
            block_shadow(lanes, lane, t, (t > real(0)) & (rank != get_int(lanes, at.LEFT, lane)))


@inline
def occluded_spheres(lanes, world, real):
    spheres = table(world, SPHERES, np.float64)
    for i in range(count(world, N_SPHERES)):
        center, radius = row3(spheres, i * SPHERE_REALS), fetch(spheres, i * SPHERE_REALS + 3)
        for lane in range(np.uint64(LANES)):
            o, d = wide(at.get3(lanes, at.SHADOW_ORIGIN, lane)), wide(at.get3(lanes, at.TO_LIGHT, lane))
            t = real(sphere_distance(o, d, center, radius))
            block_shadow(lanes, lane, t, True)

"""Path guiding by an SD-tree (`engines.sd_tree`; docs/transport.md): its sample, its densities, and what of a vertex is
recorded, for the tree to learn from.

Loops over lanes that compute are vector code; those that walk through the tree take one lane after the other.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from engines.kernels.compile.jit import compile_stage, inline
from engines.kernels.compile.records import lane_numbers
from engines.kernels.compile.values import const, lowest_bit, select
from engines.kernels.features import SceneFeatures
from engines.kernels.flatten.materials import MODELS
from engines.kernels.lane.arctan import arctan2
from engines.kernels.lane.vector import Vec3, dot, largest, sin_cos_turn
from engines.kernels.layout import LANES, ray_batch, scene_table
from engines.sd_tree import MOST_RECORDS

BELOW_ONE = 1.0 - 2.0**-53
HUGE = 3e38


# ---- the tree ----------------------------------------------------------------------------------------------------------


@inline
def _leaf_at(scene, box, p):
    """The leaf in which the point p lies; what is outside the box counts as on its surface."""
    node = np.int64(scene.guide_root)
    x, y, z = (p.x - box.corner.x) / box.size.x, (p.y - box.corner.y) / box.size.y, (p.z - box.corner.z) / box.size.z
    x, y, z = _clamped(np.float64(x)), _clamped(np.float64(y)), _clamped(np.float64(z))
    while node >= 0:
        doubled = 2.0 * x
        upper = doubled >= 1.0
        node = np.int64(scene.guide_halves[2 * node + select(upper, 1, 0)])
        x, y, z = y, z, doubled - select(upper, 1.0, 0.0)
    return -1 - node


@inline
def _clamped(x):
    """In [0, 1), and 0 of NaN."""
    x = select(x < BELOW_ONE, x, BELOW_ONE)
    return select(x > 0.0, x, 0.0)


@inline
def _chosen(u, share):
    """Whether u chooses the second of two, whose first has this share; and the rest of u."""
    second = u >= share
    rest = select(second, (u - share) / (1.0 - share), u / share)
    return second, select(rest < BELOW_ONE, rest, BELOW_ONE)


@inline
def _sample(scene, leaf, u0, u1):
    """A place (x, y) in the square of directions, in proportion to the light in the quadtree of a leaf."""
    node, x, y, edge = leaf, 0.0, 0.0, 1.0
    while node >= 0:
        right, u0 = _chosen(u0, np.float64(scene.guide_shares[3 * node]))
        high, u1 = _chosen(u1, np.float64(scene.guide_shares[3 * node + select(right, 2, 1)]))
        edge *= 0.5
        x += select(right, edge, 0.0)
        y += select(high, edge, 0.0)
        node = np.int64(scene.guide_quarters[4 * node + select(right, 1, 0) + select(high, 2, 0)])
    return x + u0 * edge, y + u1 * edge


@inline
def _look_up(scene, leaf, x, y):
    """The cell in which (x, y) lies, and the density of `_sample` per solid angle."""
    node, cell, pdf = leaf, np.int64(0), 1.0 / (4.0 * math.pi)
    while node >= 0:
        x, y = 2.0 * x, 2.0 * y
        right, high = x >= 1.0, y >= 1.0
        x, y = x - select(right, 1.0, 0.0), y - select(high, 1.0, 0.0)
        left = np.float64(scene.guide_shares[3 * node])
        low = np.float64(scene.guide_shares[3 * node + select(right, 2, 1)])
        pdf *= 4.0 * select(right, 1.0 - left, left) * select(high, 1.0 - low, low)
        cell = 4 * node + select(right, 1, 0) + select(high, 2, 0)
        node = np.int64(scene.guide_quarters[cell])
    return cell, pdf


@inline
def _place_of(wi):
    """(x, y) in the square, of a unit direction. Vector code, as is the way back."""
    half, zero, one = const(0.5, wi.x), const(0.0, wi.x), const(1.0, wi.x)
    turn = arctan2(wi.y, wi.x) * const(0.5 / math.pi, wi.x)
    return half * (wi.z + one), select(turn < zero, turn + one, turn)


@inline
def _direction_of(x, y):
    zero, one, two = const(0.0, x), const(1.0, x), const(2.0, x)
    z = two * x - one
    square = one - z * z
    radius = np.sqrt(select(square > zero, square, zero))
    sine, cosine = sin_cos_turn(y)
    return Vec3(radius * cosine, radius * sine, z)


# ---- before the BSDFs: which way a direction is sampled, and the tree's sample ------------------------------------------


@cache
def _make_only_delta(kinds: tuple[int, ...], features: SceneFeatures) -> Any:
    """The function (kind, parameters) -> whether all lobes of a material of one of these models are deltas."""

    @inline
    def none(kind, parameters):
        return False

    if not kinds:
        return none
    own, rest = kinds[0], _make_only_delta(kinds[1:], features)
    is_delta = MODELS[own].lane(features).only_delta or _never

    @inline
    def only_delta(kind, parameters):
        return ((kind == own) & is_delta(parameters)) | rest(kind, parameters)

    return only_delta


@inline
def _never(parameters):
    return False


@inline
def scattering_lanes(rays, max_depth):
    """The word of the lanes whose path goes on from a surface."""
    lanes = np.int64(0)
    for lane in range(np.uint64(LANES)):
        scatters = rays.alive[lane] & (not rays.miss[lane]) & (np.int64(rays.depth[lane]) < max_depth)
        lanes |= np.int64(1 if scatters else 0) << np.int64(lane)
    return lanes


def _make_choose(features: SceneFeatures, kinds: tuple[int, ...], masks: bool, hides: bool, real: Any) -> Any:
    only_delta, several = _make_only_delta(kinds, features), len(kinds) > 1
    single, zero, one, below_one = kinds[0] if kinds else 0, real(0), real(1), real(1.0 - np.finfo(real).epsneg)

    def choose(batch, scene_address):
        rays, scene = ray_batch(batch, real), scene_table(scene_address, real)
        box = scene.guide[0]
        lanes, fraction = scattering_lanes(rays, np.int64(scene.options[0])), real(box.bsdf_fraction)
        todo = lanes
        while todo != 0:
            lane = np.uint64(lowest_bit(todo))
            todo &= todo - 1
            rays.guide_leaf[lane] = _leaf_at(scene, box, rays.point[lane])
        todo = np.int64(0)
        for lane in range(np.uint64(LANES)):
            kind = np.int64(rays.bsdf_model[lane]) if several else np.int64(single)
            guided = (lanes >> np.int64(lane)) & 1 != 0
            guided = guided & (fraction < one) & (not only_delta(kind, lane_numbers(rays.bsdf, lane)))
            if masks:
                guided = guided & (not rays.passing[lane])
            if hides:
                guided = guided & (not rays.absent[lane])
            share, u = select(guided, fraction, one), rays.draw[3, lane]
            by_tree, rest = u >= share, u / share
            rays.bsdf_share[lane] = share
            rays.guided[lane] = by_tree
            rays.draw[3, lane] = select(rest < below_one, rest, below_one)
            todo |= np.int64(1 if by_tree else 0) << np.int64(lane)
        if todo == 0:
            return
        while todo != 0:
            lane = np.uint64(lowest_bit(todo))
            todo &= todo - 1
            u0, u1 = np.float64(rays.draw[4, lane]), np.float64(rays.draw[5, lane])
            x, y = _sample(scene, np.int64(rays.guide_leaf[lane]), u0, u1)
            rays.guide_x[lane], rays.guide_y[lane] = x, y
        for lane in range(np.uint64(LANES)):
            rays.guide_wi[lane] = _direction_of(rays.guide_x[lane], rays.guide_y[lane])

    return choose


# ---- behind the BSDFs: densities of both ways, and the record -----------------------------------------------------------


def _make_mix(masks: bool, lit: bool, real: Any) -> Any:
    zero, one, huge = real(0), real(1), real(HUGE)

    def mix(batch, scene_address):
        rays, scene = ray_batch(batch, real), scene_table(scene_address, real)
        lanes = scattering_lanes(rays, np.int64(scene.options[0]))
        for lane in range(np.uint64(LANES)):
            x, y = _place_of(rays.sample_wi[lane])
            rays.kept[0, lane], rays.kept[1, lane] = x, y
            rays.kept[2, lane] = 0.0
            if lit:
                x, y = _place_of(rays.wi[lane])
                rays.kept[3, lane], rays.kept[4, lane] = x, y
                rays.kept[5, lane] = 0.0
        todo = lanes
        while todo != 0:
            lane = np.uint64(lowest_bit(todo))
            todo &= todo - 1
            leaf = np.int64(rays.guide_leaf[lane])
            if rays.sample_valid[lane] and rays.sample_pdf[lane] <= huge:
                cell, pdf = _look_up(scene, leaf, _clamped(rays.kept[0, lane]), _clamped(rays.kept[1, lane]))
                rays.record_cell[lane] = cell
                rays.kept[2, lane] = pdf
            if lit and rays.bsdf_share[lane] < one and rays.value_scale[lane] > zero:
                _, pdf = _look_up(scene, leaf, _clamped(rays.kept[3, lane]), _clamped(rays.kept[4, lane]))
                rays.kept[5, lane] = pdf
        for lane in range(np.uint64(LANES)):
            share, pdf = rays.bsdf_share[lane], rays.sample_pdf[lane]
            by_tree = one - share
            if masks:
                by_tree = by_tree * rays.opacity[lane]
            specular, mixed = pdf > huge, share * pdf + by_tree * real(rays.kept[2, lane])
            by_bsdf = select(specular, one / share, pdf / mixed)
            factor = select(rays.guided[lane], one / mixed, by_bsdf)
            scale = rays.sample_scale[lane] * select(mixed > zero, factor, zero)
            rays.sample_scale[lane] = scale
            rays.sample_pdf[lane] = select(specular, pdf, mixed)
            if lit:
                rays.value_pdf[lane] = share * rays.value_pdf[lane] + by_tree * real(rays.kept[5, lane])
            # the record
            weight, depth = rays.sample_color[lane] * scale, np.int32(rays.depth[lane])
            side = dot(rays.geometric_normal[lane], rays.sample_wi[lane])
            leaves = select(rays.sample_transmitted[lane], -side, side) > zero
            kept = ((lanes >> np.int64(lane)) & 1 != 0) & rays.sample_valid[lane] & leaves & (not specular)
            kept = kept & (mixed > zero) & (largest(weight) > zero) & (depth <= np.int32(MOST_RECORDS))
            rays.record_vertex[lane] = select(kept, depth - np.int32(1), np.int32(-1))
            rays.record_throughput[lane] = rays.throughput[lane] * weight

    return mix


# ---- stages ------------------------------------------------------------------------------------------------------------


def stages(features: SceneFeatures, lit: bool, real: Any) -> tuple[Any, Any]:
    """(choose, mix): the stages before and behind those of the BSDFs."""
    return (
        _choose_stage(features.of_bsdfs, features.bsdfs, features.masks, features.hidden_emitters, real),
        _mix_stage(features.masks, lit, real),
    )


@cache
def _choose_stage(features: SceneFeatures, kinds: tuple[int, ...], masks: bool, hides: bool, real: Any) -> Any:
    return compile_stage(_make_choose(features, kinds, masks, hides, real))


@cache
def _mix_stage(masks: bool, lit: bool, real: Any) -> Any:
    return compile_stage(_make_mix(masks, lit, real))

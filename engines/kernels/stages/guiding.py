"""Path guiding by an SD-tree (`engines.sd_tree`; docs/transport.md): its sample, its densities, and what of a vertex is
recorded, for the tree to learn from.

All loops over lanes are vector code.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np

from engines.kernels.compile.dispatch import dispatch
from engines.kernels.compile.jit import compile_stage, inline
from engines.kernels.compile.masks import has_lane, lane_bit, lanes_where
from engines.kernels.compile.records import lane_numbers
from engines.kernels.compile.values import select
from engines.kernels.features import SceneFeatures, per_features
from engines.kernels.flatten.materials import MODELS
from engines.kernels.integrators.interface import MAX_DEPTH
from engines.kernels.lane.elementary import arctan2
from engines.kernels.lane.sampling import is_delta
from engines.kernels.lane.vector import Vec3, dot, largest, sin_cos_turn
from engines.kernels.layout import DIRECTION_U0, DIRECTION_U1, LANES, LOBE, SURFACE, ray_batch, scene_table
from engines.sd_tree import MOST_RECORDS

_inner = lanes_where(">=", 0)
"""The word of the lanes whose walk through a tree has not ended."""


# ---- walks through the tree, all lanes one level at a time --------------------------------------------------------------


@cache
def _make_clamped(real: Any) -> Any:
    """The function x -> x in [0, 1), 0 of NaN."""
    zero, below_one = real(0), real(1.0 - np.finfo(real).epsneg)

    @inline
    def clamped(x):
        x = select(x < below_one, x, below_one)
        return select(x > zero, x, zero)

    return clamped


@cache
def _make_find_leaves(real: Any) -> Any:
    """The function (rays, scene, box) that finds the leaf in which each lane's point lies; what is outside the box counts as
    on its surface."""
    clamped, zero, one, two = _make_clamped(real), real(0), real(1), real(2)

    @inline
    def find_leaves(rays, scene, box):
        root = np.int32(scene.guide_root)
        for lane in range(np.uint64(LANES)):
            p = rays.hit.point[lane]
            place = Vec3(
                (p.x - box.corner.x) / box.size.x, (p.y - box.corner.y) / box.size.y, (p.z - box.corner.z) / box.size.z
            )
            rays.guide.place[lane] = Vec3(clamped(place.x), clamped(place.y), clamped(place.z))
            rays.guide.node[lane] = root
        while _inner(rays.guide.node) != 0:
            for lane in range(np.uint64(LANES)):
                node, place = np.int32(rays.guide.node[lane]), rays.guide.place[lane]
                doubled = two * place.x
                upper = doubled >= one
                half = np.int32(
                    scene.guide_halves[np.int32(2) * max(node, np.int32(0)) + select(upper, np.int32(1), np.int32(0))]
                )
                rays.guide.node[lane] = select(node >= np.int32(0), half, node)
                rays.guide.place[lane] = Vec3(place.y, place.z, doubled - select(upper, one, zero))
        for lane in range(np.uint64(LANES)):
            rays.guide.leaf[lane] = np.int32(-1) - np.int32(rays.guide.node[lane])

    return find_leaves


@cache
def _make_sample(real: Any) -> Any:
    """The function (rays, scene) that samples a place in the square of directions in the lanes that the tree guides, in
    proportion to the light in the quadtree of their leaf."""
    below_one, zero, one, half = real(1.0 - np.finfo(real).epsneg), real(0), real(1), real(0.5)

    @inline
    def chosen(u, share):
        """Whether u chooses the second of two, whose first has this share; and the rest of u."""
        second = u >= share
        rest = select(second, u - share, u) / select(second, one - share, share)
        return second, select(rest < below_one, rest, below_one)

    @inline
    def sample(rays, scene):
        for lane in range(np.uint64(LANES)):
            rays.guide.node[lane] = select(rays.guide.by_tree[lane], np.int32(rays.guide.leaf[lane]), np.int32(-1))
            rays.guide.u0[lane], rays.guide.u1[lane] = rays.draw[DIRECTION_U0, lane], rays.draw[DIRECTION_U1, lane]
            rays.guide.x[lane], rays.guide.y[lane] = zero, zero
        edge = one
        while _inner(rays.guide.node) != 0:
            edge *= half
            for lane in range(np.uint64(LANES)):
                node = np.int32(rays.guide.node[lane])
                inner, n = node >= np.int32(0), max(node, np.int32(0))
                left = scene.guide_shares[np.int32(3) * n]
                right, u0 = chosen(rays.guide.u0[lane], left)
                low = scene.guide_shares[np.int32(3) * n + select(right, np.int32(2), np.int32(1))]
                high, u1 = chosen(rays.guide.u1[lane], low)
                quarter = select(right, np.int32(1), np.int32(0)) + select(high, np.int32(2), np.int32(0))
                divided = np.int32(scene.guide_quarters[np.int32(4) * n + quarter])
                last = inner & (divided < np.int32(0))
                x = rays.guide.x[lane] + select(right, edge, zero) + select(last, u0 * edge, zero)
                y = rays.guide.y[lane] + select(high, edge, zero) + select(last, u1 * edge, zero)
                rays.guide.x[lane] = select(inner, x, rays.guide.x[lane])
                rays.guide.y[lane] = select(inner, y, rays.guide.y[lane])
                rays.guide.u0[lane], rays.guide.u1[lane] = u0, u1
                rays.guide.node[lane] = select(inner, divided, np.int32(-1))
        for lane in range(np.uint64(LANES)):
            rays.guide.wi[lane] = _direction_of(rays.guide.x[lane], rays.guide.y[lane])

    return sample


@cache
def _make_look_up(real: Any) -> Any:
    """The function (rays, scene) that finds, for the places (`guide.x`, `guide.y`), the cells in which they lie, as
    `recorded.cell`, and the density of the tree's samples per solid angle, as `guide.pdf`, by the quadtree whose root is
    `guide.node`; where that is -1 the density is 0."""
    zero, one, two, sphere = real(0), real(1), real(2), real(1.0 / (4.0 * math.pi))

    @inline
    def look_up(rays, scene):
        for lane in range(np.uint64(LANES)):
            rays.guide.pdf[lane] = select(np.int32(rays.guide.node[lane]) >= np.int32(0), sphere, zero)
        while _inner(rays.guide.node) != 0:
            for lane in range(np.uint64(LANES)):
                node = np.int32(rays.guide.node[lane])
                inner, n = node >= np.int32(0), max(node, np.int32(0))
                x, y = two * rays.guide.x[lane], two * rays.guide.y[lane]
                right, high = x >= one, y >= one
                rays.guide.x[lane], rays.guide.y[lane] = x - select(right, one, zero), y - select(high, one, zero)
                cell = np.int32(4) * n + select(right, np.int32(1), np.int32(0)) + select(high, np.int32(2), np.int32(0))
                rays.guide.pdf[lane] = rays.guide.pdf[lane] * select(inner, scene.guide_densities[cell], one)
                rays.recorded.cell[lane] = select(inner, cell, np.int32(rays.recorded.cell[lane]))
                rays.guide.node[lane] = select(inner, np.int32(scene.guide_quarters[cell]), np.int32(-1))

    return look_up


@inline
def _place_of(wi):
    """(x, y) in the square, of a unit direction. Vector code, as is the way back."""
    turn = arctan2(wi.y, wi.x) * (0.5 / math.pi)
    return 0.5 * (wi.z + 1.0), select(turn < 0.0, turn + 1.0, turn)


@inline
def _direction_of(x, y):
    z = 2.0 * x - 1.0
    square = 1.0 - z * z
    radius = np.sqrt(select(square > 0.0, square, 0.0))
    sine, cosine = sin_cos_turn(y)
    return Vec3(radius * cosine, radius * sine, z)


# ---- before the BSDFs: which way a direction is sampled, and the tree's sample ------------------------------------------


def _only_delta(features: SceneFeatures) -> Any:
    """The function (kind, found, parameters) -> whether all lobes of a material of one of the scene's models are deltas."""
    return dispatch(tuple((kind, MODELS[kind].lane(features).only_delta or _never) for kind in features.bsdfs))


@inline
def _never(parameters):
    return False


@inline
def scattering_lanes(rays, max_depth):
    """The word of the lanes whose path goes on from a surface."""
    lanes = np.int64(0)
    for lane in range(np.uint64(LANES)):
        scatters = rays.alive[lane] & (rays.hit.kind[lane] == SURFACE) & (np.int64(rays.path.depth[lane]) < max_depth)
        lanes |= lane_bit(lane, scatters)
    return lanes


def _make_choose(features: SceneFeatures, real: Any) -> Any:
    kinds, masks, hides = features.bsdfs, features.masks, features.hidden_emitters
    only_delta, several = _only_delta(features), len(kinds) > 1
    single, one, below_one = kinds[0] if kinds else 0, real(1), real(1.0 - np.finfo(real).epsneg)

    find_leaves, sample = _make_find_leaves(real), _make_sample(real)

    def choose(batch, scene_address):
        rays, scene = ray_batch(batch, real), scene_table(scene_address, real)
        box = scene.guide[0]
        lanes, fraction, some = scattering_lanes(rays, np.int64(scene.options[MAX_DEPTH])), real(box.bsdf_fraction), np.int64(0)
        find_leaves(rays, scene, box)
        for lane in range(np.uint64(LANES)):
            kind = np.int64(rays.bsdf_model[lane]) if several else np.int64(single)
            guided = has_lane(lanes, lane)
            guided = guided & (fraction < one) & (not only_delta(kind, False, lane_numbers(rays.bsdf, lane)))
            if masks:
                guided = guided & (not rays.wrapped.passing[lane])
            if hides:
                guided = guided & (not rays.crossing.absent[lane])
            share, u = select(guided, fraction, one), rays.draw[LOBE, lane]
            by_tree, rest = u >= share, u / share
            rays.guide.bsdf_share[lane] = share
            rays.guide.by_tree[lane] = by_tree
            rays.draw[LOBE, lane] = select(rest < below_one, rest, below_one)
            some |= np.int64(1 if by_tree else 0)
        if some != 0:
            sample(rays, scene)

    return choose


# ---- behind the BSDFs: densities of both ways, and the record -----------------------------------------------------------


def _make_mix(masks: bool, lit: bool, real: Any) -> Any:
    zero, one = real(0), real(1)
    look_up, clamped = _make_look_up(real), _make_clamped(real)

    def mix(batch, scene_address):
        rays, scene = ray_batch(batch, real), scene_table(scene_address, real)
        lanes = scattering_lanes(rays, np.int64(scene.options[MAX_DEPTH]))
        if lit:
            for lane in range(np.uint64(LANES)):
                asked = has_lane(lanes, lane) & (rays.guide.bsdf_share[lane] < one)
                asked = asked & (rays.scatter.value.scale[lane] > zero)
                x, y = _place_of(rays.light_sample.wi[lane])
                rays.guide.x[lane], rays.guide.y[lane] = clamped(x), clamped(y)
                rays.guide.node[lane] = select(asked, np.int32(rays.guide.leaf[lane]), np.int32(-1))
            look_up(rays, scene)
            for lane in range(np.uint64(LANES)):
                share, opacity = rays.guide.bsdf_share[lane], rays.wrapped.opacity[lane] if masks else one
                by_tree = (one - share) * opacity * rays.guide.pdf[lane]
                rays.scatter.pdf[lane] = share * rays.scatter.pdf[lane] + by_tree
        for lane in range(np.uint64(LANES)):
            sample = rays.scatter.sample[lane]
            asked = has_lane(lanes, lane) & sample.valid & (not is_delta(sample.pdf))
            x, y = _place_of(sample.wi)
            rays.guide.x[lane], rays.guide.y[lane] = clamped(x), clamped(y)
            rays.guide.node[lane] = select(asked, np.int32(rays.guide.leaf[lane]), np.int32(-1))
        look_up(rays, scene)
        for lane in range(np.uint64(LANES)):
            share, sample = rays.guide.bsdf_share[lane], rays.scatter.sample[lane]
            pdf = sample.pdf
            opacity = rays.wrapped.opacity[lane] if masks else one
            specular, mixed = is_delta(pdf), share * pdf + (one - share) * opacity * rays.guide.pdf[lane]
            by_bsdf = select(specular, one / share, pdf / mixed)
            factor = select(rays.guide.by_tree[lane], one / mixed, by_bsdf)
            ratio = select(specular, one, select(pdf > zero, mixed / pdf, one))
            ratio = select(ratio > one, ratio, one)
            rays.scatter.eta_scale[lane] = rays.scatter.eta_scale[lane] * ratio
            scale = sample.weight.scale * select(mixed > zero, factor, zero)
            rays.scatter.sample.weight.scale[lane] = scale
            rays.scatter.sample.pdf[lane] = select(specular, pdf, mixed)
            # the record
            weight, depth = sample.weight.color * scale, np.int32(rays.path.depth[lane])
            side = dot(rays.hit.geometric_normal[lane], sample.wi)
            leaves = select(sample.transmitted, -side, side) > zero
            kept = has_lane(lanes, lane) & sample.valid & leaves & (not specular)
            kept = kept & (mixed > zero) & (largest(weight) > zero) & (depth <= np.int32(MOST_RECORDS))
            rays.recorded.vertex[lane] = select(kept, depth - np.int32(1), np.int32(-1))
            rays.recorded.throughput[lane] = rays.path.throughput[lane]

    return mix


# ---- stages ------------------------------------------------------------------------------------------------------------


@per_features
def choose_stage(features: SceneFeatures, real: Any) -> Any:
    """The stage before those of the BSDFs."""
    return compile_stage(_make_choose(features, real))


@cache
def mix_stage(masks: bool, lit: bool, real: Any) -> Any:
    """The stage behind those of the BSDFs."""
    return compile_stage(_make_mix(masks, lit, real))

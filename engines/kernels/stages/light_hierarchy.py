"""The choice of a light by a hierarchy whose nodes have eight children: one point against eight of them at once
(docs/transport.md). Sines and cosines stand for the angles."""

from __future__ import annotations

import math
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.masks import lane_bit
from engines.kernels.compile.simd import lane as number
from engines.kernels.compile.simd import load8, splat
from engines.kernels.compile.values import lowest_bit, select
from engines.kernels.flatten.light_samplers import NODE_NUMBERS
from engines.kernels.integrators.interface import MAX_DEPTH
from engines.kernels.lane.media import is_at_vertex_of_medium
from engines.kernels.layout import LANES, LIGHT, MISS

WIDTH = 8


@inline
def _sine(cosine, zero, one):
    rest = one - cosine * cosine
    return math.sqrt(select(rest > zero, rest, zero))


@inline
def _shares(scene, node, p, normal, media, real):
    """How much each child of a node may send to the point p, on the surface with this geometric normal. Where there are
    `media`, it may lie in one of them: then the normal is 0."""
    rows, first = scene.light_nodes, node * NODE_NUMBERS
    zero, one = splat(real(0)), splat(real(1))
    x, y, z = p.x - load8(rows, first), p.y - load8(rows, first + 8), p.z - load8(rows, first + 16)
    radius, square = load8(rows, first + 24), x * x + y * y + z * z
    inside = square <= radius * radius
    square = select(inside, radius * radius, square)
    tiny = splat(real(1e-30))
    square = select(square > tiny, square, tiny)
    inverse = one / math.sqrt(square)
    sin_half = radius * inverse
    cos_half = _sine(sin_half, zero, one)
    # the least angle between the light's cone and a direction to the point
    cosine = (load8(rows, first + 32) * x + load8(rows, first + 40) * y + load8(rows, first + 48) * z) * inverse
    sine, cos_spread, sin_spread = _sine(cosine, zero, one), load8(rows, first + 56), load8(rows, first + 64)
    within = cosine >= cos_spread
    outside = cosine * cos_spread + sine * sin_spread
    sine = select(within, zero, sine * cos_spread - cosine * sin_spread)
    cosine = select(within, one, outside)
    emitted = select((cosine >= cos_half) | inside, one, cosine * cos_half + sine * sin_half)
    # the least one between the normal and a direction to the light
    cosine = -(normal.x * x + normal.y * y + normal.z * z) * inverse
    if scene.lit_through != 0:
        cosine = abs(cosine)
    if media and is_at_vertex_of_medium(normal):
        cosine = one
    sine = _sine(cosine, zero, one)
    incident = select((cosine >= cos_half) | inside, one, cosine * cos_half + sine * sin_half)
    lit = (emitted > load8(rows, first + 72)) & (incident > zero)
    return select(lit, load8(rows, first + 80) * emitted * incident / square, zero)


class Sums(NamedTuple):
    """Sums of the first one, two, ... eight numbers."""

    a: float
    b: float
    c: float
    d: float
    e: float
    f: float
    g: float
    total: float


@inline
def _sums(shares):
    a = np.float64(number(shares, 0))
    b = a + np.float64(number(shares, 1))
    c = b + np.float64(number(shares, 2))
    d = c + np.float64(number(shares, 3))
    e = d + np.float64(number(shares, 4))
    f = e + np.float64(number(shares, 5))
    g = f + np.float64(number(shares, 6))
    return Sums(a, b, c, d, e, f, g, g + np.float64(number(shares, 7)))


@inline
def _past(target, edge, slot, begin):
    """The slot after `edge`, and where it begins, where the target is not below the edge."""
    past = target >= edge
    return slot + select(past, 1, 0), select(past, edge, begin)


@inline
def _slot(sums, target):
    """(the slot whose share holds the target, where the share begins)."""
    slot, begin = _past(target, sums.a, np.int64(0), 0.0)
    slot, begin = _past(target, sums.b, slot, begin)
    slot, begin = _past(target, sums.c, slot, begin)
    slot, begin = _past(target, sums.d, slot, begin)
    slot, begin = _past(target, sums.e, slot, begin)
    slot, begin = _past(target, sums.f, slot, begin)
    return _past(target, sums.g, slot, begin)


@inline
def _start(rays, scene, lane):
    """Chooses a light without a box, or the tree's root; returns whether the lane goes through the tree. A lane that samples
    no light has -1."""
    light, parts, goes = np.int64(-1), scene.light_parts, False
    rays.light_inverse_pmf[lane] = np.inf
    if rays.alive[lane] and rays.hit.kind[lane] != MISS and rays.path.depth[lane] < scene.options[MAX_DEPTH]:
        scaled = np.float64(rays.draw[LIGHT, lane]) * parts
        part = max(min(np.int64(scaled), parts - 1), 0)
        goes = part >= scene.n_unbounded_lights
        light = np.int64(-1) if goes else np.int64(scene.unbounded_lights[part])
        rays.draw[LIGHT, lane] = scaled - part
        rays.light_inverse_pmf[lane] = parts
    rays.chosen_light[lane] = light
    rays.light_node[lane] = 0
    return goes


@inline
def _descend(rays, scene, lane, media, real, below_one):
    """Goes from the lane's node to a child, or to a light; returns whether it goes on."""
    node, u = np.int64(rays.light_node[lane]), np.float64(rays.draw[LIGHT, lane])
    shares = _shares(scene, node, rays.hit.point[lane], rays.hit.geometric_normal[lane], media, real)
    sums = _sums(shares)
    target = u * sums.total
    slot, start = _slot(sums, target)
    share = np.float64(number(shares, slot))
    if not share > 0.0:  # no child may send light
        rays.light_inverse_pmf[lane] = np.inf
        return False
    rest = (target - start) / share
    rays.draw[LIGHT, lane] = select(rest < below_one, rest, below_one)
    rays.light_inverse_pmf[lane] = np.float64(rays.light_inverse_pmf[lane]) * (sums.total / share)
    child = np.int64(scene.light_children[node * WIDTH + slot])
    if child < 0:
        rays.chosen_light[lane] = -1 - child
        return False
    rays.light_node[lane] = child
    return True


@cache
def make_choose(media: bool, real: Any) -> Any:
    """The function (rays, scene) that chooses each lane's light: its index, or -1 for none, 1 / the probability,
    and what is left of the draw. Lanes take turns, so that the processor works on one while another waits
    for a root."""
    below_one = 1.0 - float(np.finfo(real).epsneg)

    @inline
    def choose(rays, scene):
        waiting = np.int64(0)
        for lane in range(np.uint64(LANES)):
            waiting |= lane_bit(lane, _start(rays, scene, lane))
        while waiting != 0:
            turn, waiting = waiting, np.int64(0)
            while turn != 0:
                lane = np.uint64(lowest_bit(turn))
                turn &= turn - 1
                waiting |= lane_bit(lane, _descend(rays, scene, lane, media, real, below_one))

    return choose


@inline
def inverse_pmf(scene, light, p, normal, media, real):
    """1 / the probability with which the light is chosen at the point p."""
    probability, place = 1.0 / scene.light_parts, np.int64(scene.light_places[light])
    while place >= 0 and probability > 0.0:
        shares = _shares(scene, place // WIDTH, p, normal, media, real)
        share = np.float64(number(shares, place % WIDTH))
        probability *= share / _sums(shares).total if share > 0.0 else 0.0
        place = np.int64(scene.light_parents[place // WIDTH])
    return 1.0 / probability if probability > 0.0 else np.inf

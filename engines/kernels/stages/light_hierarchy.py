"""The choice of a light by a hierarchy whose nodes have eight children: one point against eight of them at once
(docs/transport.md). Sines and cosines stand for the angles."""

from __future__ import annotations

import math

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.simd import lane as number
from engines.kernels.compile.simd import load8, splat
from engines.kernels.compile.values import select
from engines.kernels.flatten.light_samplers import NODE_NUMBERS

WIDTH = 8
_BELOW_ONE = 1.0 - 2.0**-53


@inline
def _sine(cosine, zero, one):
    rest = one - cosine * cosine
    return math.sqrt(select(rest > zero, rest, zero))


@inline
def _shares(scene, node, p, normal, real):
    """How much each child of a node may send to the point p, on the surface with this geometric normal."""
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
    sine = _sine(cosine, zero, one)
    incident = select((cosine >= cos_half) | inside, one, cosine * cos_half + sine * sin_half)
    lit = (emitted > load8(rows, first + 72)) & (incident > zero)
    return select(lit, load8(rows, first + 80) * emitted * incident / square, zero)


@inline
def _total(shares):
    total = 0.0
    for k in range(WIDTH):
        total += np.float64(number(shares, k))
    return total


@inline
def choose(scene, p, normal, u, real):
    """(index of the light that `u` chooses, -1 for none; what is left of u, in [0, 1); 1 / the probability)."""
    parts, unbounded = scene.light_parts, scene.n_unbounded_lights
    scaled = u * parts
    part = max(min(np.int64(scaled), parts - 1), 0)
    rest, probability = scaled - part, 1.0 / parts
    if part < unbounded:
        return np.int64(scene.unbounded_lights[part]), rest, np.float64(parts)
    node = np.int64(0)
    while True:
        shares = _shares(scene, node, p, normal, real)
        total = _total(shares)
        if not total > 0.0:
            return np.int64(-1), rest, np.inf
        target, slot, running, below, share = rest * total, np.int64(0), 0.0, 0.0, 1.0
        for k in range(WIDTH):
            own = np.float64(number(shares, k))
            taken = (own > 0.0) & (running <= target)
            slot, below, share = select(taken, k, slot), select(taken, running, below), select(taken, own, share)
            running += own
        rest = min((target - below) / share, _BELOW_ONE)
        probability *= share / total
        child = np.int64(scene.light_children[node * WIDTH + slot])
        if child < 0:
            return -1 - child, rest, 1.0 / probability
        node = child


@inline
def choices(scene, light, p, normal, real):
    """1 / the probability with which `choose` gives the light."""
    probability, place = 1.0 / scene.light_parts, np.int64(scene.light_places[light])
    while place >= 0 and probability > 0.0:
        shares = _shares(scene, place // WIDTH, p, normal, real)
        share = np.float64(number(shares, place % WIDTH))
        probability *= share / _total(shares) if share > 0.0 else 0.0
        place = np.int64(scene.light_parents[place // WIDTH])
    return 1.0 / probability if probability > 0.0 else np.inf

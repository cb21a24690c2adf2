"""From the two-wide tree to an eight-wide one: which nodes survive is chosen for the least expected cost of a ray.

The cost of showing what lies below a node as at most i = 1 .. 7 children of one wide node follows from the costs of its
halves (dynamic programming after Ylitie, Karras and Laine 2017). Whether a node ends as a leaf is part of the choice.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.kernels.compile.jit import inline, kernel
from engines.kernels.compile.memory import array_at
from engines.kernels.compile.simd import load8
from engines.numba_cpu.accel.bvh_build import INSTANCES, LEAF, kind_of
from engines.numba_cpu.accel.bvh_cuts import half_area

WIDTH = 8
NODE_COST, LEAF_COST = 1.0, 1.0
"""The step of a ray through a wide node, and through a leaf, in the same unit of time."""
NODE_WORDS = 64
"""A wide node: x, y, z of its children's lower corners and then of the upper ones, eight float32 each; the children, eight
int32, NOTHING for none; and eight unused words. A child is a wide node, or a leaf -1 - (32 first + 8 kind + count - 1), which
holds count primitives of a kind from place `first`; of an instance, `first` is its number and count 1."""
CHILDREN = 48
NOTHING = -(2**31)
MOST_PRIMITIVES = 2**26 - 1
TINY = 2.0**-100
"""By so many multiples of `unit` boxes are widened, as rounding of the smallest numbers is not relative. A plane at 0 must not
become a denormal number, with which processors compute slowly: it is LEAST at least."""
LEAST = 1.2e-38


class Choices(NamedTuple):
    """`costs` (n, 7) float32: of a node shown as at most 1 .. 7 children, over its area. `ways` (n, 7) int8: how many of 8 the
    first half gets where the node is wide, 0 for a leaf; then how many of 2 .. 7 where it is not, 0 where one less does."""

    costs: NDArray[np.float32]
    ways: NDArray[np.int8]


@inline
def _best_way(costs, left, i):
    """(cost, way) of sharing i children among both halves."""
    least, way = np.float32(np.inf), max(i - 7, 1)
    for k in range(max(i - 7, 1), min(i, 8)):
        cost = costs[left, k - 1] + costs[left + 1, i - k - 1]
        if cost < least:
            least, way = cost, k
    return least, way


@inline
def _weigh(boxes, links, choices, n, order, firsts):
    costs, ways = choices.costs, choices.ways
    first, count, left = links[n, 0], links[n, 1], links[n, 2]
    area = half_area(load8(boxes, 8 * n))
    lowest = kind_of(order[first], firsts)
    highest = kind_of(order[first + count - 1], firsts)
    most = 1 if highest == INSTANCES else LEAF
    may_end = count <= most and lowest == highest  # small nodes are sorted by kind
    leaf = area * np.float32(LEAF_COST) if may_end else np.float32(np.inf)
    if left == 0:
        costs[n] = leaf
        ways[n] = 0
        return
    least, way = _best_way(costs, left, 8)
    least += area * np.float32(NODE_COST)
    costs[n, 0], ways[n, 0] = (leaf, 0) if may_end and leaf <= least else (least, way)
    for i in range(2, 8):
        least, way = _best_way(costs, left, i)
        fewer = costs[n, i - 2]
        costs[n, i - 1], ways[n, i - 1] = (least, way) if least < fewer else (fewer, 0)


@kernel
def weigh(boxes, links, choices, first, last, order, firsts):
    """Fills `choices` for the nodes last - 1 .. first, of which none may lie below an earlier one."""
    for n in range(last - 1, first - 1, -1):
        _weigh(array_at(boxes.ctypes.data, np.float32), links, choices, n, order, firsts)


@inline
def _children(links, ways, n, found, todo):
    """Finds the two-wide nodes that become the children of a wide node; returns their number."""
    if ways[n, 0] == 0:  # the root is a leaf
        found[0] = n
        return 1
    todo[0, 0], todo[0, 1] = links[n, 2] + 1, WIDTH - ways[n, 0]
    todo[1, 0], todo[1, 1] = links[n, 2], ways[n, 0]
    top, size = 2, 0
    while top > 0:
        top -= 1
        m, i = todo[top, 0], todo[top, 1]
        while i > 1 and ways[m, i - 1] == 0:
            i -= 1
        if i == 1:
            found[size] = m
            size += 1
            continue
        todo[top, 0], todo[top, 1] = links[m, 2] + 1, i - ways[m, i - 1]
        todo[top + 1, 0], todo[top + 1, 1] = links[m, 2], ways[m, i - 1]
        top += 2
    return size


@inline
def _put_child(boxes, unit, nodes, place, m):
    tiny = max(TINY * unit, LEAST)
    for axis in range(3):
        nodes[place + 8 * axis] = np.float32(boxes[m, axis] * unit - tiny if m >= 0 else np.inf)
        nodes[place + 24 + 8 * axis] = np.float32(tiny - boxes[m, 4 + axis] * unit if m >= 0 else -np.inf)


@kernel
def widen(boxes, unit, links, ways, order, firsts, write, nodes, leaves):
    """Fills wide `nodes` (k, 64) float32, depth first, and `leaves` (l, 4) int32: where their parts start in `order`, count,
    kind, and the place in memory of the first. Returns (k, l), and with `write` False only those. `boxes` are in multiples of
    `unit`."""
    numbers, words = array_at(nodes.ctypes.data, np.float32), array_at(nodes.ctypes.data, np.int32)
    found, work = np.empty(WIDTH, np.int64), np.empty((2 * WIDTH, 2), np.int64)
    todo = np.empty((1024, 2), np.int64)
    todo[0, 0], todo[0, 1] = 0, 0
    top, used, ended, placed = 1, 1, 0, 0
    while top > 0:
        top -= 1
        n, base = todo[top, 0], todo[top, 1] * NODE_WORDS
        size = _children(links, ways, n, found, work)
        for slot in range(WIDTH):
            m, child = -1, np.int64(NOTHING)
            if slot < size:
                m, kind = found[slot], np.int64(-1)
                if ways[m, 0] == 0:
                    kind = kind_of(order[links[m, 0]], firsts)
                    child = -1 - (32 * (np.int64(order[links[m, 0]]) - firsts.instance) + 8 * kind)
                if ways[m, 0] == 0 and kind != INSTANCES:
                    if write:
                        leaves[ended, 0], leaves[ended, 1], leaves[ended, 2] = links[m, 0], links[m, 1], kind
                        leaves[ended, 3] = placed
                    child = -1 - (32 * placed + 8 * kind + np.int64(links[m, 1]) - 1)
                    ended += 1
                    placed += np.int64(links[m, 1])
                elif ways[m, 0] != 0:
                    todo[top, 0], todo[top, 1] = m, used
                    child = used
                    used += 1
                    top += 1
            if write:
                _put_child(boxes, unit, numbers, base + slot, m)
                words[base + CHILDREN + slot] = child
    return used, ended

"""The two stages that walk the eight-wide tree, in which the sixteen rays of a block take turns.

In each round every ray takes one step: eight boxes of a node, or up to eight primitives of a leaf, in vector code without a
branch. A ray alone would wait at each step for memory and for the next branch; sixteen steps that do not depend on one
another overlap. This, not the width, is what pays (docs/performance.md).
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from engines.kernels import block as at
from engines.kernels.jit import (
    LANES,
    bits_set,
    compile_stage,
    const,
    count,
    fetch,
    float_bits,
    fma,
    get,
    get_int,
    highest_bit,
    inline,
    keep,
    pointer,
    put,
    put_int,
    select,
    table,
)
from engines.kernels.linear import closest_planes, occluded_planes
from engines.kernels.shapes import ray_frame, sphere_distance, triangle_distance
from engines.kernels.simd import as_bits, bits, convert, descending, fetch8, iota, keep8, lowest, prefetch, splat
from engines.kernels.surface import wide
from engines.kernels.vector import Vec3, extent
from engines.kernels.world import ACCELERATOR
from engines.numba_cpu.accel.bvh_build import DEEPEST
from engines.numba_cpu.accel.bvh_collapse import CHILDREN, NODE_WORDS, NOTHING, NOTHINGS
from engines.numba_cpu.accel.bvh_leaves import stride
from engines.numba_cpu.accel.primitives import PAD_ULPS, finite_inverse

NODES, LEAVES = ACCELERATOR, ACCELERATOR + 1
EPS = float(np.finfo(np.float32).eps)
WIDEN = 1 + 16 * EPS
"""Boxes are float32 in either precision. Far ends are taken this much farther, which covers every rounding in them."""

# A ray's record, in 32-bit words: 1 / direction, offsets of near and far planes, the widened distance of the nearest hit
# and its bits as a bound of keys; rows of near planes, place in the tree, height of the stack; axes and reals for triangles.
INVERSE, NEAR, FAR, REACH, BOUND, ROW, PLACE, HEIGHT, TURN, REALS = 0, 3, 6, 9, 10, 11, 14, 15, 16, 20
KEYS = 32
# Three levels of the two-wide tree make seven entries at most; eight are written at a time, and eight lie below the first.
STACK = 7 * (DEEPEST + 32) // 3 + 21
PARENTS = KEYS + STACK
RECORD = -(-(PARENTS + STACK) // 16) * 16
AT_NODES, AT_LEAVES = LANES * RECORD, LANES * RECORD + LANES + 1
SCRATCH = LANES * RECORD + 2 * (LANES + 1)
STEP_LINES = 5
"""Cache lines of a step: four of a node, five of a leaf."""
SLOT = 7
"""The bits of a key that say which child it is; the others are those of the distance to it, rounded down."""


class Ray(NamedTuple):
    """Pointers to one lane's record."""

    words: Any
    numbers: Any
    reals: Any


class Rule(NamedTuple):
    """What the tree holds, what is asked, and which fields of the block hold the ray."""

    triangles: bool
    spheres: bool
    shadow: bool
    origin: int
    direction: int


class Tree(NamedTuple):
    """Nodes by address, as numbers and as words; leaves by address."""

    nodes: Any
    planes: Any
    words: Any
    leaves: Any


class Queues(NamedTuple):
    """Lanes that stand at a node, and at a leaf."""

    nodes: Any
    leaves: Any


class Waiting(NamedTuple):
    """The lengths of both queues."""

    nodes: int
    leaves: int


@inline
def _ray(scratch, lane, real):
    place = scratch + 4 * RECORD * np.int64(lane)
    return Ray(pointer(place, np.int32), pointer(place, np.float32), pointer(place + 4 * REALS, real))


@inline
def _least(a, b):
    return select(a < b, a, b)


@inline
def _most(a, b):
    return select(a > b, a, b)


@inline
def _set_reach(ray, t):
    reach = np.float32(t) * np.float32(WIDEN)
    keep(ray.numbers, REACH, reach)
    keep(ray.words, BOUND, float_bits(reach) | np.int32(SLOT))


@inline
def _start_axis(ray, axis, o, d, slack, tiny):
    """Slabs of one axis: distances are plane * inverse + offset, the origin moved by `slack` so that the box widens."""
    inverse = finite_inverse(d, tiny)
    forward = inverse > np.float32(0)
    lean = select(forward, slack, -slack)
    keep(ray.numbers, INVERSE + axis, inverse)
    keep(ray.numbers, NEAR + axis, -(o + lean) * inverse)
    keep(ray.numbers, FAR + axis, -(o - lean) * inverse)
    keep(ray.words, ROW + axis, select(forward, np.int32(8 * axis), np.int32(24 + 8 * axis)))


@inline
def _start(ray, o, d, t):
    """Sets up a ray at the root."""
    far = np.float32(extent(o))
    slack = far * np.float32(PAD_ULPS * EPS)
    tiny = _most(np.float32(1e-18), far * np.float32(1e-37))  # no offset overflows
    _start_axis(ray, 0, np.float32(o.x), np.float32(d.x), slack, tiny)
    _start_axis(ray, 1, np.float32(o.y), np.float32(d.y), slack, tiny)
    _start_axis(ray, 2, np.float32(o.z), np.float32(d.z), slack, tiny)
    _set_reach(ray, t)
    keep(ray.words, PLACE, np.int32(0))
    keep(ray.words, HEIGHT, np.int32(0))
    keep8(ray.words, KEYS, splat(np.int32(0)))  # the bottom of the stack is always near enough, and leads to nothing
    keep(ray.words, PARENTS + 7, np.int32(NOTHINGS))


@inline
def _start_shear(ray, o, d):
    """The same shear as in `shapes.ray_frame`, as two factors and one scale, for axes turned so that the main one is last."""
    frame = ray_frame(d)
    zero = const(0.0, d.x)
    x, y = frame.z.x != zero, frame.z.y != zero
    keep(ray.words, TURN, select(x, np.int32(1), select(y, np.int32(2), np.int32(0))))
    keep(ray.words, TURN + 1, select(x, np.int32(2), select(y, np.int32(0), np.int32(1))))
    keep(ray.words, TURN + 2, select(x, np.int32(0), select(y, np.int32(1), np.int32(2))))
    keep(ray.reals, 0, select(x, o.y, select(y, o.z, o.x)))
    keep(ray.reals, 1, select(x, o.z, select(y, o.x, o.y)))
    keep(ray.reals, 2, select(x, o.x, select(y, o.y, o.z)))
    keep(ray.reals, 3, select(x, frame.x.x, select(y, frame.x.y, frame.x.z)))
    keep(ray.reals, 4, select(x, frame.y.x, select(y, frame.y.y, frame.y.z)))
    keep(ray.reals, 5, select(x, frame.z.x, select(y, frame.z.y, frame.z.z)))


@inline
def _nearest_waiting(ray, height):
    """Where the topmost entry of the stack lies that is nearer than the hit so far: eight are looked at with one comparison."""
    within = bits(fetch8(ray.words, KEYS + height) <= fetch(ray.words, BOUND))
    while within == 0:
        height -= 8
        within = bits(fetch8(ray.words, KEYS + height) <= fetch(ray.words, BOUND))
    return height + highest_bit(within)


@inline
def _take(ray, words, entry):
    """Takes an entry, and all above it, off the stack; returns the child, NOTHING at the bottom."""
    keep(ray.words, HEIGHT, np.int32(entry - 8))
    slot = fetch(ray.words, KEYS + entry) & np.int32(SLOT)
    return fetch(words, np.int64(fetch(ray.words, PARENTS + entry)) + np.int64(slot))


@inline
def _slab(planes, node, row, ray, axis, offset):
    return fma(
        fetch8(planes, node + row), splat(fetch(ray.numbers, INVERSE + axis)), splat(fetch(ray.numbers, offset + axis))
    )


@inline
def _enter_node(ray, tree):
    """Puts the children that the ray meets on its stack, the nearest on top, and takes the top; returns the child."""
    node, height = NODE_WORDS * np.int64(fetch(ray.words, PLACE)), np.int64(fetch(ray.words, HEIGHT))
    x, y, z = (
        np.int64(fetch(ray.words, ROW)), np.int64(fetch(ray.words, ROW + 1)), np.int64(fetch(ray.words, ROW + 2)),
    )  # fmt: skip
    near = _most(
        _most(_slab(tree.planes, node, x, ray, 0, NEAR), _slab(tree.planes, node, y, ray, 1, NEAR)),
        _most(_slab(tree.planes, node, z, ray, 2, NEAR), splat(np.float32(0))),
    )
    far = _least(
        _least(_slab(tree.planes, node, 24 - x, ray, 0, FAR), _slab(tree.planes, node, 40 - y, ray, 1, FAR)),
        _slab(tree.planes, node, 56 - z, ray, 2, FAR),
    )
    met = near <= _least(far * np.float32(WIDEN), splat(fetch(ray.numbers, REACH)))
    keys = (as_bits(near, np.int32) & np.int32(~SLOT)) | iota()
    waiting = _nearest_waiting(ray, height)  # before the stack is written: a load cannot wait for three stores
    keep8(ray.words, KEYS + 8 + height, descending(select(met, keys, splat(np.int32(-1)))))
    keep8(ray.words, PARENTS + 8 + height, splat(np.int32(node + CHILDREN)))
    pushed = bits_set(bits(met))
    return _take(ray, tree.words, select(pushed > 0, height + 7 + pushed, waiting))


@inline
def _corner(rows, corner, n, ray):
    """One sheared corner of each triangle of a leaf. Zeros and ones of the shear are left out, which changes no bit."""
    u = fetch8(rows, (corner + np.int64(fetch(ray.words, TURN))) * n) - fetch(ray.reals, 0)
    v = fetch8(rows, (corner + np.int64(fetch(ray.words, TURN + 1))) * n) - fetch(ray.reals, 1)
    w = fetch8(rows, (corner + np.int64(fetch(ray.words, TURN + 2))) * n) - fetch(ray.reals, 2)
    return Vec3(u + w * fetch(ray.reals, 3), v + w * fetch(ray.reals, 4), w * fetch(ray.reals, 5))


@inline
def _triangles(ray, base, n, real, row_bytes):
    """(distances, ranks) of the triangles of a leaf."""
    rows = pointer(base, real)
    t = triangle_distance(_corner(rows, 0, n, ray), _corner(rows, 3, n, ray), _corner(rows, 6, n, ray))
    return t, fetch8(pointer(base + row_bytes * n, np.int32), 0)


@inline
def _spheres(o, d, base, n, real):
    """(distances, ranks) of the spheres of a leaf."""
    rows = pointer(base, np.float64)
    center = Vec3(fetch8(rows, 0), fetch8(rows, n), fetch8(rows, 2 * n))
    t = sphere_distance(wide(o), wide(d), center, fetch8(rows, 3 * n))
    return convert(t, real), fetch8(pointer(base + 32 * n, np.int32), 0)


@inline
def _send(ray, child, lane, queues, waiting, tree, bytes_each):
    """Puts a lane into the queue where its next step is (written to both, counted in one, or none), and asks for the memory
    that the step will want: some 1.4 times the rays in a tree beyond the second cache."""
    keep(ray.words, PLACE, child)
    place = np.int64(child)
    wanted = select(place >= 0, tree.nodes + 4 * NODE_WORDS * place, tree.leaves + ((-1 - place) >> 5) * bytes_each)
    for line in range(STEP_LINES):
        prefetch(wanted + 64 * line)
    keep(queues.nodes, waiting.nodes, np.int32(lane))
    keep(queues.leaves, waiting.leaves, np.int32(lane))
    return Waiting(waiting.nodes + np.int64(child >= 0), waiting.leaves + np.int64((child < 0) & (child != NOTHING)))


@inline
def _take_nearest(lanes, ray, lane, t, ranks, valid, real):
    """Keeps the nearest of a leaf's valid hits, of equals the one of lowest rank, where it beats what the lane has."""
    t = select(valid, t, real(np.inf))
    nearest = lowest(t)
    rank = lowest(select(t == nearest, ranks, np.int32(2**31 - 1)))
    best, held = get(lanes, at.T, lane), get_int(lanes, at.RANK, lane)
    better = (nearest < best) | ((nearest == best) & (rank < held))
    nearest = select(better, nearest, best)
    put(lanes, at.T, lane, nearest)
    put_int(lanes, at.RANK, lane, select(better, held - held + rank, held))
    _set_reach(ray, nearest)


@inline
def _enter_leaf(lanes, lane, ray, tree, rule, real, row_bytes, bytes_each):
    """Tests the primitives of a leaf; returns the child to go to next."""
    code = -1 - np.int64(fetch(ray.words, PLACE))
    base, n = tree.leaves + (code >> 5) * bytes_each, code & 15
    held = iota() < np.int32(n)
    if rule.triangles and (not rule.spheres or (code & 16) == 0):
        t, ranks = _triangles(ray, base, n, real, row_bytes)
        valid = held & (ranks != np.int32(get_int(lanes, at.LEFT, lane)))
    else:
        o, d = at.get3(lanes, rule.origin, lane), at.get3(lanes, rule.direction, lane)
        t, ranks = _spheres(o, d, base, n, real)
        valid = held
    valid = valid & (t > real(0))
    hidden = False
    if rule.shadow:
        hidden = bits(valid & (t < get(lanes, at.SHADOW_T, lane))) != 0
        put_int(lanes, at.OCCLUDED, lane, 1 if hidden else 0)
    else:
        _take_nearest(lanes, ray, lane, t, ranks, valid, real)
    child = _take(ray, tree.words, _nearest_waiting(ray, np.int64(fetch(ray.words, HEIGHT))))
    return select(hidden, np.int32(NOTHING), child)


def _make(triangles: bool, spheres: bool, planes: bool, shadow: bool, real: Any) -> Any:
    size = np.dtype(real).itemsize
    row_bytes, bytes_each = 9 * size, stride(real)
    origin, direction, reach = (
        (at.SHADOW_ORIGIN, at.TO_LIGHT, at.SHADOW_T) if shadow else (at.ORIGIN, at.DIRECTION, at.T)
    )

    def stage(block, world):
        lanes, scratch = pointer(block, real), block + at.SCRATCH_FIRST * LANES * size
        rule = Rule(triangles, spheres, shadow, origin, direction)
        for lane in range(np.uint64(LANES)):
            put_int(lanes, at.OCCLUDED if shadow else at.RANK, lane, 0 if shadow else -1)
        if triangles or spheres:
            numbers, words = table(world, NODES, np.float32), table(world, NODES, np.int32)
            tree = Tree(count(world, NODES), numbers, words, count(world, LEAVES))
            queues = Queues(pointer(scratch + 4 * AT_NODES, np.int32), pointer(scratch + 4 * AT_LEAVES, np.int32))
            waiting = Waiting(np.int64(0), np.int64(0))
            for lane in range(np.uint64(LANES)):
                ray, t = _ray(scratch, lane, real), get(lanes, reach, lane)
                o, d = at.get3(lanes, origin, lane), at.get3(lanes, direction, lane)
                _start(ray, o, d, t)
                if triangles:
                    _start_shear(ray, o, d)
                keep(queues.nodes, waiting.nodes, np.int32(lane))
                waiting = Waiting(waiting.nodes + np.int64(t > real(0)), waiting.leaves)
            while waiting.nodes + waiting.leaves > 0:
                todo, waiting = waiting.nodes, Waiting(np.int64(0), waiting.leaves)
                for k in range(todo):
                    lane = np.uint64(fetch(queues.nodes, k))
                    ray = _ray(scratch, lane, real)
                    waiting = _send(ray, _enter_node(ray, tree), lane, queues, waiting, tree, bytes_each)
                todo, waiting = waiting.leaves, Waiting(waiting.nodes, np.int64(0))
                for k in range(todo):
                    lane = np.uint64(fetch(queues.leaves, k))
                    ray = _ray(scratch, lane, real)
                    child = _enter_leaf(lanes, lane, ray, tree, rule, real, row_bytes, bytes_each)
                    waiting = _send(ray, child, lane, queues, waiting, tree, bytes_each)
        if planes:
            if shadow:
                occluded_planes(lanes, world, real)
            else:
                closest_planes(lanes, world, real)

    return stage


@cache
def stages(triangles: bool, spheres: bool, planes: bool, real: Any) -> tuple[Any, Any]:
    """(closest, occluded) for a scene with these kinds of shapes."""
    shapes = (triangles, spheres, planes)
    return compile_stage(_make(*shapes, False, real)), compile_stage(_make(*shapes, True, real))

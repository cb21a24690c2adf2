"""The two stages that traverse the eight-wide tree, the sixteen rays of a batch interleaved.

In each round every ray that stands at a node takes a step, eight boxes in vector code without a branch, and then every ray
that stands at a leaf, up to eight primitives. A ray alone would wait at each step for memory and for the next branch; sixteen
steps that do not depend on one another overlap. This, not the width, is what pays (docs/how/performance_log.md).
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from engines.kernels.compile.jit import compile_stage, inline
from engines.kernels.compile.masks import positive_lanes
from engines.kernels.compile.memory import address_of, array_at, prefetch
from engines.kernels.compile.records import Table, array, table_view
from engines.kernels.compile.simd import as_bits, bits, convert, iota, load8, lowest, packed, splat, store8
from engines.kernels.compile.values import bits_set, float_bits, fma, highest_bit, lowest_bit, select
from engines.kernels.lane.shapes.sphere import sphere_distance
from engines.kernels.lane.shapes.triangle import ray_frame, triangle_distance
from engines.kernels.lane.vector import Vec3, extent, to_float64
from engines.kernels.layout import ACCELERATOR, LANES, RayBatch, ray_batch, scene_table
from engines.kernels.stages.instances import enter, leave
from engines.kernels.stages.linear import (
    analytic_distance,
    block_shadow,
    closest_planes,
    is_before,
    keep_nearer,
    may_meet,
    nothing,
    occluded_planes,
)
from engines.numba_cpu.accel.bvh_build import ANALYTIC, DEEPEST, INSTANCES, TRIANGLES
from engines.numba_cpu.accel.bvh_collapse import CHILDREN, NODE_WORDS, NOTHING
from engines.numba_cpu.accel.bvh_leaves import stride
from engines.numba_cpu.accel.primitives import PAD_ULPS, clear_hits, finite_inverse


class BvhTable(Table, first=ACCELERATOR):
    nodes = array(np.float32)  # see `bvh_collapse`
    leaves = array(np.uint8)  # see `bvh_leaves`
    roots = array(np.int32)  # of instances: the node where the tree of their group begins


bvh_table = table_view(BvhTable)

EPS = float(np.finfo(np.float32).eps)
WIDEN = 1 + 16 * EPS
"""Boxes are float32 in either precision. Far ends are taken this much farther, which covers every rounding in them."""

# A ray's record, in 32-bit words: 1 / direction, offsets of near and far planes, the widened distance of the nearest hit
# and its bits as a bound of keys; rows of near planes, the child to enter, height of the stack; axis order and reals for
# triangles. Then the stack: the keys of the children that wait, and these; of a shadow ray these alone.
INVERSE, NEAR, FAR, T_MAX, BOUND, ROW, CHILD, HEIGHT, AXES, REALS = 0, 3, 6, 9, 10, 11, 14, 15, 16, 20
KEYS = 32
# A node leaves seven entries at most, and each wide node is a level of the two-wide tree at least; eight are written at a time,
# and eight lie below the first.
STACK = 7 * (DEEPEST + 32) + 21
ENTRIES = KEYS + STACK
RECORD = -(-(ENTRIES + STACK) // 16) * 16
QUEUE = LANES + 1
AT_NODES, AT_LEAVES = LANES * RECORD, LANES * RECORD + QUEUE
# Where there are instances, a ray in one of them has another record and number, `LANES` more than its lane's, and another batch
# (`stages.instances`): what it leaves behind outside stays as it is.
QUEUES = 2 * LANES * RECORD
INNER = -(-(QUEUES + 2 * QUEUE) // 16) * 16
SCRATCH = INNER + RayBatch.bytes(np.float32) // 4
STEP_LINES = 5
"""Cache lines that a step prefetches: a node has four, a leaf of eight float32 triangles five (of larger ones the first)."""
SLOT = 7
"""The bits of a key that hold the child's number; the others are those of the distance to it, rounded down."""


class Ray(NamedTuple):
    """One lane's record."""

    words: Any
    numbers: Any
    reals: Any


class Rule(NamedTuple):
    """What the tree holds besides analytic shapes, and which query is answered."""

    triangles: bool
    spheres: bool
    instances: bool
    shadow: bool


class Tree(NamedTuple):
    """Nodes by address, as numbers and as words; leaves by address."""

    nodes: Any
    planes: Any
    words: Any
    leaves: Any


class Queues(NamedTuple):
    """Lanes that stand at a node, and at a leaf. Both are filled again while one is read, never ahead of it."""

    nodes: Any
    leaves: Any


class Waiting(NamedTuple):
    """The lengths of both queues."""

    nodes: int
    leaves: int


@inline
def _ray(scratch, lane, real):
    place = scratch + 4 * RECORD * np.int64(lane)
    return Ray(array_at(place, np.int32), array_at(place, np.float32), array_at(place + 4 * REALS, real))


@inline
def _least(a, b):
    return select(a < b, a, b)


@inline
def _most(a, b):
    return select(a > b, a, b)


@inline
def _set_t_max(ray, t):
    t_max = np.float32(t) * np.float32(WIDEN)
    ray.numbers[T_MAX] = t_max
    ray.words[BOUND] = float_bits(t_max) | np.int32(SLOT)


@inline
def _start_axis(ray, axis, o, d, error_bound, tiny):
    """Slabs of one axis: distances are plane * inverse + offset, the origin moved by `error_bound` so that the box widens."""
    inverse = finite_inverse(d, tiny)
    forward = inverse > np.float32(0)
    shift = select(forward, error_bound, -error_bound)
    ray.numbers[INVERSE + axis] = inverse
    ray.numbers[NEAR + axis] = -(o + shift) * inverse
    ray.numbers[FAR + axis] = -(o - shift) * inverse
    ray.words[ROW + axis] = select(forward, np.int32(8 * axis), np.int32(24 + 8 * axis))


@inline
def _start(ray, o, d, t, shadow):
    """Sets up a ray at the root. The bottom of its stack leads to nothing; of keys it is always near enough."""
    far = np.float32(extent(o))
    error_bound = far * np.float32(PAD_ULPS * EPS)
    tiny = _most(np.float32(1e-18), far * np.float32(1e-37))  # no offset overflows
    _start_axis(ray, 0, np.float32(o.x), np.float32(d.x), error_bound, tiny)
    _start_axis(ray, 1, np.float32(o.y), np.float32(d.y), error_bound, tiny)
    _start_axis(ray, 2, np.float32(o.z), np.float32(d.z), error_bound, tiny)
    _set_t_max(ray, t)
    ray.words[CHILD] = 0
    ray.words[HEIGHT] = 0
    if shadow:
        ray.words[KEYS] = NOTHING
    else:
        store8(ray.words, KEYS, splat(np.int32(0)))
        ray.words[ENTRIES + 7] = NOTHING


@inline
def _start_shear(ray, o, d):
    """The same shear as in `ray_frame`, as two factors and one scale, for axes in an order that puts the main one last."""
    frame = ray_frame(d)
    x, y = frame.z.x != 0.0, frame.z.y != 0.0
    ray.words[AXES] = select(x, np.int32(1), select(y, np.int32(2), np.int32(0)))
    ray.words[AXES + 1] = select(x, np.int32(2), select(y, np.int32(0), np.int32(1)))
    ray.words[AXES + 2] = select(x, np.int32(0), select(y, np.int32(1), np.int32(2)))
    ray.reals[0] = select(x, o.y, select(y, o.z, o.x))
    ray.reals[1] = select(x, o.z, select(y, o.x, o.y))
    ray.reals[2] = select(x, o.x, select(y, o.y, o.z))
    ray.reals[3] = select(x, frame.x.x, select(y, frame.x.y, frame.x.z))
    ray.reals[4] = select(x, frame.y.x, select(y, frame.y.y, frame.y.z))
    ray.reals[5] = select(x, frame.z.x, select(y, frame.z.y, frame.z.z))


@inline
def _topmost_within(ray, height):
    """Where the topmost entry of the stack lies that is nearer than the hit so far: eight are looked at with one comparison."""
    within = bits(load8(ray.words, KEYS + height) <= ray.words[BOUND])
    while within == 0:
        height -= 8
        within = bits(load8(ray.words, KEYS + height) <= ray.words[BOUND])
    return height + highest_bit(within)


@inline
def _take(ray, entry):
    """Takes an entry, and all above it, off the stack; returns the child, NOTHING at the bottom."""
    ray.words[HEIGHT] = entry - 8
    return ray.words[ENTRIES + entry]


@inline
def _take_last(ray):
    """Takes the last child off the stack of a shadow ray."""
    height = np.int64(ray.words[HEIGHT])
    ray.words[HEIGHT] = height - 1
    return ray.words[KEYS + height]


@inline
def _slab(planes, node, row, ray, axis, offset):
    return fma(load8(planes, node + row), splat(ray.numbers[INVERSE + axis]), splat(ray.numbers[offset + axis]))


@inline
def _meet_boxes(ray, tree, node):
    """(distances to the boxes of a node, which of them the ray meets)."""
    x, y, z = np.int64(ray.words[ROW]), np.int64(ray.words[ROW + 1]), np.int64(ray.words[ROW + 2])
    near = _most(
        _most(_slab(tree.planes, node, x, ray, 0, NEAR), _slab(tree.planes, node, y, ray, 1, NEAR)),
        _most(_slab(tree.planes, node, z, ray, 2, NEAR), splat(np.float32(0))),
    )
    far = _least(
        _least(_slab(tree.planes, node, 24 - x, ray, 0, FAR), _slab(tree.planes, node, 40 - y, ray, 1, FAR)),
        _slab(tree.planes, node, 56 - z, ray, 2, FAR),
    )
    return near, near <= _least(far * np.float32(WIDEN), splat(ray.numbers[T_MAX]))


@inline
def _enter_node(ray, tree):
    """Returns the nearest child that the ray meets, after it has put the others on the stack as they come; where it meets none,
    takes one off the stack."""
    node, height = NODE_WORDS * np.int64(ray.words[CHILD]), np.int64(ray.words[HEIGHT])
    near, met = _meet_boxes(ray, tree, node)
    keys = (as_bits(near, np.int32) & np.int32(~SLOT)) | iota()
    waiting = _topmost_within(ray, height)  # before the stack is written: a load cannot wait for three stores
    last = ray.words[ENTRIES + waiting]
    nearest = lowest(select(met, keys, np.int32(2**31 - 1)))
    others = met & (keys != nearest)
    store8(ray.words, KEYS + 8 + height, packed(keys, others))
    store8(ray.words, ENTRIES + 8 + height, packed(load8(tree.words, node + CHILDREN), others))
    n_met = bits_set(bits(met))
    ray.words[HEIGHT] = select(n_met > 0, height + n_met - 1, waiting - 8)
    first = tree.words[node + CHILDREN + np.int64(nearest & np.int32(SLOT))]
    return select(n_met > 0, first, last)


@inline
def _enter_node_in_any_order(ray, tree):
    """Puts the children that a shadow ray meets on its stack, and takes the last."""
    node, height = NODE_WORDS * np.int64(ray.words[CHILD]), np.int64(ray.words[HEIGHT])
    _, met = _meet_boxes(ray, tree, node)
    store8(ray.words, KEYS + 1 + height, packed(load8(tree.words, node + CHILDREN), met))
    ray.words[HEIGHT] = height + bits_set(bits(met))
    return _take_last(ray)


@inline
def _corner(rows, corner, n, ray):
    """One sheared corner of each triangle of a leaf. Zeros and ones of the shear are left out, which changes no bit."""
    u = load8(rows, (corner + np.int64(ray.words[AXES])) * n) - ray.reals[0]
    v = load8(rows, (corner + np.int64(ray.words[AXES + 1])) * n) - ray.reals[1]
    w = load8(rows, (corner + np.int64(ray.words[AXES + 2])) * n) - ray.reals[2]
    return Vec3(u + w * ray.reals[3], v + w * ray.reals[4], w * ray.reals[5])


@inline
def _triangles(ray, base, n, real, row_bytes):
    """(distances, ids) of the triangles of a leaf."""
    rows = array_at(base, real)
    t = triangle_distance(_corner(rows, 0, n, ray), _corner(rows, 3, n, ray), _corner(rows, 6, n, ray))
    return t, load8(array_at(base + row_bytes * n, np.int32), 0)


@inline
def _spheres(o, d, base, n, real):
    """(distances, ids) of the spheres of a leaf."""
    rows = array_at(base, np.float64)
    center = Vec3(load8(rows, 0), load8(rows, n), load8(rows, 2 * n))
    t = sphere_distance(to_float64(o), to_float64(d), center, load8(rows, 3 * n))
    return convert(t, real), load8(array_at(base + 32 * n, np.int32), 0)


@inline
def _send(ray, child, lane, queues, waiting, tree, bytes_each, instances):
    """Puts a lane into the queue where its next step is (written to both, counted in one, or none), and prefetches the memory
    that the step reads: some 1.4 times the rays in a tree beyond the second cache. What is at its end within an instance waits
    among the leaves."""
    ray.words[CHILD] = child
    place = np.int64(child)
    wanted = select(place >= 0, tree.nodes + 4 * NODE_WORDS * place, tree.leaves + ((-1 - place) >> 5) * bytes_each)
    for line in range(STEP_LINES):
        prefetch(wanted + 64 * line)
    queues.nodes[waiting.nodes] = lane
    queues.leaves[waiting.leaves] = lane
    stays = child != NOTHING
    if instances:
        stays = stays | (lane >= LANES)
    return Waiting(waiting.nodes + np.int64(child >= 0), waiting.leaves + np.int64((child < 0) & stays))


@inline
def _take_nearest(rays, scene, ray, lane, t, primitives, valid, instances, real):
    """Keeps the nearest of a leaf's valid hits, of equals the one of lowest id, where it beats what the lane has."""
    t = select(valid, t, real(np.inf))
    nearest = lowest(t)
    primitive = lowest(select(t == nearest, primitives, np.int32(2**31 - 1)))
    best, found = rays.t[lane], rays.primitive[lane]
    before = primitive < found
    if instances:
        before = is_before(scene, primitive, found, rays.instance[lane])
    better = (nearest < best) | ((nearest == best) & before)
    nearest = select(better, nearest, best)
    rays.t[lane] = nearest
    rays.primitive[lane] = select(better, np.int64(primitive), found)
    if instances:
        rays.instance[lane] = select(better, np.int64(-1), np.int64(rays.instance[lane]))
    _set_t_max(ray, nearest)


@inline
def _leave_leaf(ray, tree, shadow, hidden):
    """The child to go to after a leaf: none where a shadow ray is blocked."""
    if shadow:
        return select(hidden, np.int32(NOTHING), _take_last(ray))
    return _take(ray, _topmost_within(ray, np.int64(ray.words[HEIGHT])))


@inline
def _enter_leaf(rays, scene, lane, o, d, ray, tree, rule, real, row_bytes, bytes_each):
    """Tests the triangles or the spheres of a leaf; returns the child to go to next."""
    code = -1 - np.int64(ray.words[CHILD])
    base, n = tree.leaves + (code >> 5) * bytes_each, (code & 7) + 1
    held = iota() < np.int32(n)
    if rule.triangles and (not rule.spheres or ((code >> 3) & 3) == TRIANGLES):
        t, primitives = _triangles(ray, base, n, real, row_bytes)
        valid = held & may_meet(rays, lane, primitives)
    else:
        t, primitives = _spheres(o, d, base, n, real)
        valid = held
    valid = valid & (t > real(0))
    hidden = False
    if rule.shadow:
        hidden = bits(valid & (t < rays.shadow.t_max[lane])) != 0
        rays.shadow.occluded[lane] = hidden
    else:
        _take_nearest(rays, scene, ray, lane, t, primitives, valid, rule.instances, real)
    return _leave_leaf(ray, tree, rule.shadow, hidden)


@inline
def _enter_analytic_leaf(rays, scene, lane, o, d, ray, tree, rule, distance, real, bytes_each):
    """Tests the analytic shapes of a leaf one by one; returns the child to go to next."""
    code = -1 - np.int64(ray.words[CHILD])
    words, n = array_at(tree.leaves + (code >> 5) * bytes_each, np.int32), (code & 7) + 1
    hidden = False
    for k in range(n):
        primitive = words[k]
        t = real(distance(scene, words[n + k], to_float64(o), to_float64(d)))
        valid = (t < real(np.inf)) & may_meet(rays, lane, primitive)
        if rule.shadow:
            block_shadow(rays, lane, t, valid)
            hidden = rays.shadow.occluded[lane] != 0
        else:
            keep_nearer(rays, scene, lane, t, primitive, valid, rule.instances)
            _set_t_max(ray, rays.t[lane])
    return _leave_leaf(ray, tree, rule.shadow, hidden)


@inline
def _start_within(rays, inner, scene, own, lane, i, scratch, rule, real):
    """Sets up a lane's ray in instance i; returns the root of its group."""
    enter(rays, inner, scene, lane, i, rule.shadow, real)
    ray = _ray(scratch, lane + np.uint64(LANES), real)
    o, d, t = _query(inner, lane, rule.shadow)
    _start(ray, o, d, t, rule.shadow)
    if rule.triangles:
        _start_shear(ray, o, d)
    if not rule.shadow:
        inner.instance[lane] = -1
    return own.roots[i]


@inline
def _go_on_outside(rays, inner, scene, lane, ray, tree, rule, real):
    """Takes what a lane's ray has met in an instance; returns the child to go to next, of the record outside."""
    leave(rays, inner, scene, lane, rule.shadow, real)
    if rule.shadow:
        return _leave_leaf(ray, tree, True, rays.shadow.occluded[lane] != 0)
    _set_t_max(ray, rays.t[lane])
    return _leave_leaf(ray, tree, False, False)


@inline
def _query(rays, lane, shadow):
    """Origin, direction and end of a lane's ray, or of its shadow ray."""
    if shadow:
        return rays.shadow.origin[lane], rays.shadow.direction[lane], rays.shadow.t_max[lane]
    return rays.origin[lane], rays.direction[lane], rays.t[lane]


@inline
def _start_rays(scratch, origin, direction, t_max, triangles, queues, shadow, real):
    """Sets up the lanes that have a ray, at the root; returns the lengths of the queues."""
    lanes, waiting = positive_lanes(t_max), np.int64(0)
    while lanes != 0:
        lane = np.uint64(lowest_bit(lanes))
        lanes &= lanes - 1
        ray, o, d = _ray(scratch, lane, real), origin[lane], direction[lane]
        _start(ray, o, d, t_max[lane], shadow)
        if triangles:
            _start_shear(ray, o, d)
        queues.nodes[waiting] = lane
        waiting += 1
    return Waiting(waiting, np.int64(0))


@inline
def _enter_nodes(scratch, tree, queues, waiting, bytes_each, rule, real):
    """One step of every ray that stands at a node."""
    todo, waiting = waiting.nodes, Waiting(np.int64(0), waiting.leaves)
    for k in range(todo):
        lane = np.uint64(queues.nodes[k])
        ray = _ray(scratch, lane, real)
        child = _enter_node_in_any_order(ray, tree) if rule.shadow else _enter_node(ray, tree)
        waiting = _send(ray, child, lane, queues, waiting, tree, bytes_each, rule.instances)
    return waiting


def _make(
    triangles: bool, spheres: bool, planes: bool, analytic: tuple[int, ...], instances: bool, shadow: bool, real: Any
) -> Any:
    scratch_first, row_bytes, bytes_each = RayBatch.bytes(real), 9 * np.dtype(real).itemsize, stride(real)
    bounded, has_analytic, only_analytic = triangles or spheres, bool(analytic), not (triangles or spheres)
    distance = analytic_distance(analytic) if analytic else nothing
    at_nodes, at_leaves = (QUEUES, QUEUES + QUEUE) if instances else (AT_NODES, AT_LEAVES)
    inner_first = scratch_first + INNER * np.dtype(real).itemsize

    @inline
    def enter_leaf(rays, scene, lane, ray, tree, rule):
        o, d, _ = _query(rays, lane, shadow)
        if has_analytic and (only_analytic or (((-1 - ray.words[CHILD]) >> 3) & 3) == ANALYTIC):
            return _enter_analytic_leaf(rays, scene, lane, o, d, ray, tree, rule, distance, real, bytes_each)
        return _enter_leaf(rays, scene, lane, o, d, ray, tree, rule, real, row_bytes, bytes_each)

    @inline
    def enter_leaf_or_instance(batch, scene, own, number, scratch, tree, rule):
        """Returns the child to go to next, and the number of the record."""
        rays, inner = ray_batch(batch, real), ray_batch(batch + inner_first, real)
        within = number >= LANES
        lane = number - np.uint64(LANES) if within else number
        ray = _ray(scratch, number, real)
        child = ray.words[CHILD]
        if child == NOTHING:
            return _go_on_outside(rays, inner, scene, lane, _ray(scratch, lane, real), tree, rule, real), lane
        code = -1 - np.int64(child)
        if ((code >> 3) & 3) == INSTANCES:
            root = _start_within(rays, inner, scene, own, lane, code >> 5, scratch, rule, real)
            return root, lane + np.uint64(LANES)
        at = ray_batch(batch + inner_first if within else batch, real)
        return enter_leaf(at, scene, lane, ray, tree, rule), number

    def stage(batch, scene_address):
        rays, scene = ray_batch(batch, real), scene_table(scene_address, real)
        rule, scratch = Rule(triangles, spheres, instances, shadow), batch + scratch_first
        if shadow:
            origin, direction, t_max = rays.shadow.origin, rays.shadow.direction, rays.shadow.t_max
        else:
            origin, direction, t_max = rays.origin, rays.direction, rays.t
        clear_hits(rays, shadow, instances)
        if bounded or has_analytic:
            own = bvh_table(scene_address, real)
            nodes = address_of(own.nodes)
            tree = Tree(nodes, own.nodes, array_at(nodes, np.int32), address_of(own.leaves))
            queues = Queues(array_at(scratch + 4 * at_nodes, np.int32), array_at(scratch + 4 * at_leaves, np.int32))
            waiting = _start_rays(scratch, origin, direction, t_max, triangles, queues, shadow, real)
            while waiting.nodes + waiting.leaves > 0:
                waiting = _enter_nodes(scratch, tree, queues, waiting, bytes_each, rule, real)
                todo, waiting = waiting.leaves, Waiting(waiting.nodes, np.int64(0))
                for k in range(todo):
                    lane = np.uint64(queues.leaves[k])
                    if instances:
                        child, lane = enter_leaf_or_instance(batch, scene, own, lane, scratch, tree, rule)
                        ray = _ray(scratch, lane, real)
                    else:
                        ray = _ray(scratch, lane, real)
                        child = enter_leaf(rays, scene, lane, ray, tree, rule)
                    waiting = _send(ray, child, lane, queues, waiting, tree, bytes_each, instances)
        if planes and shadow:
            occluded_planes(rays, scene, real)
        elif planes:
            closest_planes(rays, scene, real, instances)

    return stage


@cache
def stages(
    triangles: bool, spheres: bool, planes: bool, analytic: tuple[int, ...], instances: bool, real: Any
) -> tuple[Any, Any]:
    """(closest, occluded) for a scene with these kinds of shapes."""
    shapes = (triangles, spheres, planes, analytic, instances)
    return compile_stage(_make(*shapes, False, real)), compile_stage(_make(*shapes, True, real))

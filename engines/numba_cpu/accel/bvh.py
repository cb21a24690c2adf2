"""The accelerator `bvh`: how the eight-wide tree comes about, and what it takes."""

from __future__ import annotations

import time
from collections.abc import Mapping
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.errors import Unsupported
from engines.kernels.features import SceneFeatures
from engines.kernels.flatten import FlatScene
from engines.kernels.layout import SceneTable
from engines.kernels.rows import InstanceRow
from engines.numba_cpu.accel import bvh_walk
from engines.numba_cpu.accel.bvh_build import BINS, LEAF, OVERLAP, SWEPT, Firsts, Growth, grow_tree
from engines.numba_cpu.accel.bvh_collapse import CHILDREN, MOST_PRIMITIVES, NODE_WORDS, NOTHING, WIDTH, Choices, weigh, widen
from engines.numba_cpu.accel.bvh_leaves import SPILL, empty_leaves, fill_leaves, stride
from engines.numba_cpu.accel.primitives import fill_records, padding, primitive_counts, rounding


class Quality(NamedTuple):
    """How a tree is grown: bins of boxes; of up to how many parts every plane is looked at; how many are not divided further
    before the choice of the nodes that stay; how many parts beside whole triangles there may be, as a share of these."""

    bins: int
    swept: int
    fewest: int
    extra: float


QUALITIES = {"fast": Quality(16, 0, LEAF, 0.0), "high": Quality(BINS, SWEPT, 2, 0.3)}
DEFAULT_QUALITY = "high"
SMALL = 1000
"""Up to so many primitives of a part are built by one thread: another takes longer to wake."""
FARTHEST = 1e29
"""Metres up to which slabs in float32 neither overflow nor lose a box."""


class Accelerator:
    """Eight-wide nodes, and copies of the primitives in the order of the leaves, of a cut one in each of its leaves. The tree
    does not depend on the threads."""

    name = "bvh"
    precision = None
    scratch = bvh_walk.SCRATCH
    instances = True

    def __init__(self, options: Mapping[str, Any]) -> None:
        self._quality = QUALITIES[options.get("quality", DEFAULT_QUALITY)]
        self.build_seconds = 0.0
        self.bytes = 0

    def build(self, flat: FlatScene, threads: int) -> None:
        start = time.perf_counter()
        n = sum(primitive_counts(flat))
        if n > MOST_PRIMITIVES:
            raise Unsupported(f"bvh: {n} primitives, of at most {MOST_PRIMITIVES}")
        if n > 0:
            with ThreadPoolExecutor(threads) as pool:
                parts = [self._part(flat.part(number), threads, pool) for number in range(len(flat.begins) - 1)]
            nodes, leaves, roots = _joined(parts, flat.real)
            if flat.features.instances:
                group = flat.arrays[SceneTable.instances][:, InstanceRow.fields["group"].first].astype(np.int64)
                flat.bind(bvh_walk.BvhTable.roots, roots[1:][group])
            flat.bind(bvh_walk.BvhTable.nodes, nodes)
            flat.bind(bvh_walk.BvhTable.leaves, leaves)
            self.bytes = nodes.nbytes + leaves.nbytes
        self.build_seconds = time.perf_counter() - start

    def _part(self, part: FlatScene, threads: int, pool: Executor) -> tuple[Any, Any]:
        """Nodes and leaves of a part of the scene."""
        extent = float(np.abs(part.bounds - part.center).max())
        if not extent < FARTHEST:
            raise Unsupported(f"bvh: the scene reaches {extent:.3g} m, of at most {FARTHEST:g}; take accelerator none")
        unit = 2.0 ** float(np.frexp(extent)[1])  # no area overflows
        small = sum(primitive_counts(part)) <= SMALL
        return _build(part, unit, self._quality, 1 if small else threads, _Here() if small else pool)

    def stages(self, features: SceneFeatures, real: Any) -> tuple[Any, Any]:
        kinds = features.triangles, features.spheres, features.planes, features.analytic, features.instances
        return bvh_walk.stages(*kinds, real)


class _Here(Executor):
    """Runs at once, in this thread, what is submitted."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        done: Future[Any] = Future()
        done.set_result(fn(*args, **kwargs))
        return done


class Grown(NamedTuple):
    """The two-wide tree, boxes in multiples of `unit`; and the places that `grow_tree` returns."""

    unit: float
    order: Any
    boxes: Any
    links: Any
    filled: list[tuple[int, int]]
    above: list[int]


def _build(flat: FlatScene, unit: float, quality: Quality, threads: int, pool: Executor) -> tuple[Any, Any]:
    """Wide nodes, and leaves. What a step no longer needs is freed before the next allocates: 250 bytes a triangle."""
    grown = _grown(flat, unit, quality, threads, pool)
    nodes, leaves = _widened(grown, _first_of_kinds(flat), pool)
    order = grown.order
    del grown
    data = empty_leaves(int(leaves[:, 1].sum()), flat.real)
    _share(pool, threads, len(leaves), lambda first, last: fill_leaves(leaves[first:last], order, flat, data))
    return nodes, data


def _joined(parts: list[tuple[Any, Any]], real: Any) -> tuple[Any, Any, NDArray[np.int32]]:
    """Nodes and leaves of all parts, and the root of each."""
    roots, places = [0], [0]
    for nodes, leaves in parts:
        roots.append(roots[-1] + len(nodes))
        places.append(places[-1] + (len(leaves) - SPILL) // stride(real))
    if len(parts) == 1:
        return *parts[0], np.array(roots, np.int32)
    for (nodes, _), root, place in zip(parts[1:], roots[1:], places[1:], strict=False):
        children = nodes.view(np.int32)[:, CHILDREN : CHILDREN + WIDTH]
        inner, leaf = children >= 0, (children < 0) & (children != NOTHING)
        children[inner] += root
        children[leaf] -= 32 * place
    data = [leaves[:-SPILL] for _, leaves in parts[:-1]]
    return np.concatenate([nodes for nodes, _ in parts]), np.concatenate([*data, parts[-1][1]]), np.array(roots, np.int32)


def _first_of_kinds(flat: FlatScene) -> Firsts:
    triangles, spheres, analytic, _ = primitive_counts(flat)
    return Firsts(triangles, triangles + spheres, triangles + spheres + analytic)


def _grown(flat: FlatScene, unit: float, quality: Quality, threads: int, pool: Executor) -> Grown:
    counts = primitive_counts(flat)
    n = sum(counts)
    places, extent = min(n + int(quality.extra * counts[0]), MOST_PRIMITIVES), np.ptp(flat.bounds, axis=0) / unit
    growth = Growth(
        np.empty((2, places, 8), np.float32),
        np.empty((2, places), np.int32),
        np.empty((2 * places, 8), np.float32),
        np.empty((2 * places, 3), np.int32),
        flat.arrays[SceneTable.vertices],
        flat.arrays[SceneTable.triangles],
        _first_of_kinds(flat),
        quality.bins,
        quality.swept,
        quality.fewest,
        unit,
        padding(flat),
        rounding(flat),
        OVERLAP * float(extent[0] * extent[1] + extent[1] * extent[2] + extent[2] * extent[0]),
    )
    _share(pool, threads, n, lambda first, last: fill_records(flat, unit, first, last, growth.records[0], growth.order[0]))
    filled, above = grow_tree(growth, n, pool)
    return Grown(unit, growth.order[0].copy(), growth.boxes, growth.links, filled, above)


def _widened(grown: Grown, firsts: Firsts, pool: Executor) -> tuple[Any, Any]:
    """The eight-wide tree: nodes, and which primitives are in its leaves."""
    unit, order, boxes, links = grown.unit, grown.order, grown.boxes, grown.links
    choices = Choices(np.empty((len(boxes), 7), np.float32), np.empty((len(boxes), 7), np.int8))
    list(pool.map(lambda part: weigh(boxes, links, choices, *part, order, firsts), grown.filled))
    for node in grown.above:
        weigh(boxes, links, choices, node, node + 1, order, firsts)
    tree = boxes, unit, links, choices.ways, order, firsts
    counts = widen(*tree, False, np.empty((0, NODE_WORDS), np.float32), np.empty((0, 4), np.int32))
    nodes, leaves = np.zeros((counts[0], NODE_WORDS), np.float32), np.empty((counts[1], 4), np.int32)
    widen(*tree, True, nodes, leaves)
    return nodes, leaves


def _share(pool: Executor, threads: int, n: int, work: Any) -> None:
    """Runs work(first, last) over n things, a stretch a thread."""
    edges = [n * k // threads for k in range(threads + 1)]
    list(pool.map(work, edges[:-1], edges[1:]))

"""The accelerator `bvh`: how the eight-wide tree comes about, and what it takes."""

from __future__ import annotations

import time
from concurrent.futures import Executor, ThreadPoolExecutor
from typing import Any

import numpy as np

from engines.errors import Unsupported
from engines.kernels.world import TRIANGLES, Needs, World
from engines.numba_cpu.accel import bvh_walk
from engines.numba_cpu.accel.bvh_build import LEAF, Growth, grow_tree
from engines.numba_cpu.accel.bvh_collapse import MOST_PRIMITIVES, NODE_WORDS, Choices, weigh, widen
from engines.numba_cpu.accel.bvh_leaves import empty_leaves, fill_leaves
from engines.numba_cpu.accel.primitives import fill_records, primitive_count

SMALL, FEWEST = 2**14, 2
"""Trees of up to SMALL primitives are grown down to FEWEST a leaf, larger ones to LEAF, which costs 0.1 % of the expected time
of a ray and saves a third of the build."""


class Accelerator:
    """Eight-wide nodes, and the primitives copied in the order of the leaves. The tree does not depend on the threads."""

    name = "bvh"
    precision = None
    scratch = bvh_walk.SCRATCH

    def __init__(self, options: Any) -> None:
        self.build_seconds = 0.0
        self._bytes = 0

    def build(self, world: World, threads: int) -> None:
        start = time.perf_counter()
        n = primitive_count(world)
        if n > MOST_PRIMITIVES:
            raise Unsupported(f"bvh: {n} primitives, of at most {MOST_PRIMITIVES}")
        if n > 0:
            with ThreadPoolExecutor(threads) as pool:
                nodes, leaves = _build(world, n, threads, pool)
            world.bind(bvh_walk.NODES, nodes)
            world.bind(bvh_walk.LEAVES, leaves)
            self._bytes = nodes.nbytes + leaves.nbytes
        self.build_seconds = time.perf_counter() - start

    @property
    def bytes(self) -> int:
        return self._bytes

    def stages(self, needs: Needs, real: Any) -> tuple[Any, Any]:
        return bvh_walk.stages(needs.triangles, needs.spheres, needs.planes, real)


def _build(world: World, n: int, threads: int, pool: Executor) -> tuple[Any, Any]:
    """Wide nodes, and leaves. What a step no longer needs is gone before the next asks for memory: 200 bytes a triangle."""
    order, boxes, links, filled, above = _grown(world, n, threads, pool)
    nodes, leaves = _widened(order, boxes, links, filled, above, len(world.arrays[TRIANGLES]), pool)
    del boxes, links
    data = empty_leaves(n, world.real)
    _share(pool, threads, len(leaves), lambda first, last: fill_leaves(leaves[first:last], order, world, data))
    return nodes, data


def _grown(world: World, n: int, threads: int, pool: Executor) -> tuple[Any, ...]:
    """The two-wide tree: order, boxes, links; and what `grow_tree` says of its places."""
    growth = Growth(
        np.empty((2, n, 8), np.float32), np.empty((2, n), np.int32),
        np.empty((2 * n, 8), np.float32), np.empty((2 * n, 3), np.int32),
        len(world.arrays[TRIANGLES]), FEWEST if n <= SMALL else LEAF,
    )  # fmt: skip
    _share(pool, threads, n, lambda first, last: fill_records(world, first, last, growth.records[0], growth.order[0]))
    filled, above = grow_tree(growth, pool)
    return growth.order[0].copy(), growth.boxes, growth.links, filled, above


def _widened(
    order: Any, boxes: Any, links: Any, filled: list[tuple[int, int]], above: list[int], triangles: int, pool: Executor
) -> tuple[Any, Any]:
    """The eight-wide tree: nodes, and which primitives are in its leaves."""
    choices = Choices(np.empty((len(boxes), 7), np.float32), np.empty((len(boxes), 7), np.int8))
    list(pool.map(lambda part: weigh(boxes, links, choices, *part, order, triangles), filled))
    for node in above:
        weigh(boxes, links, choices, node, node + 1, order, triangles)
    nodes, leaves = np.empty((0, NODE_WORDS), np.float32), np.empty((0, 3), np.int32)
    counts = widen(boxes, links, choices.ways, order, triangles, False, nodes, leaves)
    nodes, leaves = np.empty((counts[0], NODE_WORDS), np.float32), np.empty((counts[1], 3), np.int32)
    widen(boxes, links, choices.ways, order, triangles, True, nodes, leaves)
    return nodes, leaves


def _share(pool: Executor, threads: int, n: int, work: Any) -> None:
    """Runs work(first, last) over n things, a stretch a thread."""
    edges = [n * k // threads for k in range(threads + 1)]
    list(pool.map(work, edges[:-1], edges[1:]))

"""clusters.py: an accelerator for the engine numba: triangles in groups of neighbours, each group in a box."""

import time
from functools import cache

import numpy as np

from engines.kernels.compile.jit import compile_stage, inline
from engines.kernels.compile.records import Row, Table, array, rows, scalar, table_view, vector
from engines.kernels.compile.values import select
from engines.kernels.layout import ACCELERATOR, LANES, SceneTable, ray_batch, scene_table
from engines.kernels.stages.linear import (
    block_shadow,
    closest_planes,
    closest_spheres,
    keep_nearer,
    make_analytic_test,
    occluded_planes,
    occluded_spheres,
)
from engines.numba_cpu.accel.primitives import CornersRow, boxes, clear_hits, corners, distance_to_triangle, make_ray


class BoxRow(Row):
    low = vector()
    high = vector()


class ClusterTable(Table, first=ACCELERATOR):
    """What our stages read besides the scene."""

    n_groups = scalar()
    starts = array(np.int64)  # of each group, its first triangle; it ends where the next group starts
    boxes = rows(BoxRow)
    corners = rows(CornersRow)  # in our order, as are the ids
    primitives = array(np.int32)


cluster_table = table_view(ClusterTable)


def morton(points):
    """(n,) places of points (n, 3) along a curve that visits neighbours together."""
    low, extent = points.min(axis=0), np.ptp(points, axis=0)
    cells = ((points - low) / np.where(extent > 0, extent, 1) * 1023).astype(np.int64)
    return sum(((cells[:, axis] >> bit) & 1) << (3 * bit + axis) for bit in range(10) for axis in range(3))


class Accelerator:
    name, precision, scratch = "clusters", None, 0  # traces in the settings' precision; needs no scratch memory

    def __init__(self, size):
        self.size, self.build_seconds, self.bytes = size, 0.0, 0

    def build(self, flat, threads):
        """Binds what the stages read to the flattened scene."""
        start = time.perf_counter()
        ids = flat.arrays[SceneTable.triangle_primitives]
        own = boxes(flat)[: len(ids)]  # (n, 6), padded by some ulps of the scene's size; triangles first
        order = np.argsort(morton((own[:, :3] + own[:, 3:]) / 2), kind="stable") if len(ids) else np.zeros(0, int)
        first = np.arange(0, len(ids), self.size)
        low = np.minimum.reduceat(own[order, :3], first) if len(ids) else own[:, :3]
        high = np.maximum.reduceat(own[order, 3:], first) if len(ids) else own[:, 3:]
        arrays = {
            ClusterTable.starts: np.append(first, len(ids)),
            ClusterTable.boxes: np.hstack([low, high]),
            ClusterTable.corners: corners(flat)[order],
            ClusterTable.primitives: ids[order],
        }
        flat.bind(ClusterTable.n_groups, len(first))
        for field, values in arrays.items():
            flat.bind(field, values)
        self.bytes = sum(values.nbytes for values in arrays.values())
        self.build_seconds = time.perf_counter() - start

    def stages(self, features, real):
        """(closest, occluded) for a scene with these kinds of shapes, in this precision."""
        return stages(features.triangles, features.spheres, features.planes, features.analytic, real)


@inline
def between(low, high, origin, inverse, bound, near, far):
    """The part of [near, far] that lies between two planes across one axis."""
    a, b = (low - bound - origin) * inverse, (high + bound - origin) * inverse
    enter, leave = select(a < b, a, b), select(a < b, b, a)
    return select(enter > near, enter, near), select(leave < far, leave, far)


@inline
def in_box(ray, box, t_max, real):
    o, inverse, bound = ray.o, ray.inverse, ray.error_bound
    near, far = between(box.low.x, box.high.x, o.x, inverse.x, bound, real(0), t_max)
    near, far = between(box.low.y, box.high.y, o.y, inverse.y, bound, near, far)
    near, far = between(box.low.z, box.high.z, o.z, inverse.z, bound, near, far)
    return near <= far


@cache
def stages(triangles, spheres, planes, analytic, real):
    kinds = triangles, spheres, planes, analytic, real
    return compile_stage(make(*kinds, False)), compile_stage(make(*kinds, True))


def make(triangles, spheres, planes, analytic, real, shadow):
    eps = float(np.finfo(real).eps)
    test_analytic = make_analytic_test(analytic, shadow)

    def stage(batch, scene_address):
        rays, scene, own = ray_batch(batch, real), scene_table(scene_address, real), cluster_table(scene_address, real)
        if shadow:
            origin, direction, t_max = rays.shadow.origin, rays.shadow.direction, rays.shadow.t_max
        else:
            origin, direction, t_max = rays.origin, rays.direction, rays.t
        clear_hits(rays, shadow, False)
        if triangles:
            for g in range(own.n_groups):
                meets = np.int64(0)
                for lane in range(np.uint64(LANES)):
                    ray = make_ray(origin[lane], direction[lane], eps, real)
                    meets += select(in_box(ray, own.boxes[g], t_max[lane], real), np.int64(1), np.int64(0))
                if meets == 0:
                    continue
                for i in range(own.starts[g], own.starts[g + 1]):
                    primitive = own.primitives[i]
                    for lane in range(np.uint64(LANES)):
                        t = distance_to_triangle(make_ray(origin[lane], direction[lane], eps, real), own.corners, i)
                        valid = (t > real(0)) & (primitive != rays.origin_primitive[lane])
                        if shadow:
                            block_shadow(rays, lane, t, valid)
                        else:
                            keep_nearer(rays, scene, lane, t, primitive, valid, False)
        if spheres:
            if shadow:
                occluded_spheres(rays, scene, 0, scene.n_spheres, real)
            else:
                closest_spheres(rays, scene, 0, scene.n_spheres, real)
        if planes:
            occluded_planes(rays, scene, real) if shadow else closest_planes(rays, scene, real, False)
        test_analytic(rays, scene, 0, scene.n_analytic, real)

    return stage


class Clusters:
    """`accelerator: clusters:groups_of_eight` in a config, `accelerator=groups_of_eight` in Python."""

    name = "clusters"

    def __init__(self, size):
        self.options = {"size": size}

    def make(self, options):
        return Accelerator(options["size"])


groups_of_eight = Clusters(8)

"""Boxes on the screen for rays from the eye, the plain list for all others: what N. Dahlquist's ray tracer of 2012 does,
with boxes that are right.

A box bounds a primitive's projection from the eye onto the plane at distance 1. A batch of sixteen camera rays is tested
against the primitives whose boxes meet the batch's own; a batch that holds any secondary ray goes through the whole list. For
few primitives: the boxes are a list, too. Analytic shapes have no boxes: all are tested.
"""

from __future__ import annotations

import time
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.kernels.compile.jit import compile_stage, inline
from engines.kernels.compile.records import Row, Table, real, rows, scalar, table_view, vector
from engines.kernels.compile.values import call_stage, select
from engines.kernels.features import SceneFeatures
from engines.kernels.flatten import FlatScene
from engines.kernels.lane.shapes.sphere import sphere_distance
from engines.kernels.lane.vector import Vec3, dot, to_float64
from engines.kernels.layout import LANES, SceneTable, ray_batch, scene_table
from engines.kernels.rows import CameraRow
from engines.kernels.stages.linear import closest_planes, keep_nearer, make_analytic_test, may_meet
from engines.numba_cpu.accel import none
from engines.numba_cpu.accel.primitives import CornersRow, corners, distance_to_triangle, make_ray


class EyeRow(Row):
    """Where camera rays start, and the camera's axes, unit."""

    position = vector()
    right = vector()
    up = vector()
    forward = vector()


class BoxRow(Row):
    low_x = real()
    high_x = real()
    low_y = real()
    high_y = real()


class AreaTable(Table, first=none.ListTable.slots):
    list_stage = scalar()  # address of the stage that tests every primitive
    n_boxes = scalar()  # -1 where there is no eye
    boxes = rows(BoxRow)  # of triangles, then of spheres
    eye = rows(EyeRow)
    corners = rows(CornersRow)


area_table = table_view(AreaTable)

STEEPEST = 1e3
"""Tangent of the angle from the axis beyond which projections are not bounded: such rays and primitives use the list."""
PAD_ULPS = 256.0


class Accelerator:
    """The list of `none`, and a box for each triangle and sphere as the eye sees it."""

    name = "area_hierarchy"
    precision = None
    scratch = none.SCRATCH

    def __init__(self, options: Any) -> None:
        self.build_seconds = 0.0
        self._list = none.Accelerator(options)
        self.bytes = 0

    def build(self, flat: FlatScene, threads: int) -> None:
        start = time.perf_counter()
        self._flat = flat
        self._list.build(flat, threads)
        flat.bind(AreaTable.corners, corners(flat))
        self.look(flat, has_eye=False)
        self.build_seconds = time.perf_counter() - start

    def look(self, flat: FlatScene, has_eye: bool) -> None:
        """Computes the boxes anew for the scene's camera. Without an eye (parallel rays, plugins) all rays use the list."""
        n = len(flat.arrays[SceneTable.triangles]) + len(flat.arrays[SceneTable.spheres]) if has_eye else 0
        eye = np.zeros((4, 3), flat.real)
        boxes = np.zeros((n, 4), flat.real)
        if has_eye:
            camera = flat.arrays[SceneTable.camera].ravel()
            position, *axes = (
                camera[field.first : field.first + 3]
                for field in (CameraRow.eye, CameraRow.right, CameraRow.up, CameraRow.forward)
            )
            eye[0] = position
            eye[1:] = [axis / np.linalg.norm(axis) for axis in axes]
            boxes = _boxes(flat, eye.astype(np.float64)).astype(flat.real)
        flat.bind(AreaTable.eye, eye)
        flat.bind(AreaTable.boxes, boxes)
        flat.bind(AreaTable.n_boxes, n if has_eye else -1)
        self.bytes = boxes.nbytes + flat.arrays[AreaTable.corners].nbytes

    def stages(self, features: SceneFeatures, real: Any) -> tuple[Any, Any]:
        closest, occluded = self._list.stages(features, real)
        self._flat.bind(AreaTable.list_stage, closest.address)
        return stage(features.triangles, features.spheres, features.planes, features.analytic, real), occluded


def _boxes(flat: FlatScene, eye: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 4) lowest and highest x, lowest and highest y on the plane at distance 1: of triangles, then of spheres. They are
    wider than the projections by what rounding may do to a ray, and infinite where a primitive is not well ahead of the eye."""
    points = (flat.arrays[AreaTable.corners].reshape(-1, 3).astype(np.float64) - eye[0]) @ eye[1:].T
    with np.errstate(divide="ignore", invalid="ignore"):
        seen = points[:, :2] / points[:, 2:]
        seen[~(np.abs(points[:, :2]).max(axis=1, initial=0) < STEEPEST * points[:, 2])] = np.nan
    triangles = seen.reshape(-1, 3, 2)
    low, high = [triangles.min(axis=1)], [triangles.max(axis=1)]
    spheres = flat.arrays[SceneTable.spheres]
    centers, radii = (spheres[:, :3] - eye[0]) @ eye[1:].T, spheres[:, 3]
    sides = [_tangents(centers[:, axis], centers[:, 2], radii) for axis in (0, 1)]
    low.append(np.stack([side[0] for side in sides], axis=1))
    high.append(np.stack([side[1] for side in sides], axis=1))
    lowest, highest = np.concatenate(low), np.concatenate(high)
    unbounded = ~np.isfinite(lowest + highest).all(axis=1)
    lowest[unbounded], highest[unbounded] = -np.inf, np.inf
    error_bound = PAD_ULPS * np.finfo(flat.real).eps
    lowest = lowest - error_bound * (1 + np.abs(lowest)) ** 2
    highest = highest + error_bound * (1 + np.abs(highest)) ** 2
    return np.stack([lowest[:, 0], highest[:, 0], lowest[:, 1], highest[:, 1]], axis=1)


def _tangents(
    across: NDArray[np.float64], ahead: NDArray[np.float64], radius: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(lowest, highest) tangent of the angles at which circles are seen; NaN where they are not wholly ahead."""
    distance = np.hypot(across, ahead)
    with np.errstate(divide="ignore", invalid="ignore"):
        middle, half = np.arctan2(across, ahead), np.arcsin(radius / distance)
        limit = np.arctan(STEEPEST)
        good = (middle - half > -limit) & (middle + half < limit)
        return np.where(good, np.tan(middle - half), np.nan), np.where(good, np.tan(middle + half), np.nan)


@inline
def _project(rays, lane, eye, real):
    """(whether it comes from the eye, whether there is one, x, y) of a lane's ray on the plane at distance 1."""
    origin, direction = rays.origin[lane], rays.direction[lane]
    position, right, up, forward = eye[0].position, eye[0].right, eye[0].up, eye[0].forward
    ahead = dot(direction, forward)
    from_eye = (origin.x == position.x) & (origin.y == position.y) & (origin.z == position.z) & (ahead > real(1 / STEEPEST))
    alive = rays.t[lane] > real(0)
    inverse = real(1) / select(from_eye, ahead, real(1))
    return from_eye, alive, dot(direction, right) * inverse, dot(direction, up) * inverse


def _make(triangles: bool, spheres: bool, planes: bool, analytic: tuple[int, ...], real: Any) -> Any:
    eps = float(np.finfo(real).eps)
    test_analytic = make_analytic_test(analytic, False)

    def closest(batch, scene_address):
        rays, scene, own = ray_batch(batch, real), scene_table(scene_address, real), area_table(scene_address, real)
        n, eye, boxes = own.n_boxes, own.eye, own.boxes
        secondary_rays = np.int64(0)
        low_x, high_x, low_y, high_y = real(np.inf), real(-np.inf), real(np.inf), real(-np.inf)
        for lane in range(np.uint64(LANES)):
            from_eye, alive, x, y = _project(rays, lane, eye, real)
            rays.shear_x[lane] = Vec3(x, y, select(alive, real(1), real(-1)))
            secondary_rays += select(alive & (~from_eye), np.int64(1), np.int64(0))
        if n < 0 or secondary_rays > 0:
            call_stage(own.list_stage, batch, scene_address)
            return
        for lane in range(np.uint64(LANES)):
            rays.primitive[lane] = -1
            seen = rays.shear_x[lane]
            if seen.z > real(0):
                low_x, high_x = min(low_x, seen.x), max(high_x, seen.x)
                low_y, high_y = min(low_y, seen.y), max(high_y, seen.y)
        for i in range(n):
            if not (boxes[i].low_x <= high_x and boxes[i].high_x >= low_x):
                continue
            if not (boxes[i].low_y <= high_y and boxes[i].high_y >= low_y):
                continue
            if triangles and (not spheres or i < scene.n_triangles):
                primitive, points = scene.triangle_primitives[i], own.corners
                for lane in range(np.uint64(LANES)):
                    ray = make_ray(rays.origin[lane], rays.direction[lane], eps, real)
                    t = distance_to_triangle(ray, points, i)
                    keep_nearer(rays, scene, lane, t, primitive, (t > real(0)) & may_meet(rays, lane, primitive), False)
            if spheres and (not triangles or i >= scene.n_triangles):
                k = i - scene.n_triangles
                center, radius, primitive = scene.spheres[k].center, scene.spheres[k].radius, scene.sphere_primitives[k]
                for lane in range(np.uint64(LANES)):
                    o, d = to_float64(rays.origin[lane]), to_float64(rays.direction[lane])
                    t = real(sphere_distance(o, d, center, radius))
                    keep_nearer(rays, scene, lane, t, primitive, t < real(np.inf), False)
        if planes:
            closest_planes(rays, scene, real, False)
        test_analytic(rays, scene, 0, scene.n_analytic, real)

    return closest


@cache
def stage(triangles: bool, spheres: bool, planes: bool, analytic: tuple[int, ...], real: Any) -> Any:
    """Closest hits in a scene with these kinds of shapes."""
    return compile_stage(_make(triangles, spheres, planes, analytic, real))

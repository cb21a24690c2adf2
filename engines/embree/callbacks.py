"""What Embree calls back: bounds and hits of the shapes in `geometries`, and a filter of its own hits.

Callbacks read a lane's ray from the batch, not from Embree's packet, where it has been rounded to float32 and scaled.
"""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from engines.embree.geometries import INSTANCES, SPHERES, TRIANGLES, bounds_and_distance
from engines.embree.packet import (
    BATCH_OF_CONTEXT,
    CANDIDATE,
    CANDIDATE_INSTANCE,
    GEOM_ID,
    ID,
    INST_ID,
    NG_X,
    ORIGIN_FACE,
    ORIGIN_INSTANCE,
    PRIM_ID,
    T_FAR,
    embree_table,
    path_rays,
    shadow_rays,
)
from engines.kernels.compile.jit import compile_callback, inline
from engines.kernels.compile.memory import array_at
from engines.kernels.compile.records import Table, array, scalar, table_view
from engines.kernels.compile.values import select
from engines.kernels.layout import RayBatch, ray_batch, scene_table
from engines.kernels.stages.instances import local_ray

_PRIM_ID_OF_HIT, _INST_ID_OF_HIT = PRIM_ID - NG_X, INST_ID - NG_X
"""Where a hit alone holds them: RTCHitN is the end of RTCRayHitN."""


class BoundsArguments(Table):
    """RTCBoundsFunctionArguments."""

    scene = scalar()  # user data: address of the scene's table
    primitive = scalar()  # primID in the lower half, timeStep above
    box = array(np.float32)  # lowest coordinates 3, padding, highest 3, padding


class IntersectArguments(Table):
    """RTCIntersectFunctionNArguments, RTCOccludedFunctionNArguments."""

    valid = array(np.int32)
    scene = scalar()
    primitive = scalar()  # primID in the lower half
    context = array(np.int64)
    packet = scalar()
    rays_and_geometry = scalar()  # N in the lower half, geomID above


class FilterArguments(Table):
    """RTCFilterFunctionNArguments."""

    valid = array(np.int32)
    user_data = scalar()
    context = array(np.int64)
    rays = array(np.int32)
    hits = array(np.int32)
    n_rays = scalar()  # in the lower half


bounds_arguments = table_view(BoundsArguments)
intersect_arguments = table_view(IntersectArguments)
filter_arguments = table_view(FilterArguments)


@inline
def _lower_half(word):
    return word & 0xFFFFFFFF


def _make_bounds(bounds_of: Any, real: Any) -> Any:
    def bounds(address):
        arguments = bounds_arguments(address, real)
        low, high = bounds_of(scene_table(arguments.scene, real), _lower_half(arguments.primitive))
        scaling, box = embree_table(arguments.scene, real).scaling[0], arguments.box
        scale, padding = scaling.scale, scaling.padding
        box[0] = np.float32((low.x - padding) * scale)
        box[1] = np.float32((low.y - padding) * scale)
        box[2] = np.float32((low.z - padding) * scale)
        box[4] = np.float32((high.x + padding) * scale)
        box[5] = np.float32((high.y + padding) * scale)
        box[6] = np.float32((high.z + padding) * scale)

    return bounds


@inline
def _id_of(scene, geometry, index):
    """The id of a primitive outside of groups."""
    if geometry == TRIANGLES:
        return scene.triangle_primitives[index]
    return scene.sphere_primitives[index] if geometry == SPHERES else scene.analytic_primitives[index]


@inline
def _is_before(scene, geometry, primitive, instance, other_geometry, other, other_instance):
    """Whether a hit is of a shape before that of another: of the same kind and of lower index, or of an instance before that of
    the other. `scene` is the whole one; instances are geometries, -1 outside of groups."""
    if instance == other_instance:
        return geometry == other_geometry and primitive < other
    if instance < 0:
        return _id_of(scene, geometry, primitive) < np.int64(scene.instances[np.int64(other_instance) - INSTANCES].behind)
    if other_instance < 0:
        return _id_of(scene, other_geometry, other) >= np.int64(scene.instances[np.int64(instance) - INSTANCES].behind)
    return instance < other_instance


@inline
def _wins_tie(scene, numbers, words, n, i, t, geometry, primitive, instance, instances):
    """Whether a hit is as near as the one found, and of a shape before it: Embree calls back in any order."""
    if t != numbers[T_FAR * n + i] or words[GEOM_ID * n + i] < 0:
        return False
    found_geometry, found = words[GEOM_ID * n + i], np.int64(words[PRIM_ID * n + i])
    if not instances:
        return found_geometry == geometry and primitive < found
    return _is_before(scene, geometry, primitive, instance, found_geometry, found, words[INST_ID * n + i])


def _make_query(distance_of: Any, any_hit: bool, instances: bool, real: Any) -> Any:
    rays_of = shadow_rays if any_hit else path_rays

    def query(address):
        arguments = intersect_arguments(address, real)
        valid, primitive = arguments.valid, _lower_half(arguments.primitive)
        scene = scene_table(arguments.scene, real)
        batch = ray_batch(arguments.context[BATCH_OF_CONTEXT], real)
        rays = rays_of(batch)
        numbers, words = array_at(arguments.packet, np.float32), array_at(arguments.packet, np.int32)
        n, geometry = _lower_half(arguments.rays_and_geometry), np.int32(arguments.rays_and_geometry >> 32)
        embree = embree_table(arguments.scene, real)
        whole, scale, instance = scene_table(embree.whole, real), embree.scaling[0].of_rays, np.int32(-1)
        if instances:
            instance = np.int32(_lower_half(arguments.context[0]))
        for i in range(n):
            if valid[i] == 0:
                continue
            lane = np.uint64(words[ID * n + i])
            o, d, origin_primitive, stretch = rays.origin[lane], rays.direction[lane], batch.origin_primitive[lane], 1.0
            if instances and instance >= 0:
                number = np.int64(instance) - INSTANCES
                o, d, stretch = local_ray(scene.instances[number], o, d, real)
                origin_primitive = select(batch.origin_instance[lane] == number, origin_primitive, -1)
            t = distance_of(scene, primitive, o, d, origin_primitive)
            if instances:
                t = t / stretch
            if t > 0.0 and t < np.float64(rays.t_max[lane]):
                near = np.float32(t * scale)
                if any_hit:
                    numbers[T_FAR * n + i] = np.float32(-np.inf)
                elif near < numbers[T_FAR * n + i] or _wins_tie(
                    whole, numbers, words, n, i, near, geometry, primitive, instance, instances
                ):
                    numbers[T_FAR * n + i] = near
                    words[PRIM_ID * n + i] = np.int32(primitive)
                    words[GEOM_ID * n + i] = geometry
                    if instances:
                        words[INST_ID * n + i] = instance

    return query


def _make_filter(instances: bool, real: Any) -> Any:
    scratch = RayBatch.bytes(real)

    def filter_hits(address):
        """Drops the face that a ray has just left, and notes the candidate of each lane."""
        arguments = filter_arguments(address, real)
        valid, rays, hits = arguments.valid, arguments.rays, arguments.hits
        record = array_at(arguments.context[BATCH_OF_CONTEXT] + scratch, np.int32)
        n = _lower_half(arguments.n_rays)
        for i in range(n):
            if valid[i] == 0:
                continue
            lane, face = np.int64(rays[ID * n + i]), hits[_PRIM_ID_OF_HIT * n + i]
            same, instance = face == record[ORIGIN_FACE + lane], np.int32(-1)
            if instances:
                instance = hits[_INST_ID_OF_HIT * n + i]
                same = same and instance == record[ORIGIN_INSTANCE + lane]
            if same:
                valid[i] = np.int32(0)
            else:
                record[CANDIDATE + lane] = face
                if instances:
                    record[CANDIDATE_INSTANCE + lane] = instance

    return filter_hits


class Callbacks(NamedTuple):
    """Machine code; `.address` is the C function for Embree, valid as long as the object lives."""

    bounds: Any
    intersect: Any
    occluded: Any


@cache
def callbacks(geometry: int, analytic: tuple[int, ...], instances: bool, real: Any) -> Callbacks:
    """Of a geometry (`geometries.bounds_and_distance`), in a batch of `real` numbers; user data is the address of the
    scene's table, or of that of a group."""
    bounds, distance = bounds_and_distance(geometry, analytic)
    queries = (_make_query(distance, any_hit, instances, real) for any_hit in (False, True))
    return Callbacks(*map(compile_callback, (_make_bounds(bounds, real), *queries)))


@cache
def hit_filter(instances: bool, real: Any) -> Any:
    """The filter of Embree's own triangles."""
    return compile_callback(_make_filter(instances, real))

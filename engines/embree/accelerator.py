"""Embree as an intersector of ray batches: packets of rays from compiled code, planes tested apart.

Embree works in float32. With `refine` every candidate hit on a triangle is solved anew in float64, from the batch's ray
and the scene's vertices. Where the face does not confirm it (or is the one that the ray has just left) the lane is
queried once more, in a second RTCScene of the same shapes whose triangles are solved in float64 by callback: Embree
then only walks the tree, so what the false hit had hidden is found, and nothing slips between faces. That tree is
queried rarely, and built coarsely. With `watertight` that way is the only one: no ray leaks at a vertex, at about half
the speed.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.embree.callbacks import callbacks, hit_filter
from engines.embree.geometries import ANALYTIC, INSTANCES, SPHERES, TRIANGLES, exact_distance
from engines.embree.library import Device, address
from engines.embree.packet import (
    CANDIDATE,
    CANDIDATE_INSTANCE,
    GEOM_ID,
    INST_ID,
    ORIGIN_FACE,
    ORIGIN_INSTANCE,
    PRIM_ID,
    SCRATCH_WORDS,
    T_FAR,
    VALID,
    EmbreeTable,
    Prefetching,
    are_coherent,
    embree_table,
    first_word,
    packet_width,
    path_rays,
    query_closest,
    query_occluded,
    shadow_rays,
    write_rays,
)
from engines.kernels.compile.jit import compile_stage, inline
from engines.kernels.compile.memory import array_at
from engines.kernels.compile.records import LANES
from engines.kernels.compile.values import lowest_bit, select
from engines.kernels.features import SceneFeatures
from engines.kernels.flatten.scene import FlatScene
from engines.kernels.flatten.shapes import TRIANGLE
from engines.kernels.layout import RayBatch, SceneTable, ray_batch, scene_table
from engines.kernels.rows import InstanceRow
from engines.kernels.stages.instances import local_ray
from engines.kernels.stages.linear import closest_planes, occluded_planes

WIDENING = 1 + 2.0**-22
"""With `refine` or `watertight` Embree looks this much beyond t_max, so that float64 decides what lies before it."""
FEW, MANY = 4096, 65536
"""Up to FEW primitives a tree is built by one thread, as another takes long to wake; up to MANY all rays go in
packets."""
BOX_PADDING = 1e-6
"""Boxes of what is solved in float64 are padded by this share of the scene: so far a ray may be off in float32. In a group it
may be off by as much of the scene, in the group's coordinates."""


class Accelerator:
    """Embree's own tree; `quality` and `robust` are its build quality and scene flag."""

    name = "embree"
    precision = np.float32
    scratch = SCRATCH_WORDS
    instances = True

    def __init__(self, options: Any, refine: bool) -> None:
        self._quality, self._robust, self._exact = options["quality"], options["robust"], options["watertight"]
        self._refine = refine and not self._exact
        self.build_seconds = 0.0
        self.bytes = 0

    def build(self, flat: FlatScene, threads: int) -> None:
        start = time.perf_counter()
        rays = packet_width()
        flat.bind(EmbreeTable.intersect, address(f"rtcIntersect{rays}"))
        flat.bind(EmbreeTable.intersect_one, address("rtcIntersect1"))
        flat.bind(EmbreeTable.occluded, address(f"rtcOccluded{rays}"))
        parts = [flat, *(flat.part(number) for number in range(1, len(flat.begins) - 1))]
        scaling = _scaling(flat)
        for part, error in zip(parts, [0.0, *_errors(flat, len(parts) - 1)], strict=True):
            own = _scaling(part)
            own[2] = max(own[2], error)
            part.bind(EmbreeTable.scaling, np.append(own, scaling[0]))
            part.bind(EmbreeTable.whole, flat.address)
        flat.owned += parts[1:]
        flat.bind(EmbreeTable.begins, np.array([begin[1:4] for begin in flat.begins[1:-1]], np.int32))
        primitives = _primitives(flat)
        flat.bind(EmbreeTable.one_by_one, int(primitives > MANY))
        device = Device(threads if primitives > FEW else 1)
        flat.owned.append(device)
        if flat.features.triangles and not self._exact:
            flat.bind(EmbreeTable.filter, hit_filter(flat.features.instances, flat.real).address)
        flat.bind(EmbreeTable.tree, self._tree(device, parts, self._exact, self._quality, self._robust))
        if flat.features.triangles and self._refine:
            flat.bind(EmbreeTable.exact_tree, self._tree(device, parts, True, "low", True))
        self.bytes = device.bytes
        self.build_seconds = time.perf_counter() - start

    def _tree(self, device: Device, parts: list[FlatScene], exact: bool, quality: str, robust: bool) -> int:
        """The handle of an RTCScene of what is outside of groups, the first of the parts, and of the instances; of triangles
        that are solved in float64 with `exact`."""
        flat = parts[0].part(0)
        groups = [
            device.scene(_geometries(device, part, exact), part.address, quality, robust, _primitives(part) > FEW)
            for part in parts[1:]
        ]
        shown = {INSTANCES + i: device.instance(groups[group], matrix) for i, (group, matrix) in enumerate(_matrices(parts))}
        return device.scene(_geometries(device, flat, exact) | shown, parts[0].address, quality, robust)

    def stages(self, features: SceneFeatures, real: Any) -> tuple[Any, Any]:
        return stages(Variant(*_shapes(features), features.instances, self._refine, self._exact, packet_width()), real)


def _primitives(part: FlatScene) -> int:
    return sum(len(part.arrays[field]) for field in (SceneTable.triangles, SceneTable.spheres, SceneTable.analytic))


def _user_geometry(device: Device, flat: FlatScene, geometry: int, count: int) -> int:
    analytic = flat.features.analytic if geometry == ANALYTIC else ()
    made = callbacks(geometry, analytic, flat.features.instances, flat.real)
    return device.by_callback(count, *(code.address for code in made))


def _geometries(device: Device, part: FlatScene, exact: bool) -> dict[int, int]:
    """Those of a part of the scene, by number; with `exact` triangles are solved in float64."""
    faces = part.arrays[SceneTable.triangles]
    counts = {SPHERES: len(part.arrays[SceneTable.spheres]), ANALYTIC: len(part.arrays[SceneTable.analytic])}
    made = {number: _user_geometry(device, part, number, count) for number, count in counts.items() if count}
    if len(faces) and exact:
        made[TRIANGLES] = _user_geometry(device, part, TRIANGLES, len(faces))
    elif len(faces):
        vertices, indices = part.arrays[SceneTable.vertices], faces
        if part.features.instances:  # vertices are those of the whole scene
            vertices, indices = vertices[faces.min() : faces.max() + 1], faces - faces.min()
        made[TRIANGLES] = device.triangles(vertices * part.real(part.arrays[EmbreeTable.scaling][0]), indices)
    return made


def _errors(flat: FlatScene, groups: int) -> NDArray[np.float64]:
    """(groups,) by how much rays may be off in each, in its own unit: the numbers that make up a place are as large as the
    scene and where the group's origin comes to lie."""
    errors = np.zeros(groups)
    if groups:
        rows, fields = flat.arrays[SceneTable.instances], InstanceRow.fields
        inverse = rows[:, fields["in_x"].first : fields["in_x"].first + 9].reshape(-1, 3, 3)
        group, moved = rows[:, fields["group"].first].astype(np.int64), rows[:, fields["moved"].first :][:, :3]
        size = _size(flat) + np.abs(moved).max(axis=1)
        np.maximum.at(errors, group, size * np.abs(inverse).sum(axis=2).max(axis=1) * BOX_PADDING)
    return errors


def _matrices(parts: list[FlatScene]) -> Iterator[tuple[int, NDArray[np.float64]]]:
    """The group of each instance, and its matrix (3, 4) between scaled coordinates."""
    scales = [part.arrays[EmbreeTable.scaling][0] for part in parts]
    for row in parts[0].arrays[SceneTable.instances]:
        placed = {name: row[field.first : field.first + field.n] for name, field in InstanceRow.fields.items()}
        group = int(placed["group"][0])
        linear = np.array([placed["out_x"], placed["out_y"], placed["out_z"]]) * (scales[0] / scales[group + 1])
        yield group, np.column_stack([linear, placed["moved"] * scales[0]])


def _size(flat: FlatScene) -> float:
    """The largest coordinate."""
    return float(np.abs(flat.bounds - flat.center).max(initial=0.0, where=np.isfinite(flat.bounds)))


def _scaling(flat: FlatScene) -> NDArray[np.float64]:
    """(3,): see `ScaleRow`."""
    size = _size(flat)
    scale = 2.0 ** -np.clip(np.round(np.log2(size)), -100, 100) if size > 0 else 1.0
    return np.array([scale, 1.0 / scale, size * BOX_PADDING])


class Variant(NamedTuple):
    """What a stage is compiled for: the kinds of shapes, whether hits on triangles are confirmed in float64, or found there
    alone, and rays a packet."""

    triangles: bool
    spheres: bool
    planes: bool
    analytic: bool
    instances: bool
    refine: bool
    exact: bool
    width: int

    @property
    def widening(self) -> np.float32:
        """By how much Embree looks beyond t_max."""
        return np.float32(WIDENING if self.refine or self.exact else 1)


def _shapes(features: SceneFeatures) -> tuple[bool, bool, bool, bool]:
    return features.triangles, features.spheres, features.planes, bool(features.analytic)


@inline
def _begin(scene, embree, instance, kind):
    """Where the triangles, spheres or analytic shapes of what an instance (-1 for none) shows begin."""
    if instance < 0:
        return np.int64(0)
    return np.int64(embree.begins[3 * np.int64(scene.instances[instance].group) + kind])


@inline
def _instance(memory, word, variant):
    """The instance whose geometry's number lies there, -1 for none."""
    if not variant.instances:
        return np.int64(-1)
    geometry = np.int64(array_at(memory, np.int32)[word])
    return geometry - INSTANCES if geometry >= 0 else np.int64(-1)


@inline
def _note_origin_faces(rays, scene, embree, memory, variant):
    """Writes down the triangle that each lane's ray has left, and its instance, for the filter; returns if there is any."""
    words, some = array_at(memory, np.int32), False
    for k in range(LANES):
        lane, face = np.uint64(k), np.int32(-1)
        primitive = np.int64(rays.origin_primitive[lane])
        traced = primitive >= 0 and words[first_word(lane, variant.width) + VALID * variant.width] != 0
        if traced and scene.primitives[primitive].shape == TRIANGLE:
            face, some = scene.primitives[primitive].index, True
            if variant.instances:
                instance = np.int64(rays.origin_instance[lane])
                face = np.int32(face - _begin(scene, embree, instance, TRIANGLES))
                words[ORIGIN_INSTANCE + k] = np.int32(instance + INSTANCES if instance >= 0 else -1)
        words[ORIGIN_FACE + k] = face
    return some


@inline
def _select_lanes(rays_of, rays, scene, embree, memory, lanes, widening, variant, real):
    """Leaves only the lanes of the word `lanes` valid, for a second query: where triangles are solved in float64, or,
    without `refine`, past the face that the ray has left."""
    numbers, words, t_max = array_at(memory, np.float32), array_at(memory, np.int32), rays_of(rays).t_max
    scale = real(embree.scaling[0].scale)
    for k in range(LANES):
        lane, again = np.uint64(k), (lanes >> np.int64(k)) & 1 != 0
        i = first_word(lane, variant.width)
        words[i + VALID * variant.width] = np.int32(-1 if again else 0)
        if again:
            words[i + GEOM_ID * variant.width] = np.int32(-1)
            words[i + INST_ID * variant.width] = np.int32(-1)
            numbers[i + T_FAR * variant.width] = np.float32(t_max[lane] * scale) * widening
    if not variant.refine:
        _note_origin_faces(rays, scene, embree, memory, variant)


@inline
def _candidate(scene, embree, memory, lane, variant):
    """(face, primitive, instance) of Embree's hit of a lane; -1 where it is no triangle, or nothing."""
    words, i = array_at(memory, np.int32), first_word(lane, variant.width)
    geometry, index = words[i + GEOM_ID * variant.width], np.int64(words[i + PRIM_ID * variant.width])
    face, primitive, instance = np.int64(-1), np.int32(-1), _instance(memory, i + INST_ID * variant.width, variant)
    if variant.instances and geometry >= 0:
        index += _begin(scene, embree, instance, np.int64(geometry))
    if variant.triangles:
        hit = geometry == TRIANGLES
        face = select(hit, index, face)
        if variant.spheres or variant.planes or variant.analytic:
            primitive = select(hit, scene.triangle_primitives[index if hit else np.int64(0)], primitive)
        else:  # where there are triangles alone, their numbers are their ids: one cache miss less
            primitive = select(hit, np.int32(index), primitive)
    if variant.spheres:
        hit = geometry == SPHERES
        primitive = select(hit, scene.sphere_primitives[index if hit else np.int64(0)], primitive)
    if variant.analytic:
        hit = geometry == ANALYTIC
        primitive = select(hit, scene.analytic_primitives[index if hit else np.int64(0)], primitive)
    return face, primitive, instance


@inline
def _candidate_distance(embree, memory, lane, variant):
    numbers, unscale = array_at(memory, np.float32), embree.scaling[0].inverse
    return np.float64(numbers[first_word(lane, variant.width) + T_FAR * variant.width]) * unscale


@inline
def _confirmed(rays, batch, scene, lane, face, primitive, instance, variant, real):
    """(whether the lane did hit its candidate face, distance)."""
    confirmed, t = primitive != batch.origin_primitive[lane], 0.0
    if variant.instances and instance >= 0:
        confirmed = confirmed | (instance != batch.origin_instance[lane])
    if variant.refine:
        o, d, stretch = rays.origin[lane], rays.direction[lane], 1.0
        if variant.instances and instance >= 0:
            o, d, stretch = local_ray(scene.instances[instance], o, d, real)
        t = exact_distance(o, d, scene, face if face >= 0 else np.int64(0))
        if variant.instances:
            t = t / stretch
        confirmed = confirmed & (t > 0.0) & (t < np.float64(rays.t_max[lane]))
    return confirmed, t


@inline
def _store_hit(rays, lane, primitive, instance, t, variant, real):
    rays.primitive[lane] = primitive
    if variant.instances:
        rays.instance[lane] = instance
    rays.t[lane] = select(primitive >= 0, real(t), rays.t[lane])


@inline
def _store_hits(rays, scene, embree, memory, variant, real):
    """The hits of all lanes, as far as they are confirmed; returns a word of the lanes where they are not."""
    words = array_at(memory, np.int32)
    for lane in range(np.uint64(LANES)):
        face, primitive, instance = _candidate(scene, embree, memory, lane, variant)
        t, unconfirmed = _candidate_distance(embree, memory, lane, variant), False
        if variant.triangles:
            confirmed, exact = _confirmed(path_rays(rays), rays, scene, lane, face, primitive, instance, variant, real)
            unconfirmed = (face >= 0) & (not confirmed)
            if variant.refine:
                t = select(face >= 0, exact, t)
        _store_hit(rays, lane, select(unconfirmed, np.int32(-1), primitive), instance, t, variant, real)
        words[CANDIDATE + np.int64(lane)] = np.int32(1 if unconfirmed else 0)
    return _marked_lanes(words)


@inline
def _marked_lanes(words):
    """The lanes that are marked, as bits."""
    bits = np.int64(0)
    for lane in range(LANES):
        bits |= np.int64(1 if words[CANDIDATE + lane] != 0 else 0) << np.int64(lane)
    return bits


def _make_closest(variant: Variant, real: Any) -> Any:
    scratch, refine, width, widening = RayBatch.bytes(real), variant.refine, variant.width, variant.widening
    traced, planes = variant.triangles or variant.spheres or variant.analytic, variant.planes
    no_prefetching = Prefetching(0, False)
    vertex_bytes = 0 if variant.instances else 3 * np.dtype(real).itemsize
    prefetching = Prefetching(vertex_bytes, variant.spheres or variant.planes or variant.analytic)

    def closest(batch, scene_address):
        rays, scene, embree = (ray_batch(batch, real), scene_table(scene_address, real), embree_table(scene_address, real))
        if traced:
            memory = batch + scratch
            write_rays(path_rays(rays), embree, memory, width, widening, real)
            coherent = are_coherent(memory, width)
            query_closest(scene, embree, embree.tree, memory, batch, width, False, coherent, prefetching)
            unconfirmed = _store_hits(rays, scene, embree, memory, variant, real)
            if unconfirmed != 0:
                _select_lanes(path_rays, rays, scene, embree, memory, unconfirmed, widening, variant, real)
                tree = embree.exact_tree if refine else embree.tree
                query_closest(scene, embree, tree, memory, batch, width, not refine, False, no_prefetching)
                while unconfirmed != 0:
                    lane = np.uint64(lowest_bit(unconfirmed))
                    unconfirmed &= unconfirmed - 1
                    _, primitive, instance = _candidate(scene, embree, memory, lane, variant)
                    t = _candidate_distance(embree, memory, lane, variant)
                    _store_hit(rays, lane, primitive, instance, t, variant, real)
        else:
            for lane in range(np.uint64(LANES)):
                rays.primitive[lane] = -1
        if planes:
            closest_planes(rays, scene, real, variant.instances)

    return closest


@inline
def _store_shadows(rays, scene, embree, memory, variant, real):
    """Whether each lane's light is hidden; returns a word of the lanes where the face that hides it is not
    confirmed."""
    numbers, words = array_at(memory, np.float32), array_at(memory, np.int32)
    for lane in range(np.uint64(LANES)):
        # Embree marks an occluded ray by tfar = -inf; a lane without a ray kept its own, not above 0
        hidden = numbers[first_word(lane, variant.width) + T_FAR * variant.width] == np.float32(-np.inf)
        unconfirmed = False
        if variant.refine and variant.triangles:
            face, instance = np.int64(words[CANDIDATE + np.int64(lane)]), np.int64(-1)
            if variant.instances and face >= 0:  # else what was written there is of another batch
                instance = _instance(memory, CANDIDATE_INSTANCE + np.int64(lane), variant)
                face += _begin(scene, embree, instance, TRIANGLES)
            confirmed, _ = _confirmed(shadow_rays(rays), rays, scene, lane, face, np.int32(-2), instance, variant, real)
            unconfirmed = hidden & (face >= 0) & (not confirmed)
        rays.shadow.occluded[lane] = 1 if hidden else 0
        words[CANDIDATE + np.int64(lane)] = np.int32(1 if unconfirmed else 0)
    return _marked_lanes(words)


def _make_occluded(variant: Variant, real: Any) -> Any:
    scratch, refine, width, widening = RayBatch.bytes(real), variant.refine, variant.width, variant.widening
    traced, planes = variant.triangles or variant.spheres or variant.analytic, variant.planes
    filters = variant.triangles and not variant.exact

    def occluded(batch, scene_address):
        rays, scene, embree = (ray_batch(batch, real), scene_table(scene_address, real), embree_table(scene_address, real))
        if traced:
            memory = batch + scratch
            write_rays(shadow_rays(rays), embree, memory, width, widening, real)
            # the filter is called once an occluded ray, so only where there is something to leave out, or to write down
            filtered = filters and (_note_origin_faces(rays, scene, embree, memory, variant) or refine)
            query_occluded(embree, embree.tree, memory, batch, width, filtered)
            unconfirmed = _store_shadows(rays, scene, embree, memory, variant, real)
            if refine and unconfirmed != 0:
                _select_lanes(shadow_rays, rays, scene, embree, memory, unconfirmed, widening, variant, real)
                query_occluded(embree, embree.exact_tree, memory, batch, width, False)
                numbers = array_at(memory, np.float32)
                while unconfirmed != 0:
                    lane = np.uint64(lowest_bit(unconfirmed))
                    unconfirmed &= unconfirmed - 1
                    t_far = numbers[first_word(lane, width) + T_FAR * width]
                    rays.shadow.occluded[lane] = t_far == np.float32(-np.inf)
        else:
            for lane in range(np.uint64(LANES)):
                rays.shadow.occluded[lane] = False
        if planes:
            occluded_planes(rays, scene, real)

    return occluded


@cache
def stages(variant: Variant, real: Any) -> tuple[Any, Any]:
    """(closest, occluded) for these kinds of shapes."""
    return compile_stage(_make_closest(variant, real)), compile_stage(_make_occluded(variant, real))

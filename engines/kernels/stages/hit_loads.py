"""From the scene into the batch: what the surface stage computes from, of the primitive that each lane hit."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.records import address_of, array_at
from engines.kernels.compile.row_loads import AT_ONCE, row_loads
from engines.kernels.compile.values import keep_scalar, pick
from engines.kernels.features import SceneFeatures
from engines.kernels.flatten import lights, materials
from engines.kernels.flatten.shapes import PLANE, SPHERE, TRIANGLE
from engines.kernels.layout import LANES, SHAPE_PARAMETERS, MaterialRow, PlaneRow, RayBatch, SphereRow
from engines.kernels.stages import light_hierarchy
from engines.kernels.stages.prefetching import NEAR_TRIANGLES, make_prefetch


@inline
def keep_corners(rays, lane, scene, face):
    """Notes the corners of a triangle, by its index among the triangles, for `load_vertices`."""
    row = scene.triangles[face]
    rays.corner0[lane] = row.a
    rays.corner1[lane] = row.b
    rays.corner2[lane] = row.c


def _number(field: str) -> int:
    return RayBatch.fields[field].first


def _vector_loads(field: str) -> list[Any]:
    """Three functions (rays, address of vectors) that copy those of the corners into `field` with 0, 1 or 2 at its end."""
    firsts = [_number(f"{field}{k}") for k in range(3)]
    return [
        row_loads(_number(f"corner{k}"), 3, (0, 1, 2), (first, first + 1, first + 2)) for k, first in enumerate(firsts)
    ]


_vertex0, _vertex1, _vertex2 = _vector_loads("vertex")
_normal0, _normal1, _normal2 = _vector_loads("vertex_normal")


@inline
def load_vertices(rays, scene):
    """The corners of each lane's triangle."""
    _vertex0(rays, address_of(scene.vertices))
    _vertex1(rays, address_of(scene.vertices))
    _vertex2(rays, address_of(scene.vertices))


@inline
def _load_normals(rays, scene):
    _normal0(rays, address_of(scene.vertex_normals))
    _normal1(rays, address_of(scene.vertex_normals))
    _normal2(rays, address_of(scene.vertex_normals))


@cache
def _make_load_materials(columns: tuple[int, ...], targets: tuple[int, ...]) -> Any:
    """The function (rays, address of the materials) that copies these columns of each lane's row to these numbers of a lane."""

    @inline
    def nothing(rays, address):
        pass

    if not columns:
        return nothing
    n = next((k for k in range(1, len(columns)) if k == AT_ONCE or columns[k] != columns[0] + k), len(columns))
    loads = row_loads(_number("material"), MaterialRow.size, columns[:n], targets[:n])
    rest = _make_load_materials(columns[n:], targets[n:])

    @inline
    def load(rays, address):
        loads(rays, address)
        rest(rays, address)

    return load


def _material_columns(features: SceneFeatures) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """(columns of a material's row that the scene's BSDF models and its emission need, numbers of a lane to which they
    go)."""
    first, own = MaterialRow.fields["bsdf"].first, _number("bsdf")
    wanted = sorted({column for kind in features.bsdfs for column in materials.MODELS[kind].columns(features)})
    pairs = [(first + column, own + column) for column in wanted]
    if features.emission:
        emission, two_sided = MaterialRow.fields["emission"].first, MaterialRow.fields["two_sided"].first
        pairs += [(emission + k, _number("emission") + k) for k in range(3)] + [(two_sided, _number("two_sided"))]
    columns = sorted(pairs)
    return tuple(column for column, _ in columns), tuple(target for _, target in columns)


@cache
def _make_find_formula(features: SceneFeatures) -> Any:
    """The function (scene, kind, index) -> (address of the row of a shape with a formula, how many numbers it has); some row of
    the scene's for a triangle."""
    spheres, planes, analytic = features.spheres, features.planes, len(features.analytic) > 0
    plane_size, sphere_size = PlaneRow.size, SphereRow.size

    @inline
    def find(scene, kind, index):
        start, size, zero = np.int64(0), np.int64(0), np.int64(0)
        if analytic:
            start, size = address_of(scene.analytic[pick(kind > PLANE, index, zero)]), np.int64(SHAPE_PARAMETERS)
        if planes:
            own = (kind == PLANE) | (not analytic)
            row = address_of(scene.planes[pick(kind == PLANE, index, zero)])
            start, size = pick(own, row, start), pick(own, np.int64(plane_size), size)
        if spheres:
            own = (kind == SPHERE) | (not (analytic or planes))
            row = address_of(scene.spheres[pick(kind == SPHERE, index, zero)])
            start, size = pick(own, row, start), pick(own, np.int64(sphere_size), size)
        return start, size

    return find


@cache
def _make_load_shape(features: SceneFeatures) -> Any:
    """The function (rays, lane, scene, kind, index) that copies the geometry of the primitive hit. Which kind it is hangs on
    chance, so it decides on addresses and not on branches; what is no triangle reads the corners of the first."""
    triangles, find_formula = features.triangles, _make_find_formula(features)
    numbers = SHAPE_PARAMETERS if features.analytic else PlaneRow.size if features.planes else SphereRow.size
    formulated = features.spheres or features.planes or len(features.analytic) > 0
    first_numbers = SphereRow.size

    @inline
    def load(rays, lane, scene, kind, index):
        if triangles:
            face = pick(kind == TRIANGLE, index, np.int64(0))
            keep_corners(rays, lane, scene, face)
        if formulated:
            start, size = find_formula(scene, kind, index)
            row = array_at(start, np.float64)
            for k in range(first_numbers):
                rays.shape_parameters[k, lane] = row[k]
            for k in range(first_numbers, numbers):
                rays.shape_parameters[k, lane] = row[pick(k < size, np.int64(k), np.int64(0))]

    return load


@inline
def _choices(rays, lane, scene, primitive, light, real):
    """1 / the probability with which the light that was hit would have been chosen at the vertex that the ray left, which
    is still in the batch; 1 where nobody asks: of camera rays, and after a specular event."""
    if primitive < 0 or light < 0 or not rays.pdf[lane] < real(np.inf):
        return 1.0
    return light_hierarchy.choices(scene, light, rays.point[lane], rays.geometric_normal[lane], real)


def area_lights(features: SceneFeatures) -> tuple[int, ...]:
    """The kinds of lights that are shapes."""
    return tuple(kind for kind in features.lights if lights.MODELS[kind].pdf is not None)


@cache
def make_load_hit(features: SceneFeatures, real: Any) -> Any:
    """The function (rays, scene) that copies what the scene holds of the primitives that the lanes hit."""
    several_shapes = features.spheres or features.planes or len(features.analytic) > 0
    several_bsdfs, smooth, power = len(features.bsdfs) > 1, features.smooth, features.power_lights
    hierarchy = features.light_hierarchy
    load_shape, load_materials = _make_load_shape(features), _make_load_materials(*_material_columns(features))
    parameters = max((lights.MODELS[kind].parameters for kind in area_lights(features)), default=0)
    triangles, prefetch_triangles = features.triangles, make_prefetch(features, real)

    @inline
    def load(rays, scene):
        if triangles and scene.n_triangles > NEAR_TRIANGLES:
            prefetch_triangles(rays, scene)
        for lane in range(np.uint64(LANES)):
            keep_scalar()
            primitive, held = rays.primitive[lane], rays.held_primitive[lane]
            primitive = held if held >= 0 else primitive
            rays.primitive[lane] = primitive
            index = np.int64(0) if primitive < 0 else np.int64(primitive)
            row, kind = scene.primitives[index], np.int32(TRIANGLE)
            if several_shapes:  # where there are triangles alone, their indices are their ids: one cache miss less
                kind, index = row.shape, np.int64(row.index)
            rays.shape[lane] = kind
            load_shape(rays, lane, scene, kind, index)
            rays.material[lane] = row.material
            if several_bsdfs:
                rays.bsdf_model[lane] = np.int64(scene.materials[row.material].model)
            if parameters > 0:
                light = row.light
                rays.primitive_light[lane] = light
                if hierarchy:
                    rays.light_choices[lane] = _choices(rays, lane, scene, primitive, light, real)
                elif power:
                    rays.light_choices[lane] = scene.light_choices[light if light >= 0 else np.int32(0)]
                light_row = scene.lights[light if light >= 0 else np.int32(0)]
                for k in range(parameters):
                    rays.light_parameters[k, lane] = light_row.parameters[k]
        load_materials(rays, address_of(scene.materials))
        if triangles:
            load_vertices(rays, scene)
            if smooth:
                _load_normals(rays, scene)

    return load

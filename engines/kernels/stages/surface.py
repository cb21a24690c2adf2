"""From the id of the primitive hit to the surface interaction: the stage between the intersector and the lights.

Distance and point are computed here, from the primitive, so they are the same whichever intersector found the hit.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.kernels.compile.jit import compile_stage, inline
from engines.kernels.compile.records import address_of, array_at, lane_numbers
from engines.kernels.compile.row_loads import AT_ONCE, row_loads
from engines.kernels.compile.values import const, keep_scalar, lowest_bit, pick, select
from engines.kernels.features import SceneFeatures
from engines.kernels.flatten import lights, materials
from engines.kernels.flatten.shapes import PLANE, SPHERE, TRIANGLE, analytic_shape
from engines.kernels.lane.shapes import plane, sphere, triangle
from engines.kernels.lane.shapes.intersection import ShapeIntersection, choose
from engines.kernels.lane.vector import Vec3, dot, extent, select3, sin_cos_turn, to_float64
from engines.kernels.layout import (
    LANES,
    SHAPE_PARAMETERS,
    MarginRow,
    MaterialRow,
    PlaneRow,
    RayBatch,
    SphereRow,
    ray_batch,
    scene_table,
)
from engines.kernels.stages import environment, light_hierarchy
from engines.kernels.stages.prefetching import NEAR_TRIANGLES, make_prefetch

OFFSET_ULPS = 256.0
"""New rays start this many machine epsilons of the largest coordinate away from the surface."""

_SHAPES = ("triangles", "spheres", "planes", "analytic")
_FEATURES = (
    *_SHAPES, "smooth", "bsdfs", "diffuse", "mirror", "refraction", "tangents", "emission", "lights",
    "turned_environment", "uvs", "power_lights", "light_hierarchy",
)  # fmt: skip


def margins(tracing: Any) -> NDArray[np.float64]:
    """The row (1, 2) of `SceneTable.margins`, by the precision in which rays are traced."""
    share = OFFSET_ULPS * float(np.finfo(tracing).eps)
    return np.array([MarginRow.packed(offset=share, shadow_share=1.0 - share)])


# ---- from the scene into the batch -----------------------------------------------------------------------------------


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


@cache
def _make_load_hit(features: SceneFeatures, real: Any) -> Any:
    """The function (rays, scene) that copies what the scene holds of the primitives that the lanes hit."""
    several_shapes = features.spheres or features.planes or len(features.analytic) > 0
    several_bsdfs, smooth, power = len(features.bsdfs) > 1, features.smooth, features.power_lights
    hierarchy = features.light_hierarchy
    load_shape, load_materials = _make_load_shape(features), _make_load_materials(*_material_columns(features))
    parameters = max((lights.MODELS[kind].parameters for kind in _area_lights(features)), default=0)
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


# ---- the interaction -------------------------------------------------------------------------------------------------


@cache
def _make_analytic(kinds: tuple[int, ...], real: Any) -> Any:
    """The function (parameters, kind, o, d, found) -> intersection with an analytic shape of these kinds, else
    `found`."""

    @inline
    def none(parameters, kind, o, d, found):
        return found

    if not kinds:
        return none
    own, rest, intersection = kinds[0], _make_analytic(kinds[1:], real), analytic_shape(kinds[0]).lane.intersection

    @inline
    def chosen(parameters, kind, o, d, found):
        found = choose(kind == own, intersection(o, d, parameters, real), found)
        return rest(parameters, kind, o, d, found)

    return chosen


@cache
def _make_intersection(features: SceneFeatures, real: Any) -> Any:
    """The function (rays, lane, o, d) -> where the lane's ray meets the primitive of its kind."""
    triangles, smooth, spheres, planes = features.triangles, features.smooth, features.spheres, features.planes
    has_analytic, analytic = len(features.analytic) > 0, _make_analytic(features.analytic, real)

    @inline
    def intersection(rays, lane, o, d):
        zero, kind = real(0), rays.shape[lane]
        found = ShapeIntersection(real(np.inf), zero, zero, zero, o, d, d, Vec3(zero, zero, zero))
        if triangles:
            found = triangle.intersection(
                o, d, rays.vertex0[lane], rays.vertex1[lane], rays.vertex2[lane],
                rays.vertex_normal0[lane], rays.vertex_normal1[lane], rays.vertex_normal2[lane], smooth,
            )  # fmt: skip
        if spheres or planes:
            x, y, z, a, b, c, _ = lane_numbers(rays.shape_parameters, lane)
            point = Vec3(x, y, z)
            if spheres:
                found = choose(kind == SPHERE, sphere.intersection(o, d, point, a, real), found)
            if planes:
                found = choose(kind == PLANE, plane.intersection(o, d, point, Vec3(a, b, c), real), found)
        if has_analytic:
            found = analytic(lane_numbers(rays.shape_parameters, lane), kind, o, d, found)
        return found

    return intersection


@inline
def _store_interaction(rays, lane, found, o, d, miss, offset_scale, tangents):
    """Writes the hit with its normals turned towards the viewer; returns whether the front was met."""
    zero = const(0.0, found.t)
    front = dot(d, found.normal) < zero
    geometric = select3(front, found.normal, -found.normal)
    normal = select3(dot(found.shading_normal, geometric) < zero, -found.shading_normal, found.shading_normal)
    normal = select3(dot(d, normal) < zero, normal, geometric)  # one that the viewer cannot see will not do
    scale, start = extent(found.point), extent(o)
    scale = select(start > scale, start, scale)
    scale = select(found.t > scale, found.t, scale)
    scale = select(found.scale > scale, found.scale, scale)
    rays.miss[lane] = miss
    rays.front[lane] = front
    rays.t[lane] = select(miss, const(math.inf, found.t), found.t)
    rays.u[lane] = found.u
    rays.v[lane] = found.v
    rays.offset[lane] = scale * offset_scale
    rays.point[lane] = found.point
    rays.geometric_normal[lane] = geometric
    rays.normal[lane] = normal
    if tangents:
        rays.tangent[lane] = found.tangent
    return front


def _area_lights(features: SceneFeatures) -> tuple[int, ...]:
    """The kinds of lights that are shapes."""
    return tuple(kind for kind in features.lights if lights.MODELS[kind].pdf is not None)


@cache
def _make_light_pdf(kinds: tuple[int, ...]) -> Any:
    """The function (parameters, shape, o, t, facing, choices) -> pdf with which the light sample would have chosen a
    hit of a shape that is a light of one of these kinds; 0 of others."""

    @inline
    def none(parameters, shape, o, t, facing, choices):
        return const(0.0, t)

    if not kinds:
        return none
    model, rest = lights.MODELS[kinds[0]], _make_light_pdf(kinds[1:])
    own, pdf = model.shape, model.pdf

    @inline
    def chosen(parameters, shape, o, t, facing, choices):
        others = rest(parameters, shape, o, t, facing, choices)
        return select(shape == own, pdf(parameters, o, t, facing, choices), others)

    return chosen


def _make(features: SceneFeatures, real: Any) -> Any:
    zero = real(0)
    load, intersection = _make_load_hit(features, real), _make_intersection(features, real)
    weighted = features.power_lights or features.light_hierarchy
    emission, tangents, area_lights = features.emission, features.tangents, _area_lights(features)
    listed_shapes, light_pdf_of = len(area_lights) > 0, _make_light_pdf(area_lights)
    constant_environment = lights.CONSTANT_ENVIRONMENT in features.lights
    image_environment, turned = lights.IMAGE_ENVIRONMENT in features.lights, features.turned_environment

    def surface(batch, scene_address):
        rays, scene = ray_batch(batch, real), scene_table(scene_address, real)
        load(rays, scene)
        choices = real(scene.n_lights)
        environment_choices = choices
        if weighted:
            environment_choices = scene.light_choices[scene.environment_light]
        offset_scale = real(scene.margins[0].offset)
        none = Vec3(zero, zero, zero)
        environment_radiance = none
        if constant_environment:
            environment_radiance = scene.environment_radiance[0]
        for lane in range(np.uint64(LANES)):
            o, d = rays.origin[lane], rays.direction[lane]
            found = intersection(rays, lane, o, d)
            # a hit that the primitive itself does not confirm (Embree reports some on slivers) is none
            primitive = rays.primitive[lane]
            miss = (primitive < 0) | (not (found.t < real(np.inf)))
            rays.primitive[lane] = select(miss, np.int32(-1), primitive)
            front = _store_interaction(rays, lane, found, o, d, miss, offset_scale, tangents)
            emitted, light_pdf = none, zero
            if emission:
                lit = (not miss) & (front | (rays.two_sided[lane] > zero))
                emitted = select3(lit, rays.emission[lane], none)
                if listed_shapes:
                    facing, listed = abs(dot(d, found.normal)), lit & (rays.primitive_light[lane] >= 0)
                    parameters, shape = lane_numbers(rays.light_parameters, lane), rays.shape[lane]
                    if weighted:
                        choices = rays.light_choices[lane]
                    light_pdf = select(listed, light_pdf_of(parameters, shape, o, found.t, facing, choices), zero)
            if constant_environment:
                emitted = select3(miss, environment_radiance, emitted)
                light_pdf = select(miss, rays.cosine_pdf[lane] / environment_choices, light_pdf)
            rays.emission[lane] = emitted
            rays.light_pdf[lane] = light_pdf
        if image_environment:
            _image_environment(rays, scene, environment_choices, turned, real)

    return surface


@inline
def _image_environment(rays, scene, choices, turned, real):
    """Radiance of the rays that miss, from the environment's image: prefetched, then read by scalar code."""
    lanes = np.int64(0)
    for lane in range(np.uint64(LANES)):
        lanes |= np.int64(1 if rays.miss[lane] & rays.alive[lane] else 0) << np.int64(lane)
    if lanes == 0:
        return
    width, height, axes = scene.environment_width, scene.environment_height, scene.environment_map[0]
    for lane in range(np.uint64(LANES)):
        d = to_float64(rays.direction[lane])
        if turned:
            d = environment.to_image(axes, d)
        u, v = environment.direction_to_uv(d.x, d.y, d.z)
        rays.kept[0, lane], rays.kept[1, lane], rays.kept[2, lane] = u, v, sin_cos_turn(0.5 * v)[0]
    todo = lanes
    while todo != 0:
        lane = np.uint64(lowest_bit(todo))
        todo &= todo - 1
        environment.prefetch_texels(scene, axes, rays.kept[0, lane], rays.kept[1, lane])
    while lanes != 0:
        lane = np.uint64(lowest_bit(lanes))
        lanes &= lanes - 1
        u, v = rays.kept[0, lane], rays.kept[1, lane]
        rays.emission[lane] = environment.radiance(scene.environment, environment.texels_at(width, height, axes, u, v))
        density = scene.environment_pdf[environment.texel_of(width, height, u, v)]
        rays.light_pdf[lane] = real(environment.pdf_solid_angle(density, rays.kept[2, lane])) / choices


def stage(features: SceneFeatures, real: Any) -> Any:
    """The surface stage of a scene."""
    return _stage(features.only(*_FEATURES), real)


def bare_stage(features: SceneFeatures, real: Any) -> Any:
    """The same without materials and lights: where a ray met which shape, and the geometric normal there."""
    return _stage(features.only(*_SHAPES), real)


@cache
def _stage(features: SceneFeatures, real: Any) -> Any:
    return compile_stage(_make(features, real))

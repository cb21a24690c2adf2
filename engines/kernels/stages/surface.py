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
from engines.kernels.compile.values import const, keep_scalar, lowest_bit, pick, select
from engines.kernels.features import SceneFeatures
from engines.kernels.flatten import lights, materials
from engines.kernels.flatten.shapes import PLANE, SPHERE, TRIANGLE, analytic_shape
from engines.kernels.lane.shapes import plane, sphere, triangle
from engines.kernels.lane.shapes.intersection import ShapeIntersection, choose
from engines.kernels.lane.vector import Vec3, dot, extent, select3, sin_cos_turn, to_float64
from engines.kernels.layout import LANES, SHAPE_PARAMETERS, MarginRow, PlaneRow, SphereRow, ray_batch, scene_table
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
def load_vertices(rays, lane, scene, face):
    """The corners of a triangle, by its index among the triangles."""
    row = scene.triangles[face]
    rays.vertex0[lane] = scene.vertices[row.a]
    rays.vertex1[lane] = scene.vertices[row.b]
    rays.vertex2[lane] = scene.vertices[row.c]


@cache
def _make_load_bsdf(ranges: tuple[tuple[int, int], ...]) -> Any:
    """The function (rays, lane, row) that copies these ranges of a material's parameters."""

    @inline
    def nothing(rays, lane, row):
        pass

    if not ranges:
        return nothing
    (first, last), rest = ranges[0], _make_load_bsdf(ranges[1:])

    @inline
    def load(rays, lane, row):
        for k in range(first, last):
            rays.bsdf[k, lane] = row.bsdf[k]
        rest(rays, lane, row)

    return load


def _columns(features: SceneFeatures) -> tuple[tuple[int, int], ...]:
    """Ranges of the parameters that the scene's BSDF models read."""
    wanted = sorted({column for kind in features.bsdfs for column in materials.MODELS[kind].columns(features)})
    found: list[list[int]] = []
    for column in wanted:
        if found and found[-1][1] == column:
            found[-1][1] += 1
        else:
            found.append([column, column + 1])
    return tuple((first, last) for first, last in found)


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
    triangles, smooth, find_formula = features.triangles, features.smooth, _make_find_formula(features)
    numbers = SHAPE_PARAMETERS if features.analytic else PlaneRow.size if features.planes else SphereRow.size
    formulated = features.spheres or features.planes or len(features.analytic) > 0
    first_numbers = SphereRow.size

    @inline
    def load(rays, lane, scene, kind, index):
        if triangles:
            face = pick(kind == TRIANGLE, index, np.int64(0))
            load_vertices(rays, lane, scene, face)
            if smooth:
                row = scene.triangles[face]
                rays.vertex_normal0[lane] = scene.vertex_normals[row.a]
                rays.vertex_normal1[lane] = scene.vertex_normals[row.b]
                rays.vertex_normal2[lane] = scene.vertex_normals[row.c]
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
    several_bsdfs, emission, power = len(features.bsdfs) > 1, features.emission, features.power_lights
    hierarchy = features.light_hierarchy
    load_shape, load_bsdf = _make_load_shape(features), _make_load_bsdf(_columns(features))
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
            material = scene.materials[row.material]
            load_bsdf(rays, lane, material)
            if several_bsdfs:
                rays.bsdf_model[lane] = np.int64(material.model)
            if emission:
                rays.emission[lane] = material.emission
                rays.two_sided[lane] = material.two_sided
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

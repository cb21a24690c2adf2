"""From the id of the primitive hit to the surface interaction: the stage between the intersector and the lights.

Distance and point are computed here, from the primitive, so they are the same whichever intersector found the hit.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.kernels.compile.dispatch import dispatch
from engines.kernels.compile.jit import compile_stage, inline
from engines.kernels.compile.masks import lane_bit
from engines.kernels.compile.records import address_of, lane_numbers, prefetch
from engines.kernels.compile.values import const, keep_scalar, lowest_bit, select
from engines.kernels.features import SceneFeatures, per_features
from engines.kernels.flatten import lights
from engines.kernels.flatten.shapes import PLANE, SPHERE, TRIANGLE, analytic_shape
from engines.kernels.lane.shapes import plane, sphere, triangle
from engines.kernels.lane.shapes.intersection import ShapeIntersection
from engines.kernels.lane.vector import Vec3, dot, extent, largest, length, sin_cos_turn, to_float64, to_real
from engines.kernels.layout import CAMERA_DIMENSIONS, LANES, MISS, SURFACE, ray_batch, scene_table
from engines.kernels.rows import MarginRow
from engines.kernels.stages import environment, instances
from engines.kernels.stages.emission import make_hits
from engines.kernels.stages.hit_loads import area_lights, chooses_by_weight, make_load_hit

OFFSET_ULPS = 256.0
"""New rays start this many machine epsilons of the largest coordinate away from the surface."""
FLOAT64_OFFSET = OFFSET_ULPS * float(np.finfo(np.float64).eps)
"""The same in float64, in which round shapes are intersected whatever the precision of rays."""

_UNLIT: dict[str, Any] = {
    "lights": (),
    "power_lights": False,
    "light_hierarchy": False,
    "light_cells": False,
    "emission": False,
    "textured_emission": False,
    "turned_environment": False,
    "transparent": False,
    "hidden_emitters": False,
}
_BARE: dict[str, Any] = {**_UNLIT, "bsdfs": (), "smooth": False, "tangents": False, "uvs": False}


def margins(tracing: Any) -> NDArray[np.float64]:
    """The row (1, 2) of `SceneTable.margins`, by the precision in which rays are traced."""
    share = OFFSET_ULPS * float(np.finfo(tracing).eps)
    return np.array([MarginRow.packed(offset=share, shadow_share=1.0 - share)])


@inline
def _keep(rays, lane, own, found):
    """Keeps an intersection where `own` holds."""
    rays.found[lane] = select(own, found, rays.found[lane])


@inline
def _turn_rays(rays, scene, real):
    """Keeps each lane's ray in the coordinates of what it has hit, in the scratch memory of intersectors."""
    for lane in range(np.uint64(LANES)):
        keep_scalar()
        rays.shear_x[lane] = rays.origin[lane]
        rays.shear_y[lane] = rays.direction[lane]
        if rays.primitive[lane] >= 0 and rays.instance[lane] >= 0:
            instance = scene.instances[np.int64(rays.instance[lane])]
            ray = instances.local_ray(instance, rays.origin[lane], rays.direction[lane], real)
            rays.shear_x[lane] = ray.origin
            rays.shear_y[lane] = ray.direction


@inline
def _turn_hits(rays, scene, real):
    """Puts what was found in the coordinates of groups into those of the scene, with the rounding of the rays' precision."""
    per_float64 = np.float64(scene.margins[0].offset) * (1.0 / FLOAT64_OFFSET)
    for lane in range(np.uint64(LANES)):
        keep_scalar()
        if rays.primitive[lane] >= 0 and rays.instance[lane] >= 0:
            instance, found = scene.instances[np.int64(rays.instance[lane])], rays.found[lane]
            stretch = length(instances.to_group(instance, to_float64(rays.direction[lane])))
            p, normal = to_float64(found.point), to_float64(found.normal)
            shading, tangent = to_float64(found.shading_normal), to_float64(found.tangent)
            rays.found[lane] = ShapeIntersection(
                real(np.float64(found.t) / stretch),
                real(instances.reach(instance, p, np.float64(found.scale)) * per_float64),
                found.u,
                found.v,
                to_real(instances.to_scene(instance, p) + instance.moved, real),
                to_real(instances.normal_to_scene(instance, normal), real),
                to_real(instances.normal_to_scene(instance, shading), real),
                to_real(instances.to_scene(instance, tangent), real),
            )


@inline
def _on_triangle(rays, lane, o, d, smooth):
    return triangle.intersection(
        o,
        d,
        rays.face.vertex0[lane],
        rays.face.vertex1[lane],
        rays.face.vertex2[lane],
        rays.vertex_normal0[lane],
        rays.vertex_normal1[lane],
        rays.vertex_normal2[lane],
        smooth,
    )


@per_features
def _make_meet(features: SceneFeatures, real: Any) -> Any:
    """The function (rays, scene, kinds) that keeps where rays meet the primitives hit, kind by kind: most batches lack one."""
    triangles, smooth, spheres, planes = features.triangles, features.smooth, features.spheres, features.planes
    analytic = dispatch(tuple((kind, analytic_shape(kind).lane.intersection) for kind in features.analytic))
    has_analytic, turned = len(features.analytic) > 0, features.instances

    @inline
    def meet(rays, scene, kinds):
        origin, direction = rays.origin, rays.direction
        if turned:
            _turn_rays(rays, scene, real)
            origin, direction = rays.shear_x, rays.shear_y
        if triangles and kinds.triangles != 0:
            for lane in range(np.uint64(LANES)):
                found = _on_triangle(rays, lane, origin[lane], direction[lane], smooth)
                _keep(rays, lane, rays.hit.shape[lane] == TRIANGLE, found)
        if spheres and kinds.spheres != 0:
            for lane in range(np.uint64(LANES)):
                x, y, z, radius, _, _, _ = lane_numbers(rays.shape_parameters, lane)
                found = sphere.intersection(origin[lane], direction[lane], Vec3(x, y, z), radius, real)
                _keep(rays, lane, rays.hit.shape[lane] == SPHERE, found)
        if planes and kinds.planes != 0:
            for lane in range(np.uint64(LANES)):
                x, y, z, a, b, c, _ = lane_numbers(rays.shape_parameters, lane)
                found = plane.intersection(origin[lane], direction[lane], Vec3(x, y, z), Vec3(a, b, c), real)
                _keep(rays, lane, rays.hit.shape[lane] == PLANE, found)
        if has_analytic and kinds.analytic != 0:
            for lane in range(np.uint64(LANES)):
                kind, parameters = rays.hit.shape[lane], lane_numbers(rays.shape_parameters, lane)
                rays.found[lane] = analytic(kind, rays.found[lane], origin[lane], direction[lane], parameters, real)
        if turned:
            _turn_hits(rays, scene, real)

    return meet


@inline
def _store_interaction(rays, lane, found, o, d, miss, offset_scale, tangents):
    """Writes the hit with its normals turned towards the viewer; returns whether the front was met."""
    front = dot(d, found.normal) < 0.0
    geometric = select(front, found.normal, -found.normal)
    normal = select(dot(found.shading_normal, geometric) < 0.0, -found.shading_normal, found.shading_normal)
    normal = select(dot(d, normal) < 0.0, normal, geometric)  # one that the viewer cannot see will not do
    scale, start = extent(found.point), extent(o)
    scale = select(start > scale, start, scale)
    scale = select(found.t > scale, found.t, scale)
    offset, round_offset = scale * offset_scale, found.scale * const(FLOAT64_OFFSET, found.t)
    rays.hit.kind[lane] = select(miss, np.int32(MISS), np.int32(SURFACE))
    rays.hit.front[lane] = front
    rays.t[lane] = select(miss, math.inf, found.t)
    rays.hit.u[lane] = found.u
    rays.hit.v[lane] = found.v
    rays.hit.offset[lane] = select(round_offset > offset, round_offset, offset)
    rays.hit.point[lane] = found.point
    rays.hit.geometric_normal[lane] = geometric
    rays.hit.normal[lane] = normal
    if tangents:
        rays.hit.tangent[lane] = found.tangent
    return front


@per_features
def _make_emission(features: SceneFeatures) -> Any:
    """The function (rays, lane, found, front, miss, inverse_pmf) -> (what the surface emits towards the viewer, the pdf with
    which the light sample would have found it)."""
    shining, weighted = area_lights(features), chooses_by_weight(features)
    listed_shapes = len(shining) > 0
    light_pdf_of = dispatch(tuple((lights.MODELS[kind].shape, lights.MODELS[kind].pdf) for kind in shining))
    transparent, hides = features.transparent, features.hidden_emitters

    @inline
    def emission_at(rays, lane, found, front, miss, inverse_pmf):
        o, d, zero = rays.origin[lane], rays.direction[lane], const(0.0, found.t)
        lit, light_pdf = (not miss) & (front | (rays.two_sided[lane] > zero)), zero
        if hides:
            lit = lit & (not _is_absent(rays, lane, miss, zero))
        emitted = select(lit, rays.hit.emission[lane], Vec3(zero, zero, zero))
        if listed_shapes:
            facing, listed = abs(dot(d, found.normal)), lit & (rays.emitter[lane] >= 0)
            parameters, shape = lane_numbers(rays.emitter_parameters, lane), rays.hit.shape[lane]
            if weighted:
                inverse_pmf = rays.emitter_inverse_pmf[lane]
            o, way = _from_last_vertex(rays, lane, o, d, found.t, transparent)
            light_pdf = select(listed, light_pdf_of(shape, zero, parameters, o, way, facing, inverse_pmf), zero)
        return emitted, light_pdf

    return emission_at


def _make(features: SceneFeatures, real: Any) -> Any:
    zero = real(0)
    load, meet = make_load_hit(features, real), _make_meet(features, real)
    others, smooth = features.other_shapes or features.instances, features.smooth
    weighted = chooses_by_weight(features)
    emission, tangents, hides = features.emission, features.tangents, features.hidden_emitters
    emission_at = _make_emission(features)
    constant_environment = lights.CONSTANT_ENVIRONMENT in features.lights
    real_bytes = np.dtype(real).itemsize
    image_environment, rotated = lights.IMAGE_ENVIRONMENT in features.lights, features.turned_environment
    textured = features.textured_emission
    color_hits = make_hits(features, real) if textured else None

    def surface(batch, scene_address):
        rays, scene = ray_batch(batch, real), scene_table(scene_address, real)
        kinds = load(rays, scene)
        if others:
            meet(rays, scene, kinds)
        inverse_pmf = real(scene.light_choices)
        environment_inverse_pmf = inverse_pmf
        if weighted:
            environment_inverse_pmf = scene.light_inverse_pmf[scene.environment_light]
        offset_scale = real(scene.margins[0].offset)
        none = Vec3(zero, zero, zero)
        environment_radiance = none
        if constant_environment:
            environment_radiance = scene.environment_radiance[0]
        for lane in range(np.uint64(LANES)):
            o, d = rays.origin[lane], rays.direction[lane]
            found = rays.found[lane] if others else _on_triangle(rays, lane, o, d, smooth)
            # a hit that the primitive itself does not confirm (Embree reports some on slivers) is none
            primitive = rays.primitive[lane]
            miss = (primitive < 0) | (not (found.t < real(np.inf)))
            rays.primitive[lane] = select(miss, np.int32(-1), primitive)
            front = _store_interaction(rays, lane, found, o, d, miss, offset_scale, tangents)
            emitted, light_pdf = none, zero
            if emission:
                emitted, light_pdf = emission_at(rays, lane, found, front, miss, inverse_pmf)
            elif hides:
                rays.crossing.absent[lane] = False  # an update may have taken the last emitter away
            if constant_environment:
                emitted = select(miss, environment_radiance, emitted)
                light_pdf = select(miss, rays.cosine_pdf[lane] / environment_inverse_pmf, light_pdf)
            rays.hit.emission[lane] = emitted
            rays.hit.light_pdf[lane] = light_pdf
        if textured:
            color_hits(rays, scene)
        if image_environment:
            _image_environment(rays, scene, environment_inverse_pmf, rotated, real_bytes, real)
        if hides:
            _hide_environment(rays, none)

    return surface


@inline
def _is_absent(rays, lane, miss, zero):
    """Whether the surface is an emitter that hides from the camera; keeps it, too."""
    absent = (not miss) & (rays.path.depth[lane] == 1) & (largest(rays.hit.emission[lane]) > zero)
    rays.crossing.absent[lane] = absent
    return absent


@inline
def _from_last_vertex(rays, lane, o, d, t, transparent):
    """Origin and length of the way to a hit, those of the ray unless null lobes were crossed."""
    if transparent:
        return o - d * rays.crossing.way[lane], t + rays.crossing.way[lane]
    return o, t


@inline
def _hide_environment(rays, none):
    """Where null lobes alone lie between it and the camera."""
    for lane in range(np.uint64(LANES)):
        straight = (rays.dimension[lane] == CAMERA_DIMENSIONS) | (not rays.crossing.scattered[lane])
        unseen = (rays.hit.kind[lane] == MISS) & straight
        rays.hit.emission[lane] = select(unseen, none, rays.hit.emission[lane])


@inline
def _image_environment(rays, scene, inverse_pmf, turned, real_bytes, real):
    """Radiance of the rays that miss, from the environment's image: prefetched, then read by scalar code."""
    lanes = np.int64(0)
    for lane in range(np.uint64(LANES)):
        lanes |= lane_bit(lane, (rays.hit.kind[lane] == MISS) & rays.alive[lane])
    if lanes == 0:
        return
    width, height, axes = scene.environment_width, scene.environment_height, scene.environment_map[0]
    for lane in range(np.uint64(LANES)):
        d = to_float64(rays.direction[lane])
        if turned:
            d = environment.to_image(axes, d)
        u, v = environment.direction_to_uv(d.x, d.y, d.z)
        rays.missed_place[0, lane], rays.missed_place[1, lane], rays.missed_place[2, lane] = u, v, sin_cos_turn(0.5 * v)[0]
    todo = lanes
    while todo != 0:
        lane = np.uint64(lowest_bit(todo))
        todo &= todo - 1
        u, v = rays.missed_place[0, lane], rays.missed_place[1, lane]
        environment.prefetch_texels(scene, axes, u, v, real_bytes)
        prefetch(address_of(scene.environment_pdf) + real_bytes * environment.texel_of(width, height, u, v))
    while lanes != 0:
        lane = np.uint64(lowest_bit(lanes))
        lanes &= lanes - 1
        u, v = rays.missed_place[0, lane], rays.missed_place[1, lane]
        rays.hit.emission[lane] = environment.radiance(scene.environment, environment.texels_at(width, height, axes, u, v))
        density = scene.environment_pdf[environment.texel_of(width, height, u, v)]
        rays.hit.light_pdf[lane] = real(environment.pdf_solid_angle(density, rays.missed_place[2, lane])) / inverse_pmf


def stage(features: SceneFeatures, real: Any) -> Any:
    """The surface stage of a scene."""
    return _stage(features, real)


def bare_stage(features: SceneFeatures, real: Any) -> Any:
    """The same without materials and lights: where a ray met which shape, and the geometric normal there."""
    return _stage(features._replace(**_BARE), real)


def dark_stage(features: SceneFeatures, real: Any) -> Any:
    """The same without lights, of shadow rays."""
    return _stage(features._replace(**_UNLIT), real)


@per_features
def _stage(features: SceneFeatures, real: Any) -> Any:
    return compile_stage(_make(features, real))

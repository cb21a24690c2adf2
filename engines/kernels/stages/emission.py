"""Emission that textures hold: where rays have hit it, and where light samples lie on it. In rows of materials and lights it is
white. Scalar code: what is read differs from lane to lane."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.features import SceneFeatures, per_features
from engines.kernels.flatten.lights import CYLINDER, DISK, MESH, SPHERE
from engines.kernels.flatten.shapes import PLANE, TRIANGLE
from engines.kernels.flatten.shapes import SPHERE as SPHERE_SHAPE
from engines.kernels.lane.shapes import plane, sphere
from engines.kernels.lane.shapes.coordinates import Coordinates
from engines.kernels.lane.shapes.triangle import VertexUV, interpolated_uv
from engines.kernels.lane.vector import Vec3, to_float64
from engines.kernels.layout import LANES, MISS, POINT_U0, POINT_U1, SURFACE
from engines.kernels.stages.material import analytic_coordinates
from engines.kernels.stages.textures import OnTriangle, as_light, make_color


@inline
def _on_triangle(scene, row, b1, b2):
    face = scene.triangles[row.index]
    a, b, c = scene.vertex_uvs[face.a], scene.vertex_uvs[face.b], scene.vertex_uvs[face.c]
    if a.given == 0.0:
        return VertexUV(b1, b2)
    return interpolated_uv(b1, b2, a, b, c)


@per_features
def _make_place(features: SceneFeatures) -> Any:
    """The function (scene, row of a primitive, point of it, weights of a triangle's second and third vertex) -> its (u, v)."""
    spheres, planes, has_analytic = features.spheres, features.planes, len(features.analytic) > 0
    triangles, analytic = features.triangles, analytic_coordinates(features.analytic)

    @inline
    def place(scene, row, p, b1, b2):
        kind, index, none = np.int64(row.shape), np.int64(row.index), Vec3(0.0, 0.0, 0.0)
        if triangles and kind == TRIANGLE:
            return _on_triangle(scene, row, b1, b2)
        at = Coordinates(0.0, 0.0, none, none)
        if spheres and kind == SPHERE_SHAPE:
            at = sphere.coordinates(p, scene.spheres[index].center, scene.spheres[index].radius)
        elif planes and kind == PLANE:
            at = plane.coordinates(p, scene.planes[index].point, scene.planes[index].normal)
        elif has_analytic:
            at = analytic(kind, at, p, scene.analytic[index].parameters)
        return VertexUV(at.u, at.v)

    return place


@per_features
def _make_radiance(features: SceneFeatures, real: Any) -> Any:
    """The function (scene, id of a primitive, point of it, weights of its vertices, white) -> what the texture of its emission
    holds there, `white` where it has none."""
    place, color_of = _make_place(features), make_color(features)

    @inline
    def radiance(scene, primitive, p, b1, b2, white):
        row = scene.primitives[primitive]
        texture = np.int64(scene.emission_textures[row.material])
        if texture < 0:
            return white
        at = place(scene, row, p, b1, b2)
        return as_light(color_of(scene, texture, at, OnTriangle(primitive, b1, b2)), real)

    return radiance


@per_features
def make_hits(features: SceneFeatures, real: Any) -> Any:
    """The function (rays, scene) that colours what surfaces emit where the batch's rays have hit them."""
    radiance, zero = _make_radiance(features, real), real(0)

    @inline
    def hits(rays, scene):
        for lane in range(np.uint64(LANES)):
            emitted = rays.hit.emission[lane]
            if rays.alive[lane] and rays.hit.kind[lane] == SURFACE and emitted.x > zero:
                b1, b2, p = np.float64(rays.hit.u[lane]), np.float64(rays.hit.v[lane]), to_float64(rays.hit.point[lane])
                rays.hit.emission[lane] = radiance(scene, np.int64(rays.primitive[lane]), p, b1, b2, emitted)

    return hits


@per_features
def make_light_samples(features: SceneFeatures, real: Any) -> Any:
    """The function (rays, scene) that colours the light samples of the batch."""
    radiance, zero, white = _make_radiance(features, real), real(0), Vec3(real(1), real(1), real(1))

    @inline
    def light_samples(rays, scene):
        for lane in range(np.uint64(LANES)):
            li, kind, primitive = rays.light_sample.radiance[lane], rays.light_kind[lane], np.int64(-1)
            if rays.alive[lane] and rays.hit.kind[lane] != MISS and li.x > zero:
                if kind == MESH:
                    primitive = np.int64(rays.light_primitive[lane])
                elif kind in (SPHERE, DISK, CYLINDER):
                    primitive = np.int64(scene.light_primitives[rays.chosen_light[lane]])
            if primitive >= 0:
                sample = rays.light_sample[lane]
                p = to_float64(rays.hit.point[lane]) + to_float64(sample.wi) * np.float64(sample.distance)
                root, u1 = math.sqrt(np.float64(rays.draw[POINT_U0, lane])), np.float64(rays.draw[POINT_U1, lane])
                rays.light_sample.radiance[lane] = li * radiance(scene, primitive, p, root * (1.0 - u1), root * u1, white)

    return light_samples

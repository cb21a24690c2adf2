"""The material at a hit, where it has a program: wrappers are walked to a model, and textures give its parameters.

The surface stage has loaded the material's own row. For a hit whose material has a program this stage, between the
vertex's random numbers and the lights, writes the model and its parameters, the shading normal, and what masks decide
(docs/transport.md, "Textures" and "Wrappers"). It is scalar code: what is read differs from lane to lane.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from engines.kernels.compile.dispatch import dispatch
from engines.kernels.compile.jit import compile_stage, inline
from engines.kernels.compile.masks import lane_bit
from engines.kernels.compile.records import lane_numbers
from engines.kernels.compile.values import lowest_bit
from engines.kernels.features import SceneFeatures, per_features
from engines.kernels.flatten.lookups import LUMINANCE
from engines.kernels.flatten.programs import BLEND, BUMP, LEAF, MASK, PREFETCHED, SIDES, THROUGH
from engines.kernels.flatten.shapes import PLANE, SPHERE, analytic_shape
from engines.kernels.lane import tilt
from engines.kernels.lane.shapes import plane, sphere, triangle
from engines.kernels.lane.shapes.coordinates import Coordinates
from engines.kernels.lane.shapes.triangle import VertexUV
from engines.kernels.lane.vector import Vec3, dot, to_float64
from engines.kernels.layout import LANES, LOBE, SURFACE, ray_batch, scene_table
from engines.kernels.rows import BSDF_PARAMETERS
from engines.kernels.stages import instances
from engines.kernels.stages.textures import OnTriangle, color_at, gradient_at, luminance, make_color, prefetch_texels

# ---- texture coordinates -----------------------------------------------------------------------------------------------


@inline
def _vertex_uv(row):
    return VertexUV(row.u, row.v)


def analytic_coordinates(kinds: tuple[int, ...]) -> Any:
    """The function (kind, found, p, parameters) -> coordinates on an analytic shape of these kinds, else `found`."""
    return dispatch(tuple((kind, analytic_shape(kind).lane.coordinates) for kind in kinds), branches=True)


@per_features
def _make_coordinates(features: SceneFeatures) -> Any:
    """The function (rays, lane, scene) -> coordinates of the lane's hit, in float64."""
    triangles, spheres, planes, uvs = features.triangles, features.spheres, features.planes, features.uvs
    has_analytic, analytic = len(features.analytic) > 0, analytic_coordinates(features.analytic)
    turned = features.instances

    @inline
    def on_triangle(rays, lane, scene):
        b1, b2 = np.float64(rays.hit.u[lane]), np.float64(rays.hit.v[lane])
        a, b, c = to_float64(rays.face.vertex0[lane]), to_float64(rays.face.vertex1[lane]), to_float64(rays.face.vertex2[lane])
        if uvs:
            face = scene.triangles[scene.primitives[rays.primitive[lane]].index]
            first = scene.vertex_uvs[face.a]
            if first.given != 0.0:
                ta, tb, tc = first, scene.vertex_uvs[face.b], scene.vertex_uvs[face.c]
                return triangle.mesh_coordinates(b1, b2, a, b, c, _vertex_uv(ta), _vertex_uv(tb), _vertex_uv(tc))
        return triangle.coordinates(b1, b2, a, b, c)

    @inline
    def of_shape(rays, lane, scene, p):
        kind = rays.hit.shape[lane]
        if spheres or planes:
            x, y, z, a, b, c, _ = lane_numbers(rays.shape_parameters, lane)
            if spheres and kind == SPHERE:
                return sphere.coordinates(p, Vec3(x, y, z), a)
            if planes and kind == PLANE:
                return plane.coordinates(p, Vec3(x, y, z), Vec3(a, b, c))
        if has_analytic and kind > PLANE:
            none = Vec3(0.0, 0.0, 0.0)
            return analytic(kind, Coordinates(0.0, 0.0, none, none), p, lane_numbers(rays.shape_parameters, lane))
        if triangles:
            return on_triangle(rays, lane, scene)
        none = Vec3(0.0, 0.0, 0.0)
        return Coordinates(0.0, 0.0, none, none)

    @inline
    def coordinates(rays, lane, scene):
        p = to_float64(rays.hit.point[lane])
        if turned and rays.instance[lane] >= 0:
            instance = scene.instances[np.int64(rays.instance[lane])]
            at = of_shape(rays, lane, scene, instances.point_to_group(instance, p))
            return Coordinates(at.u, at.v, instances.to_scene(instance, at.dp_du), instances.to_scene(instance, at.dp_dv))
        return of_shape(rays, lane, scene, p)

    return coordinates


# ---- the walk ----------------------------------------------------------------------------------------------------------


class Walk(NamedTuple):
    """Where a walk stands: the node, the random number that is left, and what masks and tilts have made of the surface."""

    node: int
    u: float
    opacity: float
    passing: bool
    tilts: int
    before: Vec3
    """The shading normal before the last tilt; 0 where nothing is scattered."""
    frame: tilt.Tilted


@inline
def triangle_point(rays, lane):
    """The point that a lane's ray has hit, where that is one of a triangle."""
    return OnTriangle(np.int64(rays.primitive[lane]), np.float64(rays.hit.u[lane]), np.float64(rays.hit.v[lane]))


@per_features
def make_share(features: SceneFeatures) -> Any:
    """The function (scene, node, at, on) -> the opacity of a mask, the weight of a blend: in [0, 1]."""
    textures, color_of = features.textures, make_color(features)

    @inline
    def share_of(scene, node, at, on):
        value = node.value
        if textures and node.texture >= 0.0:
            value = luminance(color_of(scene, np.int64(node.texture), at, on))
        value = value if value > 0.0 else 0.0  # NaN, too
        return value if value < 1.0 else 1.0

    return share_of


@inline
def _chosen(u, share):
    """(whether `u` chooses the share, what is left of it): again a number in [0, 1)."""
    if u < share:
        return True, u / share
    return False, (u - share) / (1.0 - share)


@inline
def _after_mask(state, node, share):
    u, passing = state.u, state.passing
    if not passing:
        there, u = _chosen(u, share)
        passing = not there
    return Walk(np.int64(node.first), u, state.opacity * share, passing, state.tilts, state.before, state.frame)


@inline
def _after_blend(state, node, share):
    second, u = _chosen(state.u, share)
    following = np.int64(node.second) if second else np.int64(node.first)
    return Walk(following, u, state.opacity, state.passing, state.tilts, state.before, state.frame)


@inline
def tilted(scene, node, kind, frame, before, at, front, ng, wo):
    """(the frame of a bump or normal map, the shading normal before it): see `Walk`."""
    texture, through = np.int64(node.texture), node.second == THROUGH
    if kind == BUMP:
        slope, scale = gradient_at(scene, texture, at.u, at.v), node.value
        if through and not front:
            scale = -scale
        found = tilt.bump(frame, ng, wo, slope.x * scale, slope.y * scale)
    else:
        found = tilt.normal_map(frame, front, through, wo, color_at(scene, texture, at.u, at.v))
    if dot(before, before) == 0.0 or not (found.seen or through):
        return found, Vec3(0.0, 0.0, 0.0)
    return found, frame.normal


@per_features
def _make_walk(features: SceneFeatures) -> Any:
    """The function (scene, first node, u, at, on, front, ng, wo, frame) -> Walk at the leaf."""
    share_of, choices, masks, tilts = make_share(features), features.choices, features.masks, features.tilts

    @inline
    def walk(scene, first, u, at, on, front, ng, wo, frame):
        state = Walk(first, u, 1.0, False, np.int64(0), frame.normal, frame)
        node = scene.nodes[first]
        kind = np.int64(node.kind)
        while kind != LEAF:
            if kind == SIDES:
                following = np.int64(node.first) if front else np.int64(node.second)
                state = Walk(following, state.u, state.opacity, state.passing, state.tilts, state.before, state.frame)
            if choices:
                if masks and kind == MASK:
                    state = _after_mask(state, node, share_of(scene, node, at, on))
                elif kind == BLEND:
                    state = _after_blend(state, node, share_of(scene, node, at, on))
            if tilts and kind >= BUMP:
                frame, before = tilted(scene, node, kind, state.frame, state.before, at, front, ng, wo)
                following = np.int64(node.first)
                state = Walk(following, state.u, state.opacity, state.passing, state.tilts + 1, before, frame)
            node = scene.nodes[state.node]
            kind = np.int64(node.kind)
        return state

    return walk


@per_features
def make_look_up(features: SceneFeatures) -> Any:
    """The function (rays, lane, scene, leaf, at) that puts the parameters of a leaf that textures give into the batch."""
    color_of = make_color(features)

    @inline
    def look_up(rays, lane, scene, leaf, at):
        first, last, on = np.int64(leaf.texture), np.int64(-1), triangle_point(rays, lane)
        color = Vec3(0.0, 0.0, 0.0)
        for k in range(np.int64(leaf.value)):
            row = scene.lookups[first + k]
            texture, channel = np.int64(row.texture), np.int64(row.channel)
            if texture != last:
                color, last = color_of(scene, texture, at, on), texture
            value = color.x if channel == 0 else (color.y if channel == 1 else color.z)
            if channel == LUMINANCE:
                value = luminance(color)
            value = value if value > row.low else row.low
            rays.bsdf[np.int64(row.parameter), lane] = value if value < row.high else row.high

    return look_up


# ---- the stage ---------------------------------------------------------------------------------------------------------


@per_features
def make_locate(features: SceneFeatures) -> Any:
    """The function (rays, scene, lanes) that keeps the coordinates of the hits of these lanes, and prefetches texels that
    their programs may read there."""
    coordinates, textures = _make_coordinates(features), features.textures

    @inline
    def locate(rays, scene, lanes):
        while lanes != 0:
            lane = np.uint64(lowest_bit(lanes))
            lanes &= lanes - 1
            at = coordinates(rays, lane, scene)
            rays.coordinates[0, lane], rays.coordinates[1, lane] = at.u, at.v
            rays.coordinates[2, lane], rays.coordinates[3, lane], rays.coordinates[4, lane] = at.dp_du.x, at.dp_du.y, at.dp_du.z
            rays.coordinates[5, lane], rays.coordinates[6, lane], rays.coordinates[7, lane] = at.dp_dv.x, at.dp_dv.y, at.dp_dv.z
            if textures:
                first = PREFETCHED * np.int64(scene.primitives[rays.primitive[lane]].material)
                for k in range(PREFETCHED):
                    texture = scene.program_textures[first + k]
                    if texture < 0:
                        break
                    prefetch_texels(scene, texture, at.u, at.v)

    return locate


@inline
def coordinates_at(rays, lane):
    """Those that are kept."""
    u, v, a, b, c, d, e, f = lane_numbers(rays.coordinates, lane)
    return Coordinates(u, v, Vec3(a, b, c), Vec3(d, e, f))


@inline
def _lanes_with_program(rays, scene):
    """A word with a bit for each lane whose hit has a program, of which the first node is kept."""
    lanes = np.int64(0)
    for lane in range(np.uint64(LANES)):
        if rays.alive[lane] and rays.hit.kind[lane] == SURFACE:
            first = scene.programs[scene.primitives[rays.primitive[lane]].material]
            rays.program[lane] = first
            lanes |= lane_bit(lane, first >= 0)
    return lanes


def _make(features: SceneFeatures, real: Any) -> Any:
    several = len(features.bsdfs) > 1
    textures, uvs, tangents = features.textures, features.uvs, features.tangents
    choices, masks, tilts = features.choices, features.masks, features.tilts
    located, below_one = textures or uvs or tangents, 1.0 - float(np.finfo(real).epsneg)
    locate, walk, look_up = make_locate(features), _make_walk(features), make_look_up(features)

    @inline
    def apply_program(rays, lane, scene, first):
        at = coordinates_at(rays, lane)  # of what nobody reads, where nothing is located
        ng, wo = to_float64(rays.hit.geometric_normal[lane]), -to_float64(rays.direction[lane])
        frame = tilt.Tilted(to_float64(rays.hit.normal[lane]), at.dp_du, at.dp_dv, True)
        u = np.float64(rays.draw[LOBE, lane])
        state = walk(scene, first, u, at, triangle_point(rays, lane), rays.hit.front[lane], ng, wo, frame)
        leaf = scene.nodes[state.node]
        constants = scene.leaves[np.int64(leaf.second)].bsdf
        for k in range(BSDF_PARAMETERS):
            rays.bsdf[k, lane] = constants[k]
        if textures:
            look_up(rays, lane, scene, leaf, at)
        if several:
            rays.bsdf_model[lane] = np.int64(leaf.first)
        if choices:
            rays.draw[LOBE, lane] = state.u if state.u < below_one else below_one
        if masks:
            rays.wrapped.opacity[lane] = state.opacity
            rays.wrapped.passing[lane] = state.passing
        if tilts and state.tilts > 0:
            rays.hit.normal[lane] = state.frame.normal
            rays.wrapped.untilted_normal[lane] = state.before
            rays.wrapped.outer_normal[lane] = frame.normal
        if tangents:
            node = scene.nodes[first]
            plain = np.int64(node.kind) == LEAF and node.value == 0.0  # here for the coordinates of a mesh alone
            if not (plain and rays.hit.shape[lane] == PLANE):
                rays.hit.tangent[lane] = state.frame.dp_du

    def material(batch, scene_address):
        rays, scene = ray_batch(batch, real), scene_table(scene_address, real)
        if masks or tilts:
            for lane in range(np.uint64(LANES)):
                if masks:
                    rays.wrapped.opacity[lane] = real(1)
                    rays.wrapped.passing[lane] = False
                if tilts:
                    rays.wrapped.untilted_normal[lane] = rays.hit.normal[lane]
                    rays.wrapped.outer_normal[lane] = rays.hit.normal[lane]
        lanes = _lanes_with_program(rays, scene)
        if located:
            locate(rays, scene, lanes)
        while lanes != 0:
            lane = np.uint64(lowest_bit(lanes))
            lanes &= lanes - 1
            apply_program(rays, lane, scene, np.int64(rays.program[lane]))

    return material


@per_features
def stage(features: SceneFeatures, real: Any) -> Any:
    """The material stage of a scene where some material has a program."""
    return compile_stage(_make(features, real))

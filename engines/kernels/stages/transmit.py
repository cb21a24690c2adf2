"""What null lobes let pass of a shadow ray: the transmittance of the surface that it has met, and the ray beyond
(docs/transport.md, "Null lobes" and "Transparent shadows").

Shadow rays have a batch of their own, which goes through the stages "closest", "surface" without lights, and this one, until
every ray has arrived at its light or is blocked. `shadow.transmittance` is what has passed, and `t` not above 0 where a ray has
ended. Transmittances are scalar code: what is read differs from lane to lane.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from engines.kernels.compile.dispatch import dispatch
from engines.kernels.compile.jit import compile_stage, inline
from engines.kernels.compile.masks import lanes_where
from engines.kernels.compile.records import lane_numbers
from engines.kernels.compile.values import lowest_bit, select
from engines.kernels.features import SceneFeatures, per_features
from engines.kernels.flatten.materials import transmittance_of
from engines.kernels.flatten.programs import BLEND, BUMP, LEAF, MASK, SIDES, THROUGH
from engines.kernels.lane import media, tilt
from engines.kernels.lane.vector import Vec3, dot, largest, length, to_float64, to_real
from engines.kernels.layout import LANES, SURFACE, ray_batch, scene_table
from engines.kernels.rows import BSDF_PARAMETERS
from engines.kernels.stages.flight import load_extinctions, medium_beyond
from engines.kernels.stages.material import coordinates_at, make_locate, make_look_up, make_share, tilted, triangle_point
from engines.kernels.stages.shade import curved_shapes, make_leave

_on_surfaces = lanes_where("==", SURFACE)


def _of_model(kinds: tuple[int, ...]) -> Any:
    """The function (model, opaque, parameters, direction, normal) -> transmittance of a leaf of one of these models, which is
    `opaque` of those that let nothing pass."""
    null = ((kind, transmittance_of(kind)) for kind in kinds)
    return dispatch(tuple((kind, transmittance) for kind, transmittance in null if transmittance), branches=True)


@per_features
def _make_of_leaf(features: SceneFeatures, real: Any) -> Any:
    """The function (rays, lane, scene, leaf, at, frame, before) -> transmittance of a program's leaf, in float64."""
    of_model, textures, tilts, none = _of_model(features.bsdfs), features.textures, features.tilts, real(0)
    look_up = make_look_up(features)

    @inline
    def of_leaf(rays, lane, scene, leaf, at, frame, before):
        constants = scene.leaves[np.int64(leaf.second)].bsdf
        for k in range(BSDF_PARAMETERS):
            rays.bsdf[k, lane] = constants[k]
        if textures:
            look_up(rays, lane, scene, leaf, at)
        direction, normal = rays.direction[lane], to_real(frame.normal, real)
        opaque, parameters = Vec3(none, none, none), lane_numbers(rays.bsdf, lane)
        found = to_float64(of_model(np.int64(leaf.first), opaque, parameters, direction, normal))
        if tilts:
            d = to_float64(direction)
            factor = tilt.terminator(to_float64(rays.hit.normal[lane]), frame.normal, d)
            found = found * (factor if tilt.is_consistent(before, frame.normal, d) else 0.0)
        return found

    return of_leaf


@per_features
def _make_of_node(features: SceneFeatures, blends: int, real: Any) -> Any:
    """The function (rays, lane, scene, node, share, at, frame, before) -> what a program lets pass of a share of light, with at
    most so many `blends` around each other."""
    share_of, choices, masks, tilts = make_share(features), features.choices, features.masks, features.tilts
    of_leaf, of_first = _make_of_leaf(features, real), _make_of_node(features, blends - 1, real) if blends else None

    @inline
    def of_node(rays, lane, scene, first, share, at, frame, before):
        passed, front = Vec3(0.0, 0.0, 0.0), rays.hit.front[lane]
        ng, wo = to_float64(rays.hit.geometric_normal[lane]), -to_float64(rays.direction[lane])
        node = scene.nodes[first]
        kind = np.int64(node.kind)
        while kind != LEAF:
            following = np.int64(node.first)
            if kind == SIDES and not front:
                following = np.int64(node.second)
            if choices:
                if masks and kind == MASK:
                    opacity = share_of(scene, node, at, triangle_point(rays, lane))
                    through = share * (1.0 - opacity)
                    passed, share = passed + Vec3(through, through, through), share * opacity
                elif blends and kind == BLEND:
                    weight = share_of(scene, node, at, triangle_point(rays, lane))
                    passed = passed + of_first(rays, lane, scene, following, share * (1.0 - weight), at, frame, before)
                    following, share = np.int64(node.second), share * weight
            if tilts and kind >= BUMP and node.second == THROUGH:
                frame, before = tilted(scene, node, kind, frame, before, at, front, ng, wo)
            node = scene.nodes[following]
            kind = np.int64(node.kind)
        return passed + of_leaf(rays, lane, scene, node, at, frame, before) * share

    return of_node


@per_features
def _make_transmittance(features: SceneFeatures, real: Any) -> Any:
    """The function (rays, lane, scene) -> transmittance of the surface that a lane's ray has met."""
    several, only = len(features.bsdfs) > 1, features.bsdfs[0]
    of_model, programs, none = _of_model(features.bsdfs), features.programs, real(0)
    of_node = _make_of_node(features, features.blends, real) if programs else None

    @inline
    def transmittance(rays, lane, scene):
        if programs:
            first = np.int64(scene.programs[scene.primitives[rays.primitive[lane]].material])
            if first >= 0:
                at, normal = coordinates_at(rays, lane), to_float64(rays.hit.normal[lane])
                frame = tilt.Tilted(normal, at.dp_du, at.dp_dv, True)
                return to_real(of_node(rays, lane, scene, first, 1.0, at, frame, normal), real)
        model = np.int64(rays.bsdf_model[lane]) if several else np.int64(only)
        opaque, parameters = Vec3(none, none, none), lane_numbers(rays.bsdf, lane)
        return of_model(model, opaque, parameters, rays.direction[lane], rays.hit.normal[lane])

    return transmittance


@inline
def _attenuate(rays, scene):
    """What media let pass on the way to what the rays have met; that of a ray which has ended is 0 long."""
    load_extinctions(rays, scene)
    for lane in range(np.uint64(LANES)):
        met = rays.t[lane] + rays.attenuation.lead[lane]
        way = select(rays.hit.kind[lane] == SURFACE, met, rays.attenuation.distance[lane])
        passed = media.transmittance(rays.flight.sigma_t[lane], way)
        rays.shadow.transmittance[lane] = rays.shadow.transmittance[lane] * passed


@inline
def _store_next_rays(rays, share, leave, has_media, real):
    """The rays that go on, from the far side of what they have met to the same place; `t` is -1 of the others."""
    zero, infinite = real(0), real(math.inf)
    for lane in range(np.uint64(LANES)):
        goes = (rays.hit.kind[lane] == SURFACE) & (largest(rays.shadow.transmittance[lane]) > zero)
        offset, endless = rays.hit.offset[lane], rays.shadow.t_max[lane] == infinite
        origin = rays.hit.point[lane] - rays.hit.geometric_normal[lane] * offset
        aim = rays.shadow.destination[lane] - origin
        way = length(aim)
        rays.origin[lane] = origin
        rays.direction[lane] = select(endless, rays.direction[lane], aim * (real(1) / way))
        rays.t[lane] = select(goes, select(endless, infinite, way * share - offset), real(-1))
        leave(rays, lane)
        if has_media:
            far = select(endless, infinite, length(rays.shadow.destination[lane] - rays.hit.point[lane]))
            rays.attenuation.distance[lane] = select(goes, far, zero)
            rays.attenuation.lead[lane] = offset * abs(dot(rays.hit.geometric_normal[lane], rays.direction[lane]))


def _make(features: SceneFeatures, real: Any) -> Any:
    transmittance, textures = _make_transmittance(features, real), features.textures
    locate, programs = make_locate(features), features.programs
    leave, has_media = make_leave(curved_shapes(features), features.instances), features.media

    def transmit(batch, scene_address):
        rays, scene = ray_batch(batch, real), scene_table(scene_address, real)
        hits = _on_surfaces(rays.hit.kind)
        if has_media:
            _attenuate(rays, scene)
        if programs and textures:
            locate(rays, scene, hits)
        while hits != 0:
            lane = np.uint64(lowest_bit(hits))
            hits &= hits - 1
            passed = transmittance(rays, lane, scene)
            rays.shadow.transmittance[lane] = rays.shadow.transmittance[lane] * passed
            if has_media:
                before = np.int32(rays.attenuation.medium[lane])
                rays.attenuation.medium[lane] = medium_beyond(rays, lane, scene, not rays.hit.front[lane], before)
        _store_next_rays(rays, real(scene.margins[0].shadow_share), leave, has_media, real)

    return transmit


def stage(features: SceneFeatures, real: Any) -> Any:
    """The stage of a scene whose shadow rays cross null lobes."""
    return _stage(features, real)


@per_features
def _stage(features: SceneFeatures, real: Any) -> Any:
    return compile_stage(_make(features, real))

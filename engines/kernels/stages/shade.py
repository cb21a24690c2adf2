"""The shade stage: each lane's state is loaded, the integrator's step is called, and what it decides is stored."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.choices import Choice
from engines.kernels.compile.dispatch import dispatch
from engines.kernels.compile.jit import compile_stage, inline
from engines.kernels.compile.values import const, select
from engines.kernels.features import SceneFeatures
from engines.kernels.flatten.lights import CONSTANT_ENVIRONMENT, IMAGE_ENVIRONMENT
from engines.kernels.flatten.shapes import analytic_shape
from engines.kernels.integrators import aov, path_tracer, whitted
from engines.kernels.integrators.interface import MAX_DEPTH, Integrator, Path, SurfaceInteraction, Uses
from engines.kernels.lane.bsdf.interface import BSDFSample, Scattering, Spectrum
from engines.kernels.lane.lights import LightSample
from engines.kernels.lane.media import SPHERE_PDF, phase, sample_phase
from engines.kernels.lane.sampling import cosine_pdf
from engines.kernels.lane.vector import WHITE, Vec3, dot, largest, length
from engines.kernels.layout import (
    CAMERA_DIMENSIONS,
    DIRECTION_U0,
    DIRECTION_U1,
    LANES,
    LIGHT,
    LOBE,
    MEDIUM,
    MOST_NULL_LOBES,
    POINT_U0,
    POINT_U1,
    ROULETTE,
    SHADER_OPTIONS,
    VERTEX_DIMENSIONS,
    VERTEX_DRAWS,
    Attenuation,
    Branch,
    ray_batch,
    scene_table,
)
from engines.kernels.stages.scattering import keeps_eta_scale, load_draws, load_interaction, make_scattering
from engines.scene import support

INTEGRATORS: Mapping[str, Integrator] = {
    "path_tracer": path_tracer.INTEGRATOR,
    "volumetric_path_tracer": path_tracer.INTEGRATOR,
    "whitted": whitted.WHITTED,
    "no_shadows": whitted.NO_SHADOWS,
    "depth_map": aov.DEPTH_MAP,
    "albedo": aov.ALBEDO,
}


def integrator_of(shader: Choice) -> Integrator:
    """The built-in integrator, or that of a plugin, of which nothing is known but whether it is called for every light:
    so it may branch, send shadow rays anywhere and read every part of `Scattering`."""
    if shader.plugin is None:
        return INTEGRATORS[shader.name]
    every = getattr(shader.plugin, "lights", "one") == "all"
    return Integrator(shader.plugin.jitted, Uses(True, True, True, True), every_light=every, branches=True)


def light_sampler(shader: Choice) -> str:
    """How the integrator chooses one light of several."""
    return "uniform" if shader.plugin is not None else shader.options.get("light_sampler", "uniform")


def light_candidates(shader: Choice) -> int:
    """Of how many light samples at a vertex the integrator takes one."""
    return 1 if shader.plugin is not None else shader.options.get("light_candidates", 1)


def traces_paths(shader: Choice) -> bool:
    """Whether the integrator is the path tracer, in media or not."""
    return shader.plugin is None and INTEGRATORS[shader.name] is path_tracer.INTEGRATOR


def is_guided(shader: Choice) -> bool:
    """Whether the integrator samples directions by an SD-tree as well."""
    return shader.plugin is None and shader.options.get("guiding", "none") == "sd_tree"


def with_integrator(features: SceneFeatures, shader: Choice) -> SceneFeatures:
    """The features, with those that options of the integrator bring."""
    if not traces_paths(shader):
        return features._replace(media=False)
    volumetric = shader.name == "volumetric_path_tracer"
    shines = features.emission or bool({CONSTANT_ENVIRONMENT, IMAGE_ENVIRONMENT} & {*features.lights})
    return features._replace(
        media=volumetric and features.media,
        transparent=(volumetric or shader.options["transparent_shadows"]) and features.null_lobes,
        hidden_emitters=shader.options["hide_emitters"] and shines,
        guided=is_guided(shader),
    )


def option_numbers(shader: Choice, bounds: NDArray[np.float64], center: NDArray[np.float64]) -> NDArray[np.float64]:
    """The integrator's options (8,) as numbers: max_depth, then what its step reads."""
    row = np.zeros(SHADER_OPTIONS)
    options = shader.options
    if shader.plugin is not None:
        numbers = support.option_numbers(options)
        row[: len(numbers)] = numbers
        return row
    row[MAX_DEPTH] = options.get("max_depth", 1)
    if traces_paths(shader):
        row[path_tracer.RR_DEPTH] = first_roulette(shader)
        row[path_tracer.DIRECT_OPTION] = path_tracer.DIRECT[options["direct"]]
        row[path_tracer.LIGHT_CANDIDATES] = light_candidates(shader)
    elif shader.name in ("whitted", "no_shadows"):
        row[whitted.AMBIENT] = options["ambient"]
    elif shader.name == "depth_map":
        # NaN where there is no finite shape, and then the image is black
        corner = bounds[1] if options["max_point"] is None else options["max_point"]
        row[aov.MAX_POINT : aov.MAX_POINT + 3] = np.subtract(corner, center)
    return row


def first_roulette(shader: Choice) -> int:
    """The depth from which on the path tracer plays roulette: one vertex later in `volumetric_path_tracer`."""
    return shader.options["rr_depth"] + (1 if shader.name == "volumetric_path_tracer" else 0)


def last_depth(shader: Choice, features: SceneFeatures) -> int:
    """The depth from which on the integrator reads of a vertex its emission alone, as it does of a miss; 0 where it may read
    more of any."""
    if features.transparent or features.hidden_emitters:
        return 0
    return int(shader.options["max_depth"]) if traces_paths(shader) else 0


def wanted_draws(shader: Choice, features: SceneFeatures) -> int:
    """A bit for each draw of a vertex, from `POINT_U0` to `ROULETTE`, that the integrator may use in a scene of these
    features."""
    if shader.plugin is not None:
        return (1 << VERTEX_DRAWS) - 1
    light = 1 << POINT_U0 | 1 << POINT_U1 | (1 << LIGHT if features.many_lights or features.mesh_lights else 0)
    if not traces_paths(shader):
        return light | (1 << LOBE if features.choices else 0)
    several = features.lobes or features.specular_reflection or features.specular_transmission or features.choices
    several = several or is_guided(shader)
    lobe = 1 << LOBE if several else 0
    ends = light_candidates(shader) > 1 or first_roulette(shader) < shader.options["max_depth"]
    return light | lobe | 1 << DIRECTION_U0 | 1 << DIRECTION_U1 | (1 << ROULETTE if ends else 0)


class ShadeFeatures(NamedTuple):
    """What the stage of an integrator is compiled for, besides the features of the scene's BSDFs."""

    lit: bool
    """There are lights to sample."""
    every: bool
    """The step is called once for each light."""
    branches: bool
    """Two rays may follow from one hit."""
    shadows: bool
    through: bool
    """Light samples may lie on the far side of a surface that transmits their light."""
    curved: tuple[int, ...]
    """Kinds of shapes, besides spheres, that a ray which leaves one may meet again."""
    instances: bool
    transparent: bool
    """Null lobes are crossed freely, with shadow rays too."""
    hides: bool
    """Emitters hide from the camera, and are crossed freely then."""
    keeps_eta_scale: bool
    """`Path.eta_scale` is kept."""
    media: bool
    """Vertices may lie in media."""


@inline
def _store_shadow_ray(rays, lane, si, light, direct, offset, share, working, shading):
    """What waits for the shadow ray, and the ray: aimed anew from where it starts, since a parallel one would meet a
    light that is seen from the side too early. It starts on the side of the surface where the light is."""
    step = offset
    if shading.through:
        step = select(dot(si.geometric_normal, light.wi) < 0.0, -offset, offset)
    rays.shadow.origin[lane] = si.point + si.geometric_normal * step
    zero, infinite = const(0.0, offset), const(math.inf, offset)
    sent = working & (not ((direct.x <= zero) & (direct.y <= zero) & (direct.z <= zero)))  # NaN is sent, to be counted
    rays.shadow.direct[lane] = select(sent, direct, Vec3(zero, zero, zero))
    aim = light.wi * light.distance - si.geometric_normal * step
    way, endless = length(aim), light.distance == infinite
    rays.shadow.direction[lane] = select(endless, light.wi, aim * (1.0 / way))
    if shading.transparent:
        rays.shadow.destination[lane] = si.point + light.wi * light.distance
    way = select(endless, infinite, way * share - offset)
    rays.shadow.t_max[lane] = select(sent & shading.shadows, way, -1.0)


@inline
def _no_primitive():
    return np.int64(-1)


@cache
def make_leave(curved: tuple[int, ...], instances: bool) -> Any:
    """The function (rays, lane) that keeps the id of the flat primitive that the lane's ray leaves, -1 for none. (Of a sphere
    the id does no harm: nobody asks.) And its instance, in scenes with `instances`."""
    unless_curved = dispatch(tuple((kind, _no_primitive) for kind in curved))

    @inline
    def leave(rays, lane):
        rays.origin_primitive[lane] = unless_curved(rays.hit.shape[lane], np.int64(rays.primitive[lane]))
        if instances:
            rays.origin_instance[lane] = rays.instance[lane]

    return leave


@inline
def _store_next_ray(rays, lane, si, path, result, goes, offset, per_vertex, following, depth, leave):
    """The ray that goes on, from the side of the surface on which it leaves."""
    step = select(result.transmitted, -offset, offset)
    rays.origin[lane] = select(goes, si.point + si.geometric_normal * step, si.origin)
    rays.direction[lane] = select(goes, result.direction, si.direction)
    rays.path.throughput[lane] = select(goes, result.throughput, path.throughput)
    rays.path.pdf[lane] = select(goes, result.pdf, path.pdf)
    rays.cosine_pdf[lane] = cosine_pdf(si.normal, result.direction)
    leave(rays, lane)
    depth = select(goes, depth + 1, depth)
    rays.path.depth[lane] = depth
    rays.dimension[lane] = CAMERA_DIMENSIONS + VERTEX_DIMENSIONS * ((depth - 1) * per_vertex + following)
    rays.t[lane] = select(goes, math.inf, -1.0)


@inline
def _store_crossing_ray(rays, lane, si, path, result, crosses, null, goes, offset, depth, leave):
    """`_store_next_ray` where rays may cross surfaces that are no vertices: depth and last vertex stay where one `crosses`."""
    dimension = rays.dimension[lane]
    first, pdf = dimension == CAMERA_DIMENSIONS, rays.cosine_pdf[lane]
    crossed = select(first, 0.0, rays.crossing.way[lane]) + si.t
    rays.crossing.way[lane] = select(goes & crosses, crossed, 0.0)
    rays.crossing.scattered[lane] = goes & ((rays.crossing.scattered[lane] & (not first)) | (not null))
    rays.crossing.point[lane] = select(crosses, rays.crossing.point[lane], si.point)
    rays.crossing.normal[lane] = select(crosses, rays.crossing.normal[lane], si.geometric_normal)
    _store_next_ray(rays, lane, si, path, result, goes, offset, 1, 0, depth, leave)
    rays.cosine_pdf[lane] = select(crosses, pdf, rays.cosine_pdf[lane])
    rays.path.depth[lane] = select(crosses, depth, rays.path.depth[lane])
    rays.dimension[lane] = dimension + VERTEX_DIMENSIONS


@inline
def _has_crossed_many(rays, lane, depth, crosses):
    """Whether a path would cross its null lobe number `MOST_NULL_LOBES`: the rays that it has had, less its segments."""
    earlier = (rays.dimension[lane] - CAMERA_DIMENSIONS) // VERTEX_DIMENSIONS + 1 - depth
    return crosses & (earlier + 1 >= MOST_NULL_LOBES)


@inline
def _store_media(rays, lane, si, light, result, goes, offset, shading):
    """The media into which the next ray and the shadow ray go, and how far from the surface they start along their way."""
    near, far, before = rays.flight.near[lane], rays.flight.far[lane], rays.flight.medium[lane]
    rays.flight.medium[lane] = select(goes, select(result.transmitted, far, near), before)
    rays.flight.lead[lane] = offset * abs(dot(si.geometric_normal, result.direction))
    if shading.lit:
        beyond, sent = dot(si.geometric_normal, light.wi) < 0.0, rays.shadow.t_max[lane] > 0.0
        lead = offset * abs(dot(si.geometric_normal, rays.shadow.direction[lane]))
        rays.attenuation[lane] = Attenuation(select(beyond, far, near), lead, select(sent, light.distance, 0.0))


@inline
def _scattering_at(rays, lane, si, path, draws, bsdf, in_medium):
    """That of the BSDF, or of the medium's phase function."""
    g, one = rays.flight.g[lane], const(1.0, si.t)
    value = phase(g, si.direction, rays.light_sample.wi[lane])
    wi, pdf = sample_phase(g, si.direction, draws.u0, draws.u1)
    sample = BSDFSample(wi, Spectrum(WHITE, one), pdf, False, largest(path.throughput) > 0.0)
    return Scattering(
        select(in_medium, Spectrum(WHITE, value), bsdf.value),
        select(in_medium, value, bsdf.pdf),
        select(in_medium, sample, bsdf.sample),
        bsdf.reflection,
        bsdf.transmission,
        bsdf.diffuse,
        bsdf.albedo,
        bsdf.through & (not in_medium),
        bsdf.null & (not in_medium),
        select(in_medium, one, bsdf.eta_scale),
    )


class Vertex(NamedTuple):
    """One lane before its step."""

    working: bool
    depth: int
    si: SurfaceInteraction
    light: LightSample
    path: Path


@inline
def _load(rays, scene, lane, shading, real):
    none, path = Vec3(real(0), real(0), real(0)), rays.path[lane]
    light = LightSample(none, real(0), none, real(0))
    if shading.lit:
        light = rays.light_sample[lane]
    seen = Path(path.throughput, real(path.depth), path.pdf, path.eta_scale if shading.keeps_eta_scale else real(1))
    return Vertex(rays.alive[lane], path.depth, load_interaction(rays, scene, lane), light, seen)


@inline
def _store(rays, lane, before, result, crosses, null, n_lights, shading, leave, share, real):
    """What the lane does next."""
    working, depth, si = before.working, before.depth, before.si
    light, per_vertex, stays = np.int64(0), np.int64(1), False
    if shading.every:
        per_vertex, light = n_lights, np.int64(rays.light_index[lane])
        stays = light + 1 < n_lights
    added = select(working & (light == 0), result.radiance, Vec3(real(0), real(0), real(0)))
    rays.radiance[lane] = rays.radiance[lane] + added
    offset = rays.hit.offset[lane]
    if shading.lit:
        _store_shadow_ray(rays, lane, si, before.light, result.direct, offset, share, working, shading)
    ends, alive = working & (not stays), result.alive
    if shading.transparent or shading.hides:
        alive = alive & (not _has_crossed_many(rays, lane, depth, crosses))
    goes = ends & alive
    rays.done[lane] = ends & (not alive)
    if shading.branches:
        there, origin = goes & result.branch, si.point + si.geometric_normal * offset
        rays.branch[lane] = Branch(there, origin, result.branch_direction, result.branch_throughput)
    if shading.media:
        _store_media(rays, lane, si, before.light, result, goes, offset, shading)
    if shading.transparent or shading.hides:
        _store_crossing_ray(rays, lane, si, before.path, result, crosses, null, goes, offset, depth, leave)
        return
    following = select(stays, light + 1, 0)
    _store_next_ray(rays, lane, si, before.path, result, goes, offset, per_vertex, following, depth, leave)
    if shading.every:
        rays.t[lane] = select(stays, si.t, rays.t[lane])  # the vertex is shaded once more, by the next light


@inline
def _eight_options(scene, real):
    numbers = scene.options
    return (
        real(numbers[0]),
        real(numbers[1]),
        real(numbers[2]),
        real(numbers[3]),
        real(numbers[4]),
        real(numbers[5]),
        real(numbers[6]),
        real(numbers[7]),
    )


def _make(step: Any, scattering: Any, shading: ShadeFeatures, real: Any) -> Any:
    leave, transparent, hides = make_leave(shading.curved, shading.instances), shading.transparent, shading.hides
    media = shading.media

    def shade(batch, scene_address):
        rays, scene = ray_batch(batch, real), scene_table(scene_address, real)
        options, n_lights = _eight_options(scene, real), scene.n_lights
        share = real(scene.margins[0].shadow_share)
        for lane in range(np.uint64(LANES)):
            before, draws = _load(rays, scene, lane, shading, real), load_draws(rays, lane)
            bsdf = scattering(rays, lane, before.si, draws)
            if media:
                in_medium = rays.hit.kind[lane] == MEDIUM
                bsdf = _scattering_at(rays, lane, before.si, before.path, draws, bsdf, in_medium)
                crosses = bsdf.null if transparent else hides and rays.crossing.absent[lane]
                result = step(before.si, before.light, bsdf, draws, before.path, options, crosses, in_medium)
                _store(rays, lane, before, result, crosses, bsdf.null, n_lights, shading, leave, share, real)
                rays.cosine_pdf[lane] = select(in_medium, real(SPHERE_PDF), rays.cosine_pdf[lane])
            elif transparent or hides:
                crosses = bsdf.null if transparent else rays.crossing.absent[lane]
                result = step(before.si, before.light, bsdf, draws, before.path, options, crosses)
                _store(rays, lane, before, result, crosses, bsdf.null, n_lights, shading, leave, share, real)
            else:
                result = step(before.si, before.light, bsdf, draws, before.path, options)
                _store(rays, lane, before, result, False, False, n_lights, shading, leave, share, real)
            if shading.keeps_eta_scale:
                rays.path.eta_scale[lane] = before.path.eta_scale * bsdf.eta_scale

    return shade


def curved_shapes(features: SceneFeatures) -> tuple[int, ...]:
    """Kinds of shapes, besides spheres, that a ray which leaves one may meet again."""
    return tuple(kind for kind in features.analytic if analytic_shape(kind).curved)


def shade_features(integrator: Integrator, features: SceneFeatures) -> ShadeFeatures:
    """What the stage of `integrator` is compiled for in a scene of these features."""
    lit = integrator.lit and len(features.lights) > 0
    both = features.specular_reflection and (features.specular_transmission or features.masks)
    branches = integrator.branches or (integrator.branches_at_specular and both)
    through = lit and features.transmission
    bends = integrator.roulette and keeps_eta_scale(features)
    return ShadeFeatures(
        lit,
        lit and integrator.every_light,
        branches,
        integrator.shadows,
        through,
        curved_shapes(features),
        features.instances,
        features.transparent,
        features.hidden_emitters,
        bends,
        features.media,
    )


def uses(integrator: Integrator, shading: ShadeFeatures) -> Uses:
    """What the integrator reads of the BSDF, in a scene that may have no lights."""
    return integrator.uses._replace(value=integrator.uses.value and shading.lit)


def stage(integrator: Integrator, shading: ShadeFeatures, features: SceneFeatures, real: Any) -> Any:
    """The shade stage of an integrator."""
    step = integrator.crossing_step if shading.transparent or shading.hides else integrator.step
    step = integrator.medium_step if shading.media else step
    return _stage(step, make_scattering(features, uses(integrator, shading)), shading, real)


@cache
def _stage(step: Any, scattering: Any, shading: ShadeFeatures, real: Any) -> Any:
    return compile_stage(_make(step, scattering, shading, real))

"""The light sample at a surface: which light, where on it, and what arrives (docs/transport.md)."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from engines.kernels.compile.dispatch import dispatch
from engines.kernels.compile.jit import compile_stage, inline
from engines.kernels.compile.masks import EVERY_LANE, has_lane, lane_bit, lanes_where
from engines.kernels.compile.records import address_of, lane_numbers, prefetch
from engines.kernels.compile.values import keep_scalar, lowest_bit, select
from engines.kernels.features import SceneFeatures
from engines.kernels.flatten.lights import CONSTANT_ENVIRONMENT, IMAGE_ENVIRONMENT, MESH, MODELS
from engines.kernels.integrators.path_tracer import LIGHT_CANDIDATES
from engines.kernels.lane.lights import Light, LightSample, sample_environment_all_around
from engines.kernels.lane.vector import Vec3, to_real
from engines.kernels.layout import LANES, LIGHT, MISS, POINT_U0, POINT_U1, RUN, ray_batch, scene_table
from engines.kernels.rows import LightRow, MaterialRow, PrimitiveRow
from engines.kernels.stages import emission, environment, light_cells, light_frames, light_hierarchy, resampling
from engines.kernels.stages.environment import guide_entry
from engines.kernels.stages.hit_loads import lane_number, make_load_face, make_load_rows

COLOR = LightRow.fields["color"].first
"""In a row of a light, as at the beginning of one of a material: a colour and whether both sides emit."""


class Selection(NamedTuple):
    """Which light of the scene's a lane samples."""

    every: bool
    """The lane's own: integrators visit all."""
    many: bool
    """One of several."""
    power: bool
    """That one in proportion to power."""
    hierarchy: bool
    """That one by the hierarchy."""
    cells: bool
    """That one by cells."""
    media: bool
    """Vertices may lie in media, where there is no normal."""


@cache
def _make_choose(selection: Selection) -> Any:
    """The function (rays, lane, scene) -> (index of the lane's light, -1 for none; what is left of the random number)."""
    every, many, power, hierarchy, cells, _ = selection

    @inline
    def choose_light(rays, lane, scene):
        rest = np.float64(rays.draw[LIGHT, lane])
        chosen, n = np.int64(0), scene.n_lights
        if every:
            chosen = np.int64(rays.light_index[lane])
        elif power:
            chosen, rest = _by_power(scene, n, rest)
            rays.light_inverse_pmf[lane] = scene.light_inverse_pmf[chosen]
        elif hierarchy or cells:
            chosen = np.int64(rays.chosen_light[lane])
        elif many:
            scaled = rest * n
            chosen = max(min(np.int64(scaled), n - 1), 0)  # a draw that is NaN must not leave the list
            rest = scaled - chosen
        return chosen, rest

    return choose_light


@inline
def _by_power(scene, n, u):
    shares = scene.light_cumulative
    chosen = np.int64(environment.first_above(shares, 0, n, u))
    below = shares[chosen - 1] if chosen > 0 else 0.0
    return chosen, (u - below) / (shares[chosen] - below)


@cache
def _make_load(kinds: tuple[int, ...], selection: Selection, real: Any) -> Any:
    """The function (rays, scene) that chooses each lane's light, of a mesh a face, and copies what the scene holds of it."""
    load_lights, meshes, hierarchy, cells = _make_load_lights(kinds), MESH in kinds, selection.hierarchy, selection.cells
    choose_light, choose_all = _make_choose(selection), light_hierarchy.make_choose(selection.media, real)

    @inline
    def load(rays, scene):
        if hierarchy:
            choose_all(rays, scene)
        if cells:
            light_cells.choose(rays, scene)
        for lane in range(np.uint64(LANES)):
            chosen, rest = choose_light(rays, lane, scene)
            rays.chosen_light[lane] = chosen
            rays.light_row[lane] = select(chosen < 0, np.int64(0), chosen)
            rays.light_rest[0, lane] = rest
        load_lights(rays, address_of(scene.lights), EVERY_LANE)
        for lane in range(np.uint64(LANES)):
            kind = np.int32(rays.light_row_kind[lane])
            rays.light_kind[lane] = select(rays.chosen_light[lane] < 0, np.int32(-1), kind)
        if meshes:
            lanes = _on_meshes(rays.light_kind)
            if lanes != 0:
                _load_faces(rays, scene, lanes)

    return load


@cache
def _make_load_lights(kinds: tuple[int, ...]) -> Any:
    """The function (rays, address, lanes) that copies rows of lights: the kind is a number of the row."""
    parameters = max(MODELS[kind].parameters for kind in kinds)
    first = LightRow.fields["parameters"].first
    columns = [LightRow.fields["kind"].first, *(COLOR + k for k in range(4)), *(first + k for k in range(parameters))]
    targets = [lane_number("light_row_kind"), *_COLOR_AND_SIDES]
    targets += [lane_number("light_parameters") + k for k in range(parameters)]
    return make_load_rows("light_row", LightRow, tuple(columns), tuple(targets))


_COLOR_AND_SIDES = (*(lane_number("light_color") + k for k in range(3)), lane_number("light_two_sided"))
_on_meshes, _load_face = lanes_where("==", MESH), make_load_face("light_face")
_load_primitives = make_load_rows(
    "light_primitive",
    PrimitiveRow,
    (PrimitiveRow.fields["index"].first, PrimitiveRow.fields["material"].first),
    (lane_number("light_face.corner0"), lane_number("light_material")),
)
_load_emission = make_load_rows("light_material", MaterialRow, (0, 1, 2, 3), _COLOR_AND_SIDES)


@inline
def _load_faces(rays, scene, lanes):
    """A face of each lane's mesh, chosen in proportion to its area, and its emission in the lanes of the word. Where a light is
    no mesh, the first face of all is read: a branch would be taken by chance."""
    for lane in range(np.uint64(LANES)):
        keep_scalar()
        faces, rest = scene.light_ranges[np.int64(rays.light_row[lane])], rays.light_rest[0, lane]
        first = np.int64(faces.first)
        chosen = environment.first_above_in(scene.light_cdf, first, np.int64(faces.count), scene.light_steps, rest)
        rays.light_primitive[lane] = scene.light_faces[first + chosen]
    _load_primitives(rays, address_of(scene.primitives), EVERY_LANE)
    _load_face(rays, scene)
    _load_emission(rays, address_of(scene.materials), lanes)


@cache
def _make_sample_one(kinds: tuple[int, ...], selection: Selection, turned: bool, real: Any) -> Any:
    """The function (rays, scene) that stores one light sample per lane."""
    zero, one, infinite = real(0), real(1), real(np.inf)
    load = _make_load(kinds, selection, real)
    weighted = selection.power or selection.hierarchy or selection.cells
    samples = {kind: MODELS[kind].sample for kind in kinds if kind != IMAGE_ENVIRONMENT}
    if selection.media and CONSTANT_ENVIRONMENT in samples:
        samples[CONSTANT_ENVIRONMENT] = sample_environment_all_around
    sample_light = dispatch(tuple(samples.items()))
    image_environment, real_bytes = IMAGE_ENVIRONMENT in kinds, np.dtype(real).itemsize

    @inline
    def sample_one(rays, scene):
        load(rays, scene)
        pmf = one / real(scene.light_choices)
        environment_pmf = pmf
        if weighted:
            environment_pmf = one / scene.light_inverse_pmf[scene.environment_light]
        for lane in range(np.uint64(LANES)):
            if weighted:
                pmf = one / rays.light_inverse_pmf[lane]
            light = Light(
                lane_numbers(rays.light_parameters, lane),
                rays.light_color[lane],
                rays.light_two_sided[lane],
                rays.light_face.vertex0[lane],
                rays.light_face.vertex1[lane],
                rays.light_face.vertex2[lane],
            )
            sample = LightSample(Vec3(zero, zero, one), infinite, Vec3(zero, zero, zero), infinite)
            u0, u1 = rays.draw[POINT_U0, lane], rays.draw[POINT_U1, lane]
            sample = sample_light(rays.light_kind[lane], sample, light, rays.hit.point[lane], rays.hit.normal[lane], u0, u1)
            rays.light_sample[lane] = LightSample(sample.wi, sample.distance, sample.radiance * (one / pmf), sample.pdf * pmf)
        if image_environment:
            _image_environment(rays, scene, environment_pmf, turned, real_bytes, real)

    return sample_one


@cache
def _make_colored(sample_one: Any, color_samples: Any) -> Any:
    @inline
    def sample(rays, scene):
        sample_one(rays, scene)
        color_samples(rays, scene)

    return sample


def _make(
    kinds: tuple[int, ...], selection: Selection, turned: bool, resampled: bool, colors: tuple[Any, ...], real: Any
) -> Any:
    sample_one = _make_sample_one(kinds, selection, turned, real)
    for color_samples in colors:
        sample_one = _make_colored(sample_one, color_samples)

    def light_stage(batch, scene_address):
        rays, scene = ray_batch(batch, real), scene_table(scene_address, real)
        if not resampled:
            sample_one(rays, scene)
            return
        count = np.int64(scene.options[LIGHT_CANDIDATES])
        resampling.keep_draws(rays)
        for k in range(count):
            resampling.choose_all(rays, k)
            resampling.draw_candidates(rays, count, real)
            sample_one(rays, scene)
            resampling.store_targets(rays, scene, k, selection.media, real)
        resampling.pick(rays, count, real)
        resampling.draw_candidates(rays, count, real)
        sample_one(rays, scene)
        resampling.weigh(rays, count, real)

    return light_stage


@inline
def _lanes_on_environment(rays):
    """A word with a bit for each lane that has chosen the environment and is at a vertex."""
    lanes = np.int64(0)
    for lane in range(np.uint64(LANES)):
        chosen = (rays.light_kind[lane] == IMAGE_ENVIRONMENT) & rays.alive[lane] & (rays.hit.kind[lane] != MISS)
        lanes |= lane_bit(lane, chosen)
    return lanes


@inline
def _choose_places(rays, scene, axes, lanes, real_bytes):
    """Keeps (u, v) on the environment's image, drawn by texel, and the density there. Hardly a table of a large image is in a
    near cache: each loop prefetches what the next one reads."""
    rows, runs, densities = scene.environment_rows, scene.environment_runs, scene.environment_pdf
    guide, width, height = scene.environment_run_guide, scene.environment_width, scene.environment_height
    in_row = (width + RUN - 1) // RUN
    todo = lanes
    while todo != 0:
        lane = np.uint64(lowest_bit(todo))
        todo &= todo - 1
        u0, u1 = np.float64(rays.draw[POINT_U0, lane]), np.float64(rays.draw[POINT_U1, lane])
        row = environment.first_above_from(rows, 0, scene.environment_row_guide[guide_entry(height, u1)], height, u1)
        below = rows[row - 1] if row > 0 else 0.0
        rays.environment_place[1, lane] = (row + (u1 - below) / (rows[row] - below)) / height
        rays.environment_row[lane] = row
        entry = row * in_row + guide_entry(in_row, u0)
        prefetch(address_of(guide) + 2 * entry)
        prefetch(address_of(runs) + 8 * entry)
        prefetch(address_of(runs) + 8 * (row * in_row + in_row - 1))
    todo = lanes
    while todo != 0:
        lane = np.uint64(lowest_bit(todo))
        todo &= todo - 1
        row, u0 = np.int64(rays.environment_row[lane]), np.float64(rays.draw[POINT_U0, lane])
        start = row * in_row
        sought = u0 * runs[start + in_row - 1]
        run = environment.first_above_from(runs, start, guide[start + guide_entry(in_row, u0)], in_row, sought)
        rays.environment_column[lane] = RUN * run
        # u, once the texel is known; until then what of the sum is left
        rays.environment_place[0, lane] = sought - (runs[start + run - 1] if run > 0 else 0.0)
        first = address_of(densities) + real_bytes * (row * width + RUN * run)
        prefetch(first)
        prefetch(first + real_bytes * RUN - 1)
    todo = lanes
    while todo != 0:
        lane = np.uint64(lowest_bit(todo))
        todo &= todo - 1
        column, sought = np.int64(rays.environment_column[lane]), rays.environment_place[0, lane]
        start, last = np.int64(rays.environment_row[lane]) * width, min(column + RUN, width) - 1
        density = np.float64(densities[start + column])
        while column < last and not sought < density:
            sought -= density
            column += 1
            density = np.float64(densities[start + column])
        # rounding can lead beyond the last texel, which may be black
        u = (column + (sought / density if sought < density else 1.0)) / width
        rays.environment_place[0, lane] = u
        rays.light_sample.pdf[lane] = density
        environment.prefetch_texels(scene, axes, u, rays.environment_place[1, lane], real_bytes)


@inline
def _image_environment(rays, scene, pmf, turned, real_bytes, real):
    """Samples of the environment's image replace what the vector loop left in the lanes that chose it and are at a
    vertex."""
    lanes = _lanes_on_environment(rays)
    if lanes == 0:
        return
    axes, width, height = scene.environment_map[0], scene.environment_width, scene.environment_height
    _choose_places(rays, scene, axes, lanes, real_bytes)
    for lane in range(np.uint64(LANES)):
        wi, sine = environment.uv_to_direction(rays.environment_place[0, lane], rays.environment_place[1, lane])
        if turned:
            wi = environment.to_scene(axes, wi)
        rays.environment_place[2, lane] = sine
        rays.light_sample.wi[lane] = select(has_lane(lanes, lane), to_real(wi, real), rays.light_sample.wi[lane])
    while lanes != 0:
        lane = np.uint64(lowest_bit(lanes))
        lanes &= lanes - 1
        u, v, sine = rays.environment_place[0, lane], rays.environment_place[1, lane], rays.environment_place[2, lane]
        radiance = environment.radiance(scene.environment, environment.texels_at(width, height, axes, u, v))
        pdf = environment.pdf_solid_angle(np.float64(rays.light_sample.pdf[lane]), sine) * np.float64(pmf)
        rays.light_sample.distance[lane] = real(np.inf)
        rays.light_sample.radiance[lane] = radiance * (1.0 / pdf if pdf > 0.0 else 0.0)
        rays.light_sample.pdf[lane] = pdf


def stage(features: SceneFeatures, every: bool, resampled: bool, real: Any) -> Any:
    """The light stage; `every`: the lane's own light of all, instead of one chosen at random; `resampled`: the sample is one
    of several candidates."""
    many = features.many_lights and not every
    ways = features.power_lights, features.light_hierarchy, features.light_cells
    selection = Selection(every, many, *(many and way for way in ways), features.media)
    colors = (emission.make_light_samples(features, real),) if features.textured_emission else ()
    colors += (light_frames.make_light_samples(real),) if features.light_frames else ()
    return _stage(features.lights, selection, features.turned_environment, resampled, colors, real)


@cache
def _stage(
    kinds: tuple[int, ...], selection: Selection, turned: bool, resampled: bool, colors: tuple[Any, ...], real: Any
) -> Any:
    return compile_stage(_make(kinds, selection, turned, resampled, colors, real))

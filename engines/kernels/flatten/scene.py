"""A scene as arrays, and the table of addresses through which stages read them (`engines.kernels.layout.SceneTable`)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.kernels.compile.records import Field
from engines.kernels.features import SceneFeatures
from engines.kernels.flatten import environment
from engines.kernels.flatten.instances import instance_rows
from engines.kernels.flatten.lights import MESH, LightList, frame_rows
from engines.kernels.flatten.media import medium_rows, medium_sides
from engines.kernels.flatten.programs import Programs
from engines.kernels.flatten.shapes import Begin, Geometry, collapse_degenerate
from engines.kernels.layout import SLOTS, SceneTable
from engines.kernels.rows import LeafRow, LightRow, LookupRow, PrimitiveRow
from engines.scene import Instance, Mesh, Scene, singles


@dataclass(slots=True)
class FlatScene:
    """Arrays of one scene in one precision, by their fields in `SceneTable`. Indices are int32."""

    real: type
    center: NDArray[np.float64]
    features: SceneFeatures
    first_id: NDArray[np.int64]
    """(shapes,) id of the first primitive of each shape that is no instance, those of groups at the end."""
    bounds: NDArray[np.float64]
    """(2, 3) box of all finite shapes, in scene coordinates; NaN where there are none."""
    places: NDArray[np.int64]
    """Places among the scene's shapes of those that are no instances."""
    begins: list[Begin]
    """See `Geometry`."""
    boxes: list[NDArray[np.float64]]
    """(2, 3) of each group, in its own tracing coordinates."""
    arrays: dict[Any, NDArray[Any]] = field(default_factory=dict)
    table: NDArray[np.int64] = field(default_factory=lambda: np.zeros(SLOTS, np.int64))
    owned: list[Any] = field(default_factory=list)
    """Other objects whose memory the table leads to: they live as long as the scene."""
    texture_bytes: int = 0

    def bind(self, slot: Any, value: NDArray[Any] | int) -> None:
        """Puts an array (which is kept alive) or a number into a field of the table."""
        assert isinstance(slot, Field)
        if isinstance(value, np.ndarray):
            self.arrays[slot] = value = np.ascontiguousarray(value)
            self.table[slot.first] = value.ctypes.data
        else:
            self.table[slot.first] = value

    def part(self, number: int) -> FlatScene:
        """The shapes outside of groups and the instances (0), or the shapes of a group (from 1 on), as a scene by themselves;
        vertices are those of the whole scene, and so are all ids."""
        if not self.features.instances:
            return self
        table, begin, end = SceneTable, self.begins[number], self.begins[number + 1]
        placed = {} if number == 0 else {"bounds": self.boxes[number - 1], "center": np.zeros(3)}
        part = replace(self, arrays=dict(self.arrays), table=self.table.copy(), begins=[begin, end], owned=[], **placed)
        for slots, first, last in (
            ((table.triangles, table.triangle_primitives), begin.triangles, end.triangles),
            ((table.spheres, table.sphere_primitives), begin.spheres, end.spheres),
            ((table.analytic, table.analytic_primitives, table.analytic_bounds), begin.analytic, end.analytic),
            ((table.instance_bounds,), 0, len(self.arrays[table.instances]) if number == 0 else 0),
        ):
            for slot in slots:
                part.bind(slot, self.arrays[slot][first:last])
        return part

    @property
    def address(self) -> int:
        return self.table.ctypes.data

    @property
    def bytes(self) -> int:
        return sum(array.nbytes for array in self.arrays.values()) + self.texture_bytes


def flatten(scene: Scene, real: type, tracing: type) -> FlatScene:
    """The arrays of `scene` in precision `real` (np.float32 or np.float64), for an intersector of precision `tracing`."""
    geometry = Geometry(scene.shapes)
    bounds = geometry.bounds()
    center = _recentre(bounds, tracing)
    centers = [center, *(_recentre(group.box, tracing) for group in geometry.groups)]
    lights = LightList(scene, geometry.first_id, geometry.n, center)
    used = np.flatnonzero(np.bincount(geometry.joined(geometry.material)))
    programs = Programs(scene.materials, used, geometry.materials_on_uvs(), geometry.attribute_rows)
    frames = frame_rows(scene.lights, programs.texture)
    features = _features(scene, geometry, lights, programs, frames)
    places = np.array([k for k, shape in enumerate(scene.shapes) if not isinstance(shape, Instance)], np.int64)
    boxes = [group.box - origin for group, origin in zip(geometry.groups, centers[1:], strict=True)]
    first_id = np.array(geometry.first_id, np.int64)
    flat = FlatScene(real, center, features, first_id, bounds, places, geometry.begins, boxes)
    _bind_shapes(flat, geometry, centers)
    flat.bind(SceneTable.n_instances, len(geometry.instances))
    flat.bind(SceneTable.instances, instance_rows(scene.shapes, geometry, centers))
    flat.bind(SceneTable.instance_bounds, (geometry.instance_boxes() - center).reshape(-1, 6))
    _bind_surfaces(flat, geometry, lights, programs)
    _bind_programs(flat, geometry, programs)
    _bind_lights(flat, lights, frames)
    if scene.media:
        flat.bind(SceneTable.media, medium_rows(scene.media, real))
        flat.bind(SceneTable.medium_sides, medium_sides(scene.shapes, geometry.first_id, geometry.n, len(scene.media)))
    return flat


def _recentre(bounds: NDArray[np.float64], tracing: type) -> NDArray[np.float64]:
    """Where the origin of the tracing coordinates lies. A mesh far from the origin loses all precision in float32."""
    middle, half = bounds.mean(axis=0), np.ptp(bounds, axis=0).max() / 2
    far = np.abs(middle).max() > 4 * half
    return middle if far and half > 0 and tracing == np.float32 else np.zeros(3)


def _features(
    scene: Scene, geometry: Geometry, lights: LightList, programs: Programs, frames: list[list[float]]
) -> SceneFeatures:
    return SceneFeatures(
        triangles=geometry.counts["triangles"] > 0,
        spheres=geometry.counts["spheres"] > 0,
        planes=geometry.counts["planes"] > 0,
        analytic=geometry.analytic_kinds(),
        instances=bool(geometry.instances),
        smooth=any(isinstance(s, Mesh) and s.normals is not None for _, s in singles(scene.shapes)),
        lights=lights.kinds(),
        many_lights=len(lights.rows) > 1,
        mesh_lights=MESH in lights.kinds(),
        light_frames=len(frames) > 0,
        turned_environment=environment.is_turned(lights.environment),
        media=bool(scene.media),
        **programs.features(),
    )


def _bind_shapes(flat: FlatScene, geometry: Geometry, centers: list[NDArray[np.float64]]) -> None:
    table, join, zeros = SceneTable, geometry.joined, np.zeros(3)
    flat.bind(table.n_triangles, geometry.counts["triangles"])
    flat.bind(table.n_spheres, geometry.begins[1].spheres)
    flat.bind(table.n_planes, geometry.counts["planes"])
    flat.bind(table.n_analytic, geometry.begins[1].analytic)
    flat.bind(table.vertices, geometry.relative("vertices", join(geometry.vertices), centers).astype(flat.real))
    flat.bind(table.vertex_normals, join(geometry.normals).astype(flat.real))
    flat.bind(table.triangles, np.array(join(geometry.faces)))
    collapse_degenerate(flat.arrays[table.triangles], flat.arrays[table.vertices])
    flat.bind(table.spheres, geometry.relative("spheres", join(geometry.spheres), centers))
    flat.bind(table.planes, join(geometry.planes) - np.append(flat.center, zeros))
    flat.bind(table.analytic, geometry.analytic_rows(centers))
    flat.bind(table.analytic_bounds, np.hstack(geometry.analytic_bounds(centers)))
    for slot, name in (
        (table.triangle_primitives, "triangles"),
        (table.sphere_primitives, "spheres"),
        (table.plane_primitives, "planes"),
        (table.analytic_primitives, "analytic"),
    ):
        flat.bind(slot, join(geometry.ids[name]))


def _bind_surfaces(flat: FlatScene, geometry: Geometry, lights: LightList, programs: Programs) -> None:
    """The arrays that lead from a primitive's id to its geometry, material and light."""
    join = geometry.joined
    flat.bind(SceneTable.materials, programs.material_rows().astype(flat.real))
    if len(programs.tables) > 1:
        flat.bind(SceneTable.bsdf_tables, np.array(programs.tables, flat.real))
    primitives = np.zeros((max(geometry.n, 1), PrimitiveRow.size), np.int32)  # a row to read where every ray misses
    columns = (join(geometry.kind), join(geometry.index), join(geometry.material), lights.of_primitive)
    for column, values in enumerate(columns):
        primitives[: geometry.n, column] = values
    flat.bind(SceneTable.primitives, primitives)


def _bind_programs(flat: FlatScene, geometry: Geometry, programs: Programs) -> None:
    """Programs, and the textures of these, of emission and of lights, in scenes that have some."""
    table = SceneTable
    if programs.textures:
        flat.bind(table.textures, np.array(programs.textures))
        flat.bind(table.texels, np.array([pixels.ctypes.data for pixels in programs.pixels], np.int64))
        flat.owned += programs.pixels
        flat.texture_bytes = programs.texture_bytes
    if flat.features.uvs or flat.features.textured_emission:
        flat.bind(table.vertex_uvs, geometry.uv_rows())
    if flat.features.textured_emission:
        flat.bind(table.emission_textures, programs.emission_textures)
    if not programs:
        return
    flat.bind(table.programs, programs.first)
    flat.bind(table.program_textures, programs.images())
    flat.bind(table.nodes, np.array(programs.nodes))
    flat.bind(table.leaves, np.reshape(programs.leaves, (-1, LeafRow.size)).astype(flat.real))
    flat.bind(table.lookups, np.reshape(programs.lookups, (-1, LookupRow.size)))


def _bind_lights(flat: FlatScene, lights: LightList, frames: list[list[float]]) -> None:
    real, table = flat.real, SceneTable
    flat.bind(table.n_lights, len(lights.rows))
    flat.bind(table.lights, np.array(lights.rows or np.zeros((1, LightRow.size)), np.float64).astype(real))
    if flat.features.textured_emission:
        flat.bind(table.light_primitives, np.array(lights.primitives or [-1], np.int32))
    if frames:
        flat.bind(table.light_frames, np.array(frames))
    flat.bind(table.light_faces, np.concatenate(lights.faces).astype(np.int32))
    flat.bind(table.light_cdf, np.concatenate(lights.cdf))
    flat.bind(table.light_ranges, np.array(lights.ranges or [(0, 0)], np.int32))
    flat.bind(table.light_steps, max(max(count - 1, 0).bit_length() for _, count in lights.ranges or [(0, 0)]))
    light = lights.environment
    flat.bind(table.environment_radiance, np.array(light.radiance if light else (0.0, 0.0, 0.0), real))
    if light is not None and light.image is not None:
        texels, pdf, rows, runs = environment.tables(light, real)
        flat.bind(table.environment, texels)
        flat.bind(table.environment_map, environment.place_row(light))
        flat.bind(table.environment_pdf, pdf)
        flat.bind(table.environment_rows, rows)
        flat.bind(table.environment_runs, runs)
        flat.bind(table.environment_row_guide, environment.guides(rows[None], np.int32))
        flat.bind(table.environment_run_guide, environment.guides(runs, np.uint16))
        flat.bind(table.environment_width, pdf.shape[1])
        flat.bind(table.environment_height, pdf.shape[0])

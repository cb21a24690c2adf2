"""From the scene into the batch: what the surface stage computes from, of the primitive that each lane hit."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.masks import EVERY_LANE, lanes_where
from engines.kernels.compile.records import Row, address_of, prefetch
from engines.kernels.compile.row_loads import AT_ONCE, row_loads
from engines.kernels.compile.values import keep_scalar, select
from engines.kernels.features import SceneFeatures, per_features
from engines.kernels.flatten import lights, materials
from engines.kernels.flatten.shapes import PLANE, SPHERE, TRIANGLE
from engines.kernels.layout import LANES, RayBatch
from engines.kernels.rows import AnalyticRow, LightRow, MaterialRow, PlaneRow, PrimitiveRow, SphereRow, TriangleRow
from engines.kernels.stages import light_cells, light_hierarchy


def lane_number(field: str) -> int:
    """The first number of a lane of a field of the ray batch."""
    return RayBatch.field(field).first


def _of_corners(face: str, targets: tuple[str, str, str]) -> list[Any]:
    """Three functions (rays, address of vectors) that copy those of a face's corners to these fields."""
    firsts = [lane_number(target) for target in targets]
    corners = [lane_number(f"{face}.corner{k}") for k in range(3)]
    return [row_loads(corner, 3, (0, 1, 2), (k, k + 1, k + 2)) for corner, k in zip(corners, firsts, strict=True)]


@cache
def make_load_face(face: str) -> Any:
    """The function (rays, scene) that copies corners and vertices of a face, whose triangle's index is its `corner0`."""
    vertex0, vertex1, vertex2 = _of_corners(face, (f"{face}.vertex0", f"{face}.vertex1", f"{face}.vertex2"))
    corner = f"{face}.corner0"
    load_corners = make_load_rows(corner, TriangleRow, (0, 1, 2), tuple(lane_number(corner) + k for k in range(3)))

    @inline
    def load(rays, scene):
        load_corners(rays, address_of(scene.triangles), EVERY_LANE)
        vertex0(rays, address_of(scene.vertices), EVERY_LANE)
        vertex1(rays, address_of(scene.vertices), EVERY_LANE)
        vertex2(rays, address_of(scene.vertices), EVERY_LANE)

    return load


_normal0, _normal1, _normal2 = _of_corners("face", ("vertex_normal0", "vertex_normal1", "vertex_normal2"))


@inline
def _load_normals(rays, scene):
    _normal0(rays, address_of(scene.vertex_normals), EVERY_LANE)
    _normal1(rays, address_of(scene.vertex_normals), EVERY_LANE)
    _normal2(rays, address_of(scene.vertex_normals), EVERY_LANE)


@cache
def make_load_rows(index: str, row: type[Row], columns: tuple[int, ...], targets: tuple[int, ...]) -> Any:
    """The function (rays, address of such rows, lanes) that copies these columns, in ascending order, to these numbers of a
    lane, in the lanes of the word. The field `index` holds which row."""

    @inline
    def nothing(rays, address, lanes):
        pass

    if not columns:
        return nothing
    n = next((k for k in range(1, len(columns)) if k == AT_ONCE or columns[k] != columns[0] + k), len(columns))
    loads = row_loads(lane_number(index), row.size, columns[:n], targets[:n], row.dtype)
    rest = make_load_rows(index, row, columns[n:], targets[n:])

    @inline
    def load(rays, address, lanes):
        loads(rays, address, lanes)
        rest(rays, address, lanes)

    return load


def _material_columns(features: SceneFeatures) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """(columns of a material's row that the scene's BSDF models and its emission need, numbers of a lane to which they
    go)."""
    first, own = MaterialRow.fields["bsdf"].first, lane_number("bsdf")
    wanted = sorted({column for kind in features.bsdfs for column in materials.MODELS[kind].columns(features)})
    pairs = [(first + column, own + column) for column in wanted]
    if features.emission:
        emission, two_sided = MaterialRow.fields["emission"].first, MaterialRow.fields["two_sided"].first
        pairs += [(emission + k, lane_number("hit.emission") + k) for k in range(3)] + [(two_sided, lane_number("two_sided"))]
    columns = sorted(pairs)
    return tuple(column for column, _ in columns), tuple(target for _, target in columns)


@cache
def _make_load_formula(row: type[Row], real: Any) -> Any:
    """The function (rays, address of such rows, lanes) that copies the numbers of a shape with a formula."""
    first, numbers = lane_number("shape_parameters"), np.dtype(np.float64).itemsize // np.dtype(real).itemsize
    return make_load_rows("formula_row", row, tuple(range(row.size)), tuple(first + numbers * k for k in range(row.size)))


_of_triangles, _of_spheres, _of_planes = (lanes_where("==", kind) for kind in (TRIANGLE, SPHERE, PLANE))
_of_analytic, _not_negative = lanes_where(">", PLANE), lanes_where(">=", 0)
_load_face = make_load_face("face")


NEAR_TRIANGLES = 4096
"""So many triangles are in a near cache; what is read of more is prefetched."""


@per_features
def _make_prefetch(features: SceneFeatures, real: Any) -> Any:
    """The function (rays, scene) that starts loading what the scene holds of the triangles hit. One thing leads to the
    next, and a lane alone would wait for each: here all sixteen wait at once."""
    mixed, smooth, uvs = features.other_shapes, features.smooth, features.uvs
    vector = 3 * np.dtype(real).itemsize

    @inline
    def rows(rays, scene):
        for lane in range(np.uint64(LANES)):
            keep_scalar()
            index = np.int64(rays.primitive_row[lane])
            prefetch(address_of(scene.primitives[index]))
            if not mixed:
                prefetch(address_of(scene.triangles[index]))

    @inline
    def triangles(rays, scene):
        for lane in range(np.uint64(LANES)):
            keep_scalar()
            row = scene.primitives[np.int64(rays.primitive_row[lane])]
            index = select(row.shape == TRIANGLE, np.int64(row.index), np.int64(0))
            rays.shape_row[lane] = index
            prefetch(address_of(scene.triangles[index]))

    @inline
    def vertex(scene, index):
        prefetch(address_of(scene.vertices) + vector * np.int64(index))
        if smooth:
            prefetch(address_of(scene.vertex_normals) + vector * np.int64(index))
        if uvs:
            prefetch(address_of(scene.vertex_uvs[index]))

    @inline
    def prefetch_triangles(rays, scene):
        rows(rays, scene)
        if mixed:
            triangles(rays, scene)
        for lane in range(np.uint64(LANES)):
            keep_scalar()
            row = scene.triangles[np.int64(rays.shape_row[lane])]
            vertex(scene, row.a)
            vertex(scene, row.b)
            vertex(scene, row.c)

    return prefetch_triangles


class Kinds(NamedTuple):
    """The lanes that have hit something, by the kind of what they have hit: words."""

    triangles: int
    spheres: int
    planes: int
    analytic: int


@per_features
def _make_find_kinds(features: SceneFeatures) -> Any:
    """The function (rays, hits) -> Kinds, of the kinds of shapes that the lanes hold."""
    triangles, spheres, planes = features.triangles, features.spheres, features.planes
    others = features.other_shapes

    @inline
    def kinds(rays, hits):
        none = np.int64(0)
        if not others:
            return Kinds(hits, none, none, none)
        return Kinds(
            hits & _of_triangles(rays.hit.shape) if triangles else none,
            hits & _of_spheres(rays.hit.shape) if spheres else none,
            hits & _of_planes(rays.hit.shape) if planes else none,
            hits & _of_analytic(rays.hit.shape),
        )

    return kinds


@per_features
def _make_load_shapes(features: SceneFeatures, real: Any) -> Any:
    """The function (rays, scene, kinds) that copies the geometry of the primitives hit, whose indices among those of their kind
    are kept: of each kind that some lane has hit. Lanes that hit another read the first row."""
    triangles, smooth, spheres, planes = features.triangles, features.smooth, features.spheres, features.planes
    analytic = len(features.analytic) > 0
    load_sphere, load_plane, load_analytic = (_make_load_formula(row, real) for row in (SphereRow, PlaneRow, AnalyticRow))

    @inline
    def load(rays, scene, kinds):
        if triangles and kinds.triangles != 0:
            for lane in range(np.uint64(LANES)):
                rays.face.corner0[lane] = select(rays.hit.shape[lane] == TRIANGLE, rays.shape_row[lane], np.int32(0))
            _load_face(rays, scene)
            if smooth:
                _load_normals(rays, scene)
        if spheres and kinds.spheres != 0:
            for lane in range(np.uint64(LANES)):
                rays.formula_row[lane] = select(rays.hit.shape[lane] == SPHERE, rays.shape_row[lane], np.int32(0))
            load_sphere(rays, address_of(scene.spheres), kinds.spheres)
        if planes and kinds.planes != 0:
            for lane in range(np.uint64(LANES)):
                rays.formula_row[lane] = select(rays.hit.shape[lane] == PLANE, rays.shape_row[lane], np.int32(0))
            load_plane(rays, address_of(scene.planes), kinds.planes)
        if analytic and kinds.analytic != 0:
            for lane in range(np.uint64(LANES)):
                rays.formula_row[lane] = select(rays.hit.shape[lane] > PLANE, rays.shape_row[lane], np.int32(0))
            load_analytic(rays, address_of(scene.analytic), kinds.analytic)

    return load


@per_features
def _make_inverse_pmf(features: SceneFeatures, real: Any) -> Any:
    """The function (rays, lane, scene, light) -> 1 / the probability with which the light that was hit would have been chosen
    at the last vertex, which is still in the batch; 1 where nobody asks: of camera rays, and after a specular event."""
    power, cells, transparent = features.power_lights, features.light_cells, features.transparent
    media = features.light_hierarchy and features.media

    @inline
    def inverse_pmf(rays, lane, scene, light):
        if power:
            return scene.light_inverse_pmf[light if light >= 0 else np.int32(0)]
        if rays.primitive[lane] < 0 or light < 0 or not rays.path.pdf[lane] < real(np.inf):
            return 1.0
        point, normal = rays.hit.point[lane], rays.hit.geometric_normal[lane]
        if transparent:  # null lobes may lie between
            point, normal = rays.crossing.point[lane], rays.crossing.normal[lane]
        if cells:
            return light_cells.inverse_pmf(scene, light, point, normal)
        return light_hierarchy.inverse_pmf(scene, light, point, normal, media, real)

    return inverse_pmf


def chooses_by_weight(features: SceneFeatures) -> bool:
    """Whether some lights are chosen with other probabilities than others."""
    return features.power_lights or features.light_hierarchy or features.light_cells


def area_lights(features: SceneFeatures) -> tuple[int, ...]:
    """The kinds of lights that are shapes."""
    return tuple(kind for kind in features.lights if lights.MODELS[kind].pdf is not None)


@per_features
def _make_load_primitives(features: SceneFeatures) -> Any:
    """The function (rays, scene) that copies kind, index, material and light of each lane's primitive, whose id is kept. Where
    there are triangles alone, their indices are their ids: one cache miss less."""
    wanted = [("shape", "hit.shape"), ("index", "shape_row")] if features.other_shapes else []
    if features.bsdfs or features.emission:
        wanted += [("material", "material"), ("light", "emitter")]
    columns = tuple(PrimitiveRow.fields[column].first for column, _ in wanted)
    load_rows = make_load_rows("primitive_row", PrimitiveRow, columns, tuple(lane_number(name) for _, name in wanted))

    @inline
    def load(rays, scene):
        load_rows(rays, address_of(scene.primitives), EVERY_LANE)

    return load


@inline
def _keep_ids(rays):
    """Keeps the id of each lane's primitive, 0 where there is none; returns the lanes that have one."""
    for lane in range(np.uint64(LANES)):
        primitive = rays.primitive[lane]
        row = select(primitive < 0, np.int32(0), primitive)
        rays.primitive_row[lane] = row
        rays.shape_row[lane] = row  # where there are triangles alone
        rays.hit.shape[lane] = TRIANGLE
    return _not_negative(rays.primitive)


@per_features
def _make_load_lights(features: SceneFeatures, real: Any) -> Any:
    """The function (rays, scene, hits) that copies what the scene holds of the lights that the lanes in the word have hit."""
    parameters = max((lights.MODELS[kind].parameters for kind in area_lights(features)), default=0)
    weighted, inverse_pmf = chooses_by_weight(features), _make_inverse_pmf(features, real)
    first, own = LightRow.fields["parameters"].first, lane_number("emitter_parameters")
    columns = tuple(range(first, first + parameters))
    load_rows = make_load_rows("emitter_row", LightRow, columns, tuple(range(own, own + parameters)))

    @inline
    def load(rays, scene, hits):
        if parameters == 0 or hits & _not_negative(rays.emitter) == 0:
            return
        if weighted:
            for lane in range(np.uint64(LANES)):
                keep_scalar()
                rays.emitter_inverse_pmf[lane] = inverse_pmf(rays, lane, scene, rays.emitter[lane])
        for lane in range(np.uint64(LANES)):
            light = rays.emitter[lane]
            rays.emitter_row[lane] = select(light < 0, np.int32(0), light)
        load_rows(rays, address_of(scene.lights), EVERY_LANE)

    return load


@per_features
def make_load_hit(features: SceneFeatures, real: Any) -> Any:
    """The function (rays, scene) -> Kinds that copies what the scene holds of the primitives that the lanes hit; nothing where
    no lane hits any."""
    materials_of, several_bsdfs = _material_columns(features), len(features.bsdfs) > 1
    load_primitives, load_shapes = _make_load_primitives(features), _make_load_shapes(features, real)
    load_lights, find_kinds = _make_load_lights(features, real), _make_find_kinds(features)
    load_materials = make_load_rows("material", MaterialRow, *materials_of)
    triangles, prefetch_triangles = features.triangles, _make_prefetch(features, real)

    @inline
    def load(rays, scene):
        hits = _keep_ids(rays)
        if hits == 0:
            return Kinds(hits, hits, hits, hits)
        if triangles and scene.n_triangles > NEAR_TRIANGLES:
            prefetch_triangles(rays, scene)
        load_primitives(rays, scene)
        kinds = find_kinds(rays, hits)
        load_shapes(rays, scene, kinds)
        load_lights(rays, scene, hits)
        if several_bsdfs:
            for lane in range(np.uint64(LANES)):
                keep_scalar()
                rays.bsdf_model[lane] = np.int64(scene.materials[rays.material[lane]].model)
        load_materials(rays, address_of(scene.materials), EVERY_LANE)
        return kinds

    return load

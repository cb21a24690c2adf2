"""The World: a scene flattened into arrays for kernels, and the table of addresses through which stages reach them.

Every primitive has a *rank*: its place in the order of shapes, then of primitives in a shape. Ranks decide ties. For
each kind of primitive an array holds its geometry in rank order, in the tracing precision, relative to `World.center`.
`Needs` says what the scene holds; a stage is compiled for the part of it that concerns the stage, and carries code for
nothing else.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.kernels import environment
from engines.kernels.jit import kernel
from engines.scene.model import (
    DirectionalLight,
    EnvironmentLight,
    Material,
    Mesh,
    Plane,
    PointLight,
    Scene,
    Sphere,
    SphereSet,
    Triangle,
)

# kinds of primitives, and of lights
TRIANGLE, SPHERE, PLANE = 0, 1, 2
POINT_LIGHT, DIRECTIONAL_LIGHT, CONSTANT_SKY, IMAGE_SKY, FACE_LIGHT, SPHERE_LIGHT = range(6)

PRIMITIVE_INTS = 4  # kind, index within the kind, material, light (-1: not in the list of lights)
MATERIAL_REALS = 16  # kd 3, ks 3, kt 3, ior, fresnel, emission 3, two_sided, spare
LIGHT_REALS = 12  # kind, position or direction or centre 3, colour 3, radius or fall-off, area, two_sided, spare 2
PLANE_REALS = 6
SPHERE_REALS = 4
FLAT_LIST_CHUNK = 64

_slots = iter(range(1000))
# counts
N_TRIANGLES, N_SPHERES, N_PLANES, N_LIGHTS, SKY_WIDTH, SKY_HEIGHT = (next(_slots) for _ in range(6))
# arrays
VERTICES, TRIANGLES, TRIANGLE_RANK, SPHERES, SPHERE_RANK, PLANES, PLANE_RANK = (next(_slots) for _ in range(7))
PRIMITIVES, MATERIALS, LIGHTS, LIGHT_FACES, LIGHT_CDF, LIGHT_RANGE, VERTEX_NORMALS = (next(_slots) for _ in range(7))
SKY, SKY_PDF, SKY_ROWS, SKY_COLUMNS, SKY_RADIANCE = (next(_slots) for _ in range(5))
# set by the renderer
CAMERA, OPTIONS, POINTS, POINTS_STRIDE, FIRST_SAMPLE, SEED_KEY, WANTED, MARGINS = (next(_slots) for _ in range(8))
ACCELERATOR = next(_slots)  # the first of sixteen slots that belong to the accelerator
SLOTS = ACCELERATOR + 16


class Needs(NamedTuple):
    """What the scene holds, in plain values: a stage's key has those of them that it asks for, so that scenes which differ
    in the others share its machine code."""

    triangles: bool
    spheres: bool
    planes: bool
    smooth: bool
    diffuse: bool
    mirror: bool
    refraction: bool
    fresnel: bool
    emission: bool
    point: bool
    directional: bool
    constant_sky: bool
    image_sky: bool
    face_lights: bool
    sphere_lights: bool
    many_lights: bool


def of_needs(kind: Any, needs: Needs) -> Any:
    """A NamedTuple `kind` of some of the fields of `needs`: code that asks for another does not compile."""
    return kind(*(getattr(needs, name) for name in kind._fields))


@dataclass(slots=True)
class World:
    """Arrays of one scene in one precision; see the module's slots for their meaning. Indices are int32."""

    real: type
    center: NDArray[np.float64]
    needs: Needs
    first_rank: NDArray[np.int64]
    """(shapes,) rank of the first primitive of each shape."""
    arrays: dict[int, NDArray[Any]]
    counts: dict[int, int]
    bounds: NDArray[np.float64]
    """(2, 3) box of all finite shapes, in scene coordinates; NaN where there are none."""
    table: NDArray[np.int64] = field(default_factory=lambda: np.zeros(SLOTS, np.int64))
    owned: list[Any] = field(default_factory=list)
    """Other objects whose memory the table leads to: they live as long as the world."""

    def bind(self, slot: int, value: NDArray[Any] | int) -> None:
        """Puts an array (which is kept alive) or a number into a slot of the table."""
        if isinstance(value, np.ndarray):
            self.arrays[slot] = value = np.ascontiguousarray(value)
            self.table[slot] = value.ctypes.data
        else:
            self.table[slot] = value

    @property
    def address(self) -> int:
        return self.table.ctypes.data

    @property
    def bytes(self) -> int:
        return sum(array.nbytes for array in self.arrays.values())


def flatten(scene: Scene, real: type, tracing: type) -> World:
    """The arrays of `scene` in precision `real` (np.float32 or np.float64), for an intersector of precision `tracing`."""
    pieces = _Pieces()
    for shape in scene.shapes:
        pieces.add(shape)
    bounds = pieces.bounds()
    center = _recentre(bounds, tracing)
    lights = _Lights(scene, pieces, center)
    world = World(
        real,
        center,
        _needs(scene, pieces, lights),
        np.array(pieces.first_rank, np.int64),
        {},
        {},
        bounds,
    )
    _bind_shapes(world, pieces)
    _bind_surfaces(world, scene, pieces, lights)
    _bind_lights(world, lights)
    return world


def _recentre(bounds: NDArray[np.float64], tracing: type) -> NDArray[np.float64]:
    """Where the origin of the tracing coordinates lies. A mesh far from the origin loses all precision in float32."""
    middle, half = bounds.mean(axis=0), np.ptp(bounds, axis=0).max() / 2
    far = np.abs(middle).max() > 4 * half
    return middle if far and half > 0 and tracing == np.float32 else np.zeros(3)


class _Pieces:
    """Geometry collected shape by shape, in rank order within each kind."""

    def __init__(self) -> None:
        self.vertices: list[Any] = [np.zeros((0, 3))]
        self.normals: list[Any] = [np.zeros((0, 3))]
        self.faces: list[Any] = [np.zeros((0, 3), np.int32)]
        self.spheres: list[Any] = [np.zeros((0, 4))]
        self.planes: list[Any] = [np.zeros((0, 6))]
        self.ranks: list[list[Any]] = [[np.zeros(0, np.int32)] for _ in range(3)]
        self.material: list[Any] = [np.zeros(0, np.int64)]
        self.kind: list[Any] = [np.zeros(0, np.int64)]
        self.index: list[Any] = [np.zeros(0, np.int64)]
        self.first_rank: list[int] = []
        self.n = 0
        self.n_vertices = 0
        self.counts = [0, 0, 0]

    @staticmethod
    def joined(parts: list[Any]) -> NDArray[Any]:
        """All parts in one array; a single one that is not empty is not copied."""
        filled = [part for part in parts if len(part)] or parts[:1]
        return filled[0] if len(filled) == 1 else np.concatenate(filled)

    def add(self, shape: Any) -> None:
        self.first_rank.append(self.n)
        if isinstance(shape, Plane):
            self.planes.append(np.array([[*shape.point, *shape.normal]]))
            self._primitives(PLANE, 1, shape.material)
        elif isinstance(shape, Sphere):
            self.spheres.append(np.array([[*shape.center, shape.radius]]))
            self._primitives(SPHERE, 1, shape.material)
        elif isinstance(shape, SphereSet):
            self.spheres.append(np.column_stack([shape.centers, shape.radii]))
            self._primitives(SPHERE, len(shape.radii), shape.material)
        elif isinstance(shape, Triangle):
            self._triangles(np.array([shape.a, shape.b, shape.c]), None, np.array([[0, 1, 2]]), shape.material)
        else:
            self._triangles(shape.vertices, shape.normals, shape.faces, shape.materials)

    def _triangles(self, vertices: Any, normals: Any, faces: Any, material: Any) -> None:
        self.vertices.append(vertices)
        self.normals.append(np.zeros((len(vertices), 3)) if normals is None else normals)
        faces = np.asarray(faces, np.int32)
        self.faces.append(faces + np.int32(self.n_vertices) if self.n_vertices else faces)
        self.n_vertices += len(vertices)
        self._primitives(TRIANGLE, len(faces), material)

    def _primitives(self, kind: int, n: int, material: Any) -> None:
        self.ranks[kind].append(np.arange(self.n, self.n + n, dtype=np.int32))
        self.material.append(np.broadcast_to(np.asarray(material, np.int64), (n,)))
        self.kind.append(np.full(n, kind, np.int8))
        self.index.append(np.arange(self.counts[kind], self.counts[kind] + n, dtype=np.int32))
        self.counts[kind] += n
        self.n += n

    def bounds(self) -> NDArray[np.float64]:
        vertices, spheres = self.joined(self.vertices), self.joined(self.spheres)
        reach = spheres[:, 3:]
        ends = [part for part in (vertices, spheres[:, :3] - reach, spheres[:, :3] + reach) if len(part)]
        if not ends:
            return np.full((2, 3), np.nan)
        lows, highs = [part.min(axis=0) for part in ends], [part.max(axis=0) for part in ends]
        return np.array([np.min(lows, axis=0), np.max(highs, axis=0)])


class _Lights:
    """The list of lights in the order of docs/transport.md, and which light each primitive belongs to."""

    def __init__(self, scene: Scene, pieces: _Pieces, center: NDArray[np.float64]) -> None:
        self.rows: list[list[float]] = []
        self.faces: list[Any] = [np.zeros(0, np.int64)]
        self.cdf: list[Any] = [np.zeros(0)]
        self.ranges: list[tuple[int, int]] = []
        self.sky: EnvironmentLight | None = None
        self.of_primitive = np.full(pieces.n, -1, np.int32)
        self.center = center
        for light in scene.lights:
            self._add_listed(light)
        for shape, first in zip(scene.shapes, pieces.first_rank, strict=True):
            self._add_shape(scene.materials, shape, first)

    def _row(
        self, kind: int, place: Any, colour: Any, size: float = 0, area: float = 0, two_sided: bool = False
    ) -> None:
        self.rows.append([kind, *place, *colour, size, area, float(two_sided), 0, 0])
        if len(self.ranges) < len(self.rows):
            self.ranges.append((0, 0))

    def _add_listed(self, light: Any) -> None:
        if isinstance(light, PointLight):
            self._row(POINT_LIGHT, np.subtract(light.position, self.center), light.intensity, float(light.falloff))
        elif isinstance(light, DirectionalLight):
            self._row(DIRECTIONAL_LIGHT, np.negative(light.direction), light.irradiance)
        else:
            self.sky = light
            self._row(CONSTANT_SKY if light.image is None else IMAGE_SKY, (0, 0, 0), light.radiance)

    def _add_shape(self, materials: tuple[Material, ...], shape: Any, first: int) -> None:
        if isinstance(shape, (Sphere, SphereSet)):
            material = materials[shape.material]
            if material.emits:
                centers = np.atleast_2d(shape.centers if isinstance(shape, SphereSet) else shape.center)
                radii = np.atleast_1d(shape.radii if isinstance(shape, SphereSet) else shape.radius)
                for k, (place, radius) in enumerate(zip(centers, radii, strict=True)):
                    self.of_primitive[first + k] = len(self.rows)
                    self._row(SPHERE_LIGHT, place - self.center, material.emission, radius, 0, material.two_sided)
        elif isinstance(shape, (Triangle, Mesh)):
            self._add_faces(materials, shape, first)

    def _add_faces(self, materials: tuple[Material, ...], shape: Any, first: int) -> None:
        if isinstance(shape, Triangle):
            corners = np.array([[shape.a, shape.b, shape.c]])
            emitting = np.flatnonzero([materials[shape.material].emits])
        else:
            emitting = np.flatnonzero(np.array([m.emits for m in materials])[shape.materials])
            corners = shape.vertices[shape.faces[emitting]]
        corners = corners[: len(emitting)]
        areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
        chosen, areas = emitting[areas > 0], areas[areas > 0]
        if not len(chosen):
            return
        self.of_primitive[first + chosen] = len(self.rows)
        start = sum(len(part) for part in self.faces)
        self.ranges.append((start, len(chosen)))
        self.faces.append(first + chosen)
        sums = np.cumsum(areas)
        self.cdf.append(sums / sums[-1])
        self._row(FACE_LIGHT, (0, 0, 0), (0, 0, 0), 0, sums[-1])


def _needs(scene: Scene, pieces: _Pieces, lights: _Lights) -> Needs:
    used = [scene.materials[i] for i in np.flatnonzero(np.bincount(pieces.joined(pieces.material)))]
    kinds = {int(row[0]) for row in lights.rows}
    return Needs(
        triangles=pieces.counts[TRIANGLE] > 0,
        spheres=pieces.counts[SPHERE] > 0,
        planes=pieces.counts[PLANE] > 0,
        smooth=any(isinstance(s, Mesh) and s.normals is not None for s in scene.shapes),
        diffuse=any(max(m.kd) > 0 for m in used),
        mirror=any(max(m.ks) > 0 for m in used),
        refraction=any(max(m.kt) > 0 for m in used),
        fresnel=any(m.fresnel for m in used),
        emission=any(m.emits for m in used),
        point=POINT_LIGHT in kinds,
        directional=DIRECTIONAL_LIGHT in kinds,
        constant_sky=CONSTANT_SKY in kinds,
        image_sky=IMAGE_SKY in kinds,
        face_lights=FACE_LIGHT in kinds,
        sphere_lights=SPHERE_LIGHT in kinds,
        many_lights=len(lights.rows) > 1,
    )


def _bind_shapes(world: World, pieces: _Pieces) -> None:
    real, join = world.real, pieces.joined
    for slot, kind in ((N_TRIANGLES, TRIANGLE), (N_SPHERES, SPHERE), (N_PLANES, PLANE)):
        world.counts[kind] = pieces.counts[kind]
        world.bind(slot, pieces.counts[kind])
    world.bind(VERTICES, (join(pieces.vertices) - world.center).astype(real))
    world.bind(VERTEX_NORMALS, join(pieces.normals).astype(real))
    world.bind(TRIANGLES, np.array(join(pieces.faces)))
    _close_slits(world.arrays[TRIANGLES], world.arrays[VERTICES])
    world.bind(SPHERES, join(pieces.spheres) - np.append(world.center, 0))
    world.bind(PLANES, join(pieces.planes) - np.append(world.center, np.zeros(3)))
    for slot, kind in ((TRIANGLE_RANK, TRIANGLE), (SPHERE_RANK, SPHERE), (PLANE_RANK, PLANE)):
        world.bind(slot, join(pieces.ranks[kind]))


@kernel
def _close_slits(faces, vertices):
    """Draws faces without area (as the vertices are rounded) together to a point, which no ray meets. Seen from afar,
    rounding could open a slit."""
    for i in range(len(faces)):
        a, b, c = faces[i, 0], faces[i, 1], faces[i, 2]
        px, py, pz = np.float64(vertices[a, 0]), np.float64(vertices[a, 1]), np.float64(vertices[a, 2])
        ux, uy, uz = vertices[b, 0] - px, vertices[b, 1] - py, vertices[b, 2] - pz
        vx, vy, vz = vertices[c, 0] - px, vertices[c, 1] - py, vertices[c, 2] - pz
        if uy * vz - uz * vy == 0.0 and uz * vx - ux * vz == 0.0 and ux * vy - uy * vx == 0.0:
            faces[i, 1] = faces[i, 2] = a


def _bind_surfaces(world: World, scene: Scene, pieces: _Pieces, lights: _Lights) -> None:
    """The tables that lead from a rank to its geometry, material and light."""
    join = pieces.joined
    rows = [
        [*m.kd, *m.ks, *m.kt, m.ior, float(m.fresnel), *m.emission, float(m.two_sided), 0.0] for m in scene.materials
    ]
    world.bind(MATERIALS, np.array(rows or np.zeros((1, MATERIAL_REALS))).astype(world.real))
    table = np.zeros((max(pieces.n, 1), PRIMITIVE_INTS), np.int32)  # a row to read where every ray misses
    columns = (join(pieces.kind), join(pieces.index), join(pieces.material), lights.of_primitive)
    for column, values in enumerate(columns):
        table[: pieces.n, column] = values
    world.bind(PRIMITIVES, table)


def _bind_lights(world: World, lights: _Lights) -> None:
    real = world.real
    world.bind(N_LIGHTS, len(lights.rows))
    world.bind(LIGHTS, np.array(lights.rows or np.zeros((1, LIGHT_REALS)), np.float64).astype(real))
    world.bind(LIGHT_FACES, np.concatenate(lights.faces).astype(np.int32))
    world.bind(LIGHT_CDF, np.concatenate(lights.cdf))
    world.bind(LIGHT_RANGE, np.array(lights.ranges or [(0, 0)], np.int32))
    radiance = lights.sky.radiance if lights.sky else (0.0, 0.0, 0.0)
    world.bind(SKY_RADIANCE, np.array(radiance, real))
    if lights.sky is not None and lights.sky.image is not None:
        image, pdf, rows, columns = environment.tables(lights.sky)
        world.bind(SKY, image)
        world.bind(SKY_PDF, pdf)
        world.bind(SKY_ROWS, rows)
        world.bind(SKY_COLUMNS, columns)
        world.bind(SKY_WIDTH, image.shape[1])
        world.bind(SKY_HEIGHT, image.shape[0])

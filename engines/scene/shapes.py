"""Shapes: what engines get of each, and beside it the keys of a scene file. A shape is one entry of `SHAPES`."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from engines.errors import SceneError
from engines.scene.bsdf_tree import is_textured
from engines.scene.context import SceneReader
from engines.scene.geometry import has_area, read_only
from engines.scene.materials import Material
from engines.scene.media import NAMED_MEDIUM, MediumInterface
from engines.scene.mesh import MATRIX, MESH, Mesh, SphereSet, is_singular
from engines.scene.procedural import PROCEDURAL
from engines.scene.triple import Triple
from engines.schema import fields
from engines.schema.keys import Given, Key, Record, Variants, by_name, list_of
from engines.schema.kinds import DIRECTION, POINT, POSITIVE, ROWS, TEXT, ContextKind, Kind
from engines.schema.yaml_file import Located, locate

__all__ = ["Cylinder", "Disk", "Group", "Instance", "Plane", "Shape", "Single", "Sphere", "Triangle"]
__all__ += ["counted", "groups_of", "primitives_of", "singles"]

Box = NDArray[np.float64]
"""(2, 3) lowest and highest coordinates."""


PART = "the texture from (0, 0) to (1, 0) and (0, 1)"


def _of(shape: Callable[..., Shape]) -> Callable[[Given, SceneReader], Shape]:
    return lambda given, context: shape(**given.values, material=context.material)


_CENTER = Key(POINT, "Center of the shape.", unit="metres")
_NORMAL = Key(DIRECTION, "Direction towards the front, of any length.")
_RADIUS = Key(POSITIVE, "Radius of the shape.", unit="metres")


@dataclass(frozen=True, slots=True)
class Plane(MediumInterface):
    """Infinite; `normal` is unit and points to the front."""

    point: Triple
    normal: Triple
    material: int

    def bounds(self) -> None:
        """None: a plane has no end."""


_PLANE = Record(
    "An infinite plane. One that emits is found by scattered rays alone.",
    {"point": Key(POINT, "Any point of the plane.", unit="metres"), "normal": _NORMAL},
    _of(Plane),
)


@dataclass(frozen=True, slots=True)
class Sphere(MediumInterface):
    """Outside is the front: the normal points away from `center`; `radius` is above zero."""

    center: Triple
    radius: float
    material: int

    def bounds(self) -> Box:
        """The corners of its bounding box."""
        return np.stack([np.subtract(self.center, self.radius), np.add(self.center, self.radius)])


_SPHERE = Record("A sphere. Its outside is the front.", {"center": _CENTER, "radius": _RADIUS}, _of(Sphere))


@dataclass(frozen=True, slots=True)
class Disk(MediumInterface):
    """Flat and round; `normal` is unit and points to the front; `radius` is above zero. One that emits is sampled."""

    center: Triple
    normal: Triple
    radius: float
    material: int

    def bounds(self) -> Box:
        """The corners of its bounding box: along an axis it reaches as far as the sine of its normal's angle with the axis."""
        extent = self.radius * np.sqrt(np.maximum(0.0, 1.0 - np.square(self.normal)))
        return np.stack([np.subtract(self.center, extent), np.add(self.center, extent)])


_DISK = Record("A flat disk.", {"center": _CENTER, "normal": _NORMAL, "radius": _RADIUS}, _of(Disk))


@dataclass(frozen=True, slots=True)
class Cylinder(MediumInterface):
    """The side of a cylinder about the axis from `p0` to `p1`, open at both ends. Its outside is the front. One that emits
    is sampled."""

    p0: Triple
    p1: Triple
    radius: float
    material: int

    def bounds(self) -> Box:
        """The corners of its bounding box."""
        axis = np.subtract(self.p1, self.p0) / np.linalg.norm(np.subtract(self.p1, self.p0))
        extent = self.radius * np.sqrt(np.maximum(0.0, 1.0 - np.square(axis)))
        ends = np.array([self.p0, self.p1])
        return np.stack([ends.min(axis=0) - extent, ends.max(axis=0) + extent])


def _cylinder(given: Given, context: SceneReader) -> Cylinder:
    fields.towards(given.at("p1"), given["p0"], "p0")
    assert context.material is not None
    return Cylinder(**given.values, material=context.material)


_END = Key(POINT, "An end of the axis.", unit="metres")
_CYLINDER = Record(
    "The side of a cylinder, open at both ends. Its outside is the front.",
    {"p0": _END, "p1": _END, "radius": _RADIUS},
    _cylinder,
)


@dataclass(frozen=True, slots=True)
class Triangle(MediumInterface):
    """Counter-clockwise seen from the front: the normal is (b - a) x (c - a)."""

    a: Triple
    b: Triple
    c: Triple
    material: int

    def bounds(self) -> Box:
        """The corners of its bounding box."""
        corners = np.array([self.a, self.b, self.c])
        return np.stack([corners.min(axis=0), corners.max(axis=0)])


_CORNER = Key(POINT, "A corner; a, b, c run counter-clockwise seen from the front.", unit="metres")
_TRIANGLE = Record("A triangle.", dict.fromkeys("abc", _CORNER), _of(Triangle))


def _spheres(given: Given, context: SceneReader) -> SphereSet:
    centers, written = fields.rows(given["centers"], np.float64), given["radii"]
    radii = locate(written.value.tolist()).value if isinstance(written.value, np.ndarray) else written.value
    if not isinstance(radii, list) or len(radii) != len(centers) or len(centers) == 0:
        raise written.refuse("must be a list of radii, one for each center")
    assert context.material is not None
    return SphereSet(read_only(centers), read_only(np.array([fields.positive(radius) for radius in radii])), context.material)


_RADII = Kind(lambda node: node, {"type": "array", "items": POSITIVE.json, "minItems": 1})
_SPHERES = Record(
    "Many spheres that make one shape.",
    {"centers": Key(ROWS, "Centers of the spheres.", unit="metres"), "radii": Key(_RADII, "Radius of each.", unit="metres")},
    _spheres,
)

Single = Plane | Sphere | Disk | Cylinder | Triangle | Mesh | SphereSet
"""A shape that is no instance."""


@dataclass(frozen=True, slots=True, eq=False)
class Group:
    """Shapes in coordinates of their own, which instances show. At least one, and none of them a plane, an instance or an empty
    mesh, for which it raises `SceneError`. None emits, which readers and engines check: only they know the materials."""

    name: str
    shapes: tuple[Single, ...]
    box: Box = field(init=False, repr=False)
    """That of all shapes."""

    def __post_init__(self) -> None:
        boxes = [box for shape in self.shapes if not isinstance(shape, Instance) and (box := shape.bounds()) is not None]
        if len(boxes) < len(self.shapes) or not boxes:
            raise SceneError(f"group {self.name!r}: must hold shapes, but no planes, no instances and no empty meshes")
        corners = np.concatenate(boxes)
        object.__setattr__(self, "box", read_only(np.stack([corners.min(axis=0), corners.max(axis=0)])))


@dataclass(frozen=True, slots=True, eq=False)
class Instance:
    """The shapes of a group, placed by `matrix` (3, 4), local to world. Fronts stay fronts where it mirrors: a normal n becomes
    M^-T n. Raises `SceneError` for matrices that are singular, or lead beyond `FARTHEST`."""

    group: Group
    matrix: NDArray[np.float64]

    def __post_init__(self) -> None:
        matrix = np.array(self.matrix, np.float64)
        if matrix.shape != (3, 4) or not np.isfinite(matrix).all() or is_singular(matrix[:, :3]):
            raise SceneError("must be 3 x 4 finite numbers, and not singular")
        if not float(np.abs(matrix).max()) * (1.0 + float(np.abs(self.group.box).max())) < FARTHEST:
            raise SceneError(f"must leave the group within {FARTHEST:g} metres of the origin")
        object.__setattr__(self, "matrix", read_only(matrix))

    def bounds(self) -> Box:
        """The corners of the box around the eight corners of the group's box."""
        low, high = self.group.box
        center, half = self.matrix[:, :3] @ (0.5 * low + 0.5 * high) + self.matrix[:, 3], 0.5 * high - 0.5 * low
        extent = np.abs(self.matrix[:, :3]) @ half
        return np.stack([center - extent, center + extent])


FARTHEST = 1e30
"""Beyond all coordinates of what an instance shows, as of what is imported from Mitsuba's files."""
MAX_INSTANCES = 200_000
"""Instances in a scene file."""

Shape = Single | Instance


def groups_of(shapes: Iterable[Shape]) -> list[Group]:
    """The groups that instances among the shapes show, each once, in the order of first use."""
    return list({id(shape.group): shape.group for shape in shapes if isinstance(shape, Instance)}.values())


def singles(shapes: Iterable[Shape]) -> list[tuple[str, Single]]:
    """Where each shape stands that is no instance, and the shape: those of the scene, and of each group once."""
    found: list[tuple[str, Single]] = []
    listed = list(shapes)
    for where, members in (("shapes", listed), *((f"groups.{group.name}", group.shapes) for group in groups_of(listed))):
        found += [(f"{where}[{index}]", shape) for index, shape in enumerate(members) if not isinstance(shape, Instance)]
    return found


def counted(shapes: Iterable[Shape]) -> list[tuple[Single, int]]:
    """Each shape that is no instance, and how many times the scene shows it; those of groups once."""
    listed = list(shapes)
    times = Counter(id(shape.group) for shape in listed if isinstance(shape, Instance))
    members = [(member, times[id(group)]) for group in groups_of(listed) for member in group.shapes]
    return [*((shape, 1) for shape in listed if not isinstance(shape, Instance)), *members]


def materials_of(shape: Single) -> list[int]:
    """The indices of the materials of a shape, each once."""
    return np.unique(shape.materials).tolist() if isinstance(shape, Mesh) else [shape.material]


def primitives_of(shape: Single) -> int:
    """Triangles, spheres and others that a shape is made of."""
    return len(shape.faces) if isinstance(shape, Mesh) else len(shape.radii) if isinstance(shape, SphereSet) else 1


def as_mesh(shape: Shape) -> Mesh | None:
    """A mesh, or the one of one face that a triangle is; None of other shapes."""
    if isinstance(shape, Triangle):
        corners = np.array([shape.a, shape.b, shape.c], np.float64)
        return Mesh(corners, np.array([[0, 1, 2]], np.int32), np.array([shape.material], np.int32))
    return shape if isinstance(shape, Mesh) else None


def as_spheres(shape: Shape) -> SphereSet | None:
    """A set of spheres, or that of one sphere; None of other shapes."""
    if isinstance(shape, Sphere):
        return SphereSet(np.array([shape.center], np.float64), np.array([shape.radius], np.float64), shape.material)
    return shape if isinstance(shape, SphereSet) else None


def _instance(given: Given, context: SceneReader) -> Instance:
    if context.group:
        raise given.node.refuse(f"an instance in the group {context.group!r}: groups hold no instances and no groups")
    context.instances += 1
    if context.instances > MAX_INSTANCES:
        raise given.node.refuse(f"more than {MAX_INSTANCES:,} instances")
    group = context.groups[fields.one_of(given["group"], context.groups, "group")]
    try:
        return Instance(group, given["matrix"])
    except SceneError as problem:
        raise given.at("matrix").refuse(str(problem)) from problem


_INSTANCE = Record(
    "The shapes of a group, placed by a matrix. It has no material: its shapes have their own.",
    {
        "group": Key(Kind(lambda node: node, TEXT.json), "Name of one of the groups."),
        "matrix": Key(MATRIX, "From the group's coordinates to the world's: 3 x 4 numbers, by rows."),
    },
    _instance,
)

_MEDIUM = {
    "interior": Key(NAMED_MEDIUM, "Name of the medium behind the shape; without it, vacuum if there is an exterior.", None),
    "exterior": Key(
        NAMED_MEDIUM, "Name of the medium in front of the shape; without it, vacuum if there is an interior.", None
    ),
}
SHAPES = Variants(
    "shape",
    {
        "sphere": _SPHERE,
        "spheres": _SPHERES,
        "disk": _DISK,
        "cylinder": _CYLINDER,
        "plane": _PLANE,
        "triangle": _TRIANGLE,
        "mesh": MESH,
        "procedural": PROCEDURAL,
        "instance": _INSTANCE,
    },
    {
        "material": Key(
            Kind(fields.text, {"anyOf": [TEXT.json, {"type": "array", "items": TEXT.json, "minItems": 1}]}),
            "Name of one of the materials; a mesh from an OBJ file may leave it to the file, and one from a PLY file may have "
            "a list, to which a column 'material' of its faces points.",
        ),
        **_MEDIUM,
    },
)


def _shape(node: Located, context: SceneReader) -> Shape:
    """A shape with its material and its media."""
    kind = SHAPES.choose(node)
    body, named = node.value[kind], node.value.get("material")
    if kind == "instance":
        made = _INSTANCE.read(body, context)
        if named is not None:
            raise named.refuse("an instance has no material: the shapes of its group have their own")
        return made
    several = named.value if named is not None and isinstance(named.value, list) else []
    file = body.value.get("file") if kind == "mesh" and isinstance(body.value, dict) else None
    if named is not None and several and not (file and str(file.value).lower().endswith(".ply")):
        raise named.refuse("unknown material: must be one name, a list belongs to a .ply file")
    context.material = None if named is None or several else context.table.index(named)
    context.face_materials = [context.table.index(each) for each in several]
    if named is None and file is None:
        raise node.refuse_key("material", "is missing")
    shape = SHAPES.records[kind].read(body, context)
    sides = {side: key.kind.read(node.value[side], context) for side, key in _MEDIUM.items() if side in node.value}
    if sides:
        shape = replace(shape, **sides)
    check_area(node, shape, context)
    if isinstance(shape, Mesh) and shape.uvs is None and _shows_texture(shape, context):
        context.warnings.append(f"{shape.name} has no texture coordinates: each of its triangles shows {PART}")
    return shape


SHAPE = ContextKind(_shape, SHAPES.schema())


def _groups(node: Located, context: SceneReader) -> None:
    """Groups by names of the user's own, which the context learns before the scene's shapes are read."""
    if node.value is not None and not isinstance(node.value, dict):
        raise node.refuse("must be a mapping from names to lists of shapes")
    for name, child in (node.value or {}).items():
        context.group = name
        shapes = [_member(each, context) for each in fields.items(child, "shapes")]
        try:
            context.groups[name] = Group(name, tuple(shapes))
        except SceneError as problem:
            raise child.refuse(str(problem)) from problem
    context.group = ""


def _member(node: Located, context: SceneReader) -> Single:
    """A shape of a group."""
    shape = _shape(node, context)
    assert not isinstance(shape, Instance), "refused where it is read"
    if isinstance(shape, Plane):
        raise node.refuse("a plane in a group: groups hold shapes with an end")
    if name := emitting(shape, context.table.materials):
        raise node.refuse(f"material {name!r} emits: groups hold no lights")
    return shape


def emitting(shape: Single, materials: Sequence[Material]) -> str | None:
    """The name of the first material of a shape that emits, or None."""
    return next((materials[index].name for index in materials_of(shape) if materials[index].emits), None)


GROUPS = ContextKind(_groups, by_name(list_of(SHAPE, "shapes"), "groups").schema())


def check_area(node: Located, shape: Shape, context: SceneReader) -> None:
    """Counts degenerate triangles, and refuses an emitting material where they are all there is."""
    mesh = as_mesh(shape)
    if mesh is None:
        return
    area = has_area(mesh.vertices, mesh.faces)
    context.degenerate += int((~area).sum())
    known = context.table.materials
    emitting = [index for index in np.unique(mesh.materials).tolist() if known[index].emits]
    emits = np.isin(mesh.materials, emitting)
    if emitting and not (emits & area).any():
        name = known[int(mesh.materials[emits][0])].name
        raise node.refuse(f"material {name!r} emits, but the shape has no area")


def _shows_texture(mesh: Mesh, context: SceneReader) -> bool:
    return any(is_textured(context.table.materials[index].bsdf) for index in np.unique(mesh.materials))

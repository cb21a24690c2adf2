"""Shapes: each of `SHAPES` makes a shape of the scene from a plugin."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.scene import tessellate
from engines.scene.attributes import Attributes, of_copies
from engines.scene.bsdf import Bsdf, Sides
from engines.scene.bsdf_tree import anisotropic, attributes, is_textured, leaves
from engines.scene.formats.mesh import MeshData, read_mesh_file
from engines.scene.frames import Matrix, cofactors, mirrored, mitsuba_frame, placed
from engines.scene.geometry import angle_weighted_normals, has_area, unit_rows, with_face_normals
from engines.scene.mesh import Mesh, faceted, read_only_mesh
from engines.scene.mitsuba_xml.bsdfs import bsdf, turned
from engines.scene.mitsuba_xml.context import Importer
from engines.scene.mitsuba_xml.document import Element
from engines.scene.mitsuba_xml.emitters import area_radiance
from engines.scene.mitsuba_xml.media import sides_of
from engines.scene.mitsuba_xml.properties import Plugin
from engines.scene.mitsuba_xml.transforms import similarity
from engines.scene.models import Diffuse, Null
from engines.scene.shapes import PART, Cylinder, Disk, Single, Sphere
from engines.scene.tessellate import Triangles
from engines.scene.textures import Color, MeshAttribute, Texture, UVTexture
from engines.scene.triple import BLACK, triple

SEGMENTS, RINGS, DISK_RINGS = 192, 96, 16
"""Around a round shape, a chord of which lies 1.3e-4 radii within the circle; from pole to pole of a sphere; of a disk."""
MESHES = ("rectangle", "cube")
"""Shapes that are meshes in Mitsuba, too: there the winding after `to_world` says which medium is inside."""
UNTURNED = 1e-6
"""By how much a rotation may differ from none where texture coordinates depend on it."""


@dataclass(frozen=True, slots=True)
class Look:
    """What a shape looks like: its BSDF (None is black) and the radiance of its front."""

    bsdf: Bsdf | None
    radiance: Color
    name: str

    @property
    def emits(self) -> bool:
        """Whether the front emits light; a texture counts, even a black one."""
        return isinstance(self.radiance, Texture) or max(self.radiance) > 0.0

    @property
    def looks_at_uv(self) -> bool:
        """Whether its emission or its BSDF has a texture that looks at texture coordinates."""
        return isinstance(self.radiance, UVTexture) or is_textured(self.bsdf)

    @property
    def attributes(self) -> set[str]:
        """The names of the attributes that its emission or its BSDF shows."""
        return attributes(self.bsdf) | ({self.radiance.name} if isinstance(self.radiance, MeshAttribute) else set())


def shape(importer: Importer, plugin: Plugin) -> Single:
    """The shape of a plugin with its material. Raises `SceneError`."""
    make = SHAPES.get(plugin.type)
    if make is None:
        raise plugin.refuse(REFUSED.get(plugin.type, f"unknown shape: known: {', '.join((*SHAPES, *GROUPS))}"))
    for inside in importer.taken(plugin, "subsurface"):
        raise inside.refuse("scattering below the surface is not supported: leave it out")
    for sensor in importer.taken(plugin, "sensor"):
        raise sensor.refuse("a sensor on a shape is not supported: use a perspective sensor of the scene")
    made = make(importer, plugin, _look(importer, plugin))
    importer.finish(plugin)
    importer.check_area(plugin, made)
    return made


def _look(importer: Importer, plugin: Plugin) -> Look:
    bsdfs = importer.taken(plugin, "bsdf")
    emitters = importer.taken(plugin, "emitter")
    for what, several in (("BSDF", bsdfs), ("emitter", emitters)):
        if len(several) > 1:
            raise plugin.refuse(f"has {len(several)} of {what}: a shape may have one")
    if emitters:
        importer.claim(emitters[0], plugin)
    radiance = area_radiance(importer, emitters[0]) if emitters else BLACK
    if bsdfs:
        return Look(bsdf(importer, bsdfs[0]), radiance, bsdfs[0].label)
    if emitters:
        return Look(None, radiance, "emitter")
    if plugin.element.source.old and importer.taken(plugin, "medium"):
        return Look(Null(), BLACK, "null")
    importer.one_sided["shapes without a BSDF"] = None
    return Look(Sides(Diffuse(), None), BLACK, "default")


# ---- triangles -------------------------------------------------------------------------------------------------------


def _mesh(importer: Importer, plugin: Plugin, look: Look, triangles: Triangles, matrix: Matrix, turn: bool) -> Mesh:
    """Triangles in local coordinates as a mesh whose front is the transformed one, turned over with `turn`.

    Normals are those of the inverse transpose; without normals the winding says what is in front before the transform.
    """
    vertices, faces, uvs, normals = triangles
    vertices = placed(matrix, vertices)
    importer.check_finite(plugin, vertices)
    if normals is None:
        swapped = np.full(len(faces), mirrored(matrix) != turn)
    else:
        normals = transformed_normals(matrix, normals) * (-1.0 if turn else 1.0)
        vertices, faces, normals, uvs, _, _ = with_face_normals(vertices, faces, normals, uvs)
        swapped = against(vertices, faces, normals)
    exchanged = np.full(len(faces), plugin.type in MESHES and mirrored(plugin.transform()))
    return finished(importer, plugin, look, vertices, _swapped(faces, swapped), normals, uvs, exchanged)


def transformed_normals(matrix: Matrix, normals: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) unit normals of the scene."""
    return unit_rows(normals @ cofactors(matrix[:3, :3]).T * (-1.0 if mirrored(matrix) else 1.0))


def against(vertices: NDArray[np.float64], faces: NDArray[np.int32], normals: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(m,) whether the winding of a face is against the mean of its normals: Mitsuba's front is the side of the normals."""
    corners = vertices[faces]
    winding = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return np.einsum("ij,ij->i", winding, normals[faces].sum(axis=1)) < 0.0


def _swapped(faces: NDArray[np.int32], which: NDArray[np.bool_]) -> NDArray[np.int32]:
    """The faces, with the second and third vertex exchanged of those that `which` says."""
    return np.where(which[:, None], faces[:, [0, 2, 1]], faces).astype(np.int32)


def finished(
    importer: Importer,
    plugin: Plugin,
    look: Look,
    vertices: NDArray[np.float64],
    faces: NDArray[np.int32],
    normals: NDArray[np.float64] | None,
    uvs: NDArray[np.float64] | None,
    exchanged: NDArray[np.bool_],
    attributes: Attributes | None = None,
) -> Mesh:
    """The mesh of these arrays, read-only, with the material of `look` and the media of the plugin (`sides_of`)."""
    material = importer.material(look.bsdf, look.radiance, look.name)
    mesh = read_only_mesh(vertices, faces, np.full(len(faces), material), normals, plugin.id or plugin.type, uvs, attributes)
    if any(importer.children(plugin, "medium")):
        exchanged = exchanged[has_area(vertices, faces)]
    return replace(mesh, **sides_of(importer, plugin, exchanged))


# ---- shapes ----------------------------------------------------------------------------------------------------------


def _flat(importer: Importer, plugin: Plugin, look: Look) -> Mesh:
    """A rectangle or a cube."""
    turn = plugin.boolean("flip_normals", default=False)
    triangles = tessellate.rectangle() if plugin.type == "rectangle" else tessellate.cube()
    return _mesh(importer, plugin, look, triangles, plugin.transform(), turn)


def _of_disk(importer: Importer, plugin: Plugin, look: Look) -> Single:
    matrix, turn = plugin.transform(), plugin.boolean("flip_normals", default=False)
    radius = _round(matrix[:3, 0], matrix[:3, 1])
    if radius is None:
        importer.notes.add("a stretched disk is made of triangles", plugin.element)
    elif not look.looks_at_uv:
        normal = cofactors(matrix[:3, :3])[:, 2] * (-1.0 if mirrored(matrix) != turn else 1.0)
        length = float(np.linalg.norm(normal))
        material = importer.material(look.bsdf, look.radiance, look.name)
        sides = sides_of(importer, plugin, False)
        return Disk(triple(matrix[:3, 3]), triple(normal / length), radius, material, **sides)
    else:
        importer.notes.add("a textured disk is made of triangles", plugin.element)
    return _mesh(importer, plugin, look, tessellate.disk(SEGMENTS, DISK_RINGS), matrix, turn)


def _sphere(importer: Importer, plugin: Plugin, look: Look) -> Single:
    matrix, center = plugin.transform(), plugin.point("center", (0.0, 0.0, 0.0))
    radius = plugin.positive("radius", default=1.0)
    inside_out = plugin.boolean("flip_normals", default=False) != mirrored(plugin.transform())
    local = np.eye(4)
    local[:3, :3] *= radius
    local[:3, 3] = center
    matrix = matrix @ local
    scale = similarity(matrix[:3, :3])
    turned_round = scale is not None and np.abs(matrix[:3, :3] / scale - np.eye(3)).max() > UNTURNED
    if scale is None:
        stretched = similarity(plugin.transform()[:3, :3]) is None
        shown = ", where Mitsuba 3 shows a sphere" if stretched else ""
        importer.notes.add(f"an ellipsoid is made of triangles{shown}", plugin.element)
    elif turned_round and (look.looks_at_uv or any(map(anisotropic, leaves(look.bsdf)))):
        importer.notes.add("a sphere that is turned and has a texture, or a direction, is made of triangles", plugin.element)
    elif inside_out and look.emits:
        importer.notes.add("a sphere that emits inwards is made of triangles", plugin.element)
    else:
        material = _round_material(importer, look, inside_out)
        return Sphere(triple(matrix[:3, 3]), scale, material, **sides_of(importer, plugin, inside_out))
    return _mesh(importer, plugin, look, tessellate.sphere(SEGMENTS, RINGS), matrix, inside_out)


def _cylinder(importer: Importer, plugin: Plugin, look: Look) -> Single:
    matrix, radius = plugin.transform(), plugin.positive("radius", default=1.0)
    ends = [np.array(plugin.point(name, default)) for name, default in (("p0", (0.0, 0.0, 0.0)), ("p1", (0.0, 0.0, 1.0)))]
    length = float(np.linalg.norm(ends[1] - ends[0]))
    if length == 0.0:
        raise plugin.refuse("p1 must differ from p0")
    inside_out = plugin.boolean("flip_normals", default=False)
    axis = (ends[1] - ends[0]) / length
    local = np.eye(4)
    local[:3] = np.stack([*(side * radius for side in mitsuba_frame(axis)), axis * length, ends[0]], axis=1)
    matrix = matrix @ local
    round_radius = _round(matrix[:3, 0], matrix[:3, 1])
    along = matrix[:3, 2] / max(float(np.linalg.norm(matrix[:3, 2])), 1e-300)
    upright = round_radius is not None and max(abs(float(matrix[:3, i] @ along)) for i in (0, 1)) <= 1e-4 * round_radius
    if round_radius is None or not upright:
        importer.notes.add("a stretched or sheared cylinder is made of triangles", plugin.element)
    elif look.looks_at_uv:
        importer.notes.add("a textured cylinder is made of triangles", plugin.element)
    elif inside_out and look.emits:
        importer.notes.add("a cylinder that emits inwards is made of triangles", plugin.element)
    else:
        p0, p1 = matrix[:3, 3], matrix[:3, 3] + matrix[:3, 2]
        sides = sides_of(importer, plugin, inside_out)
        return Cylinder(triple(p0), triple(p1), round_radius, _round_material(importer, look, inside_out), **sides)
    return _mesh(importer, plugin, look, tessellate.cylinder(SEGMENTS), matrix, inside_out)


def _from_file(importer: Importer, plugin: Plugin, look: Look) -> Mesh:
    """OBJ, PLY or serialized: one mesh, whatever groups and materials the file has."""
    key = (id(plugin), "mesh")
    if key not in importer.built:
        importer.built[key] = _read(importer, plugin, look)
    vertices, faces, normals, uvs, named, exchanged = importer.built[key]
    for name in sorted(look.attributes - named.keys()):
        raise plugin.refuse(f"material {look.name!r} shows the attribute {name!r}, which the file does not have")
    if uvs is None and look.looks_at_uv:
        importer.notes.add(f"a textured mesh without texture coordinates: each triangle shows {PART}", plugin.element)
    return finished(importer, plugin, look, vertices, faces, normals, uvs, exchanged, named)


def _read(importer: Importer, plugin: Plugin, look: Look) -> tuple[Any, ...]:
    """Vertices, faces, normals, texture coordinates and attributes of a file as its `to_world` places them; and (m,) what
    `sides_of` calls `exchanged`."""
    named, matrix = plugin.file("filename"), plugin.transform()
    turn, flat = plugin.boolean("flip_normals", default=False), plugin.boolean("face_normals", default=False)
    data = _mesh_data(importer, plugin, named, flat, look)
    vertices, faces = placed(matrix, data.vertices), data.faces
    importer.check_finite(plugin, vertices)
    if flat:
        turned_over = np.full(len(faces), turn)
        return vertices, _swapped(faces, turned_over), None, data.uvs, data.attributes, turned_over != turn
    own = data.normals
    normals = angle_weighted_normals(vertices, faces) if own is None else transformed_normals(matrix, own)
    vertices, faces, normals, uvs, replaced, copied = with_face_normals(vertices, faces, normals, data.uvs)
    if replaced:
        importer.notes.add(faceted(replaced), named)
    normals = -normals if turn else normals
    swapped = against(vertices, faces, normals)
    return vertices, _swapped(faces, swapped), normals, uvs, of_copies(data.attributes, copied), swapped != turn


def _mesh_data(importer: Importer, plugin: Plugin, named: Element, flat: bool, look: Look) -> MeshData:
    """Vertices, faces, texture coordinates, (unless `flat`) normals and the attributes that `look` shows of the file that is
    named."""
    node, suffix = named.located(named.attributes["value"]), f".{plugin.type}"
    shape_index = plugin.integer("shape_index", default=0, low=0, high=2**31 - 1) if suffix == ".serialized" else 0
    flip = plugin.boolean("flip_tex_coords", default=suffix == ".obj") if suffix != ".serialized" else False
    file = importer.place.find(node, node.value)
    data = read_mesh_file(node, file, not flat, True, shape_index, flip, suffix, look.attributes)
    for note in data.warnings:
        importer.notes.add(note, named)
    if flip and suffix != ".obj" and data.uvs is not None:
        data = replace(data, uvs=data.uvs * [1.0, -1.0] + [0.0, 1.0])
    return data


def _round(s: NDArray[np.float64], t: NDArray[np.float64]) -> float | None:
    """The radius of the ellipse with these half axes, where it is a circle."""
    a, b = float(np.linalg.norm(s)), float(np.linalg.norm(t))
    mean = (a + b) / 2.0
    if mean == 0.0 or abs(a - b) > 1e-4 * mean or abs(float(s @ t)) > 1e-4 * mean**2:
        return None
    return mean


def _round_material(importer: Importer, look: Look, inside_out: bool) -> int:
    seen = look.bsdf if look.bsdf is None or not inside_out else turned(look.bsdf)
    return importer.material(seen, look.radiance, look.name)


SHAPES: dict[str, Callable[[Importer, Plugin, Look], Single]] = {
    "rectangle": _flat,
    "cube": _flat,
    "disk": _of_disk,
    "sphere": _sphere,
    "cylinder": _cylinder,
    "obj": _from_file,
    "ply": _from_file,
    "serialized": _from_file,
}
GROUPS = ("merge", "shapegroup", "instance")
"""Plugins that `groups` takes apart."""
REFUSED = {
    "hair": "curves are not supported: use a mesh of tubes",
    "bsplinecurve": "curves are not supported: use a mesh of tubes",
    "linearcurve": "curves are not supported: use a mesh of tubes",
    "sdfgrid": "distance fields are not supported: use a mesh of the surface",
    "ellipsoids": "Gaussians are not supported: use a mesh",
    "ellipsoidsmesh": "Gaussians are not supported: use a mesh",
    "heightfield": "is not supported: use a mesh",
    "deformable": "motion is not supported: use a mesh of one moment",
    "blender": "is made by a program: export a PLY file",
}

"""A whole scene from a glTF file: its nodes with meshes, cameras and lights."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engines.scene.bsdf_tree import has_null_lobes
from engines.scene.cameras import LARGEST_SIDE, Orthographic, Perspective
from engines.scene.context import SceneReader
from engines.scene.files import Place
from engines.scene.frames import LARGEST, Matrix, mirrored
from engines.scene.gltf.document import (
    DECOMPRESS,
    TO_PNG,
    Document,
    a_list,
    child,
    extension,
    listed,
    mapping,
    name_of,
    number,
    numbers,
    optional,
    read_document,
    required,
)
from engines.scene.gltf.materials import Materials
from engines.scene.gltf.meshes import Meshes
from engines.scene.gltf.textures import Textures
from engines.scene.lights import LIGHTS, DirectionalLight, Light, PointLight, SpotLight
from engines.scene.mesh import Mesh
from engines.scene.mesh_scene import FOV, RESOLUTION, VIEW, framing, neutral_lights
from engines.scene.notes import Notes
from engines.scene.scene import Scene, assembled
from engines.scene.triple import Triple, product, triple
from engines.schema import fields
from engines.schema.yaml_file import Located, locate

KNOWN = {
    *("KHR_lights_punctual", "KHR_mesh_quantization", "KHR_texture_transform", "EXT_texture_webp", "EXT_mesh_gpu_instancing"),
    *("KHR_materials_clearcoat", "KHR_materials_emissive_strength", "KHR_materials_ior", "KHR_materials_sheen"),
    *("KHR_materials_specular", "KHR_materials_transmission", "KHR_materials_unlit", "KHR_materials_volume"),
}
"""Extensions that are read."""
VARIANTS = "KHR_materials_variants"
"""A file may require it, and is shown without it."""
REMEDIES = {
    "KHR_draco_mesh_compression": DECOMPRESS,
    "EXT_meshopt_compression": "export it without compression",
    "KHR_meshopt_compression": "export it without compression",
    "KHR_texture_basisu": TO_PNG,
    "KHR_materials_pbrSpecularGlossiness": "convert its materials, such as with gltf-transform's metalrough",
    VARIANTS: "materials are those by default",
}
"""What helps where an extension is not read."""
MAX_NODES = 200_000
NARROWEST = 1e-3
"""Degrees: the least half angle of a spot light's cone."""


def gltf_scene(file: Path, place: Place) -> Scene:
    """The scene of a `.glb` or `.gltf` file.

    Without a camera in it, it is framed as a mesh file is; without lights, it stands under the same sky. What was approximated
    or left out stands in the warnings of the scene. Raises `SceneError` for what is wrong or cannot be shown.
    """
    document = read_document(file, place)
    reader = SceneReader(place, file.stem, str(file))
    notes = Notes()
    _check_extensions(document, notes)
    materials = Materials(document, reader, notes, Textures(document, reader.images, notes))
    importer = _Importer(document, notes, Meshes(document, reader, notes, materials))
    importer.read()
    shapes, lights = importer.shapes, importer.lights
    if not shapes:
        raise document.root.refuse("holds no triangles that its scene shows")
    camera, towards = _camera(importer)
    if not lights:
        lights = [LIGHTS.read(locate(each), reader) for each in neutral_lights(towards, np.array(camera.up))]
    reader.warnings += notes.sentences()
    # lights that no ray can meet are found through masks and thin panes by shadow rays alone
    through = any(has_null_lobes(material.as_bsdf) for material in reader.table.materials)
    shader = {"name": "path_tracer", "transparent_shadows": True} if through else None
    return assembled(reader, file.stem, camera, shapes, lights, shader)


def _check_extensions(document: Document, notes: Notes) -> None:
    needed = [fields.text(each) for each in listed(document.root, "extensionsRequired")]
    for name in needed:
        if name not in KNOWN | {VARIANTS}:
            remedy = REMEDIES.get(name, "save it without")
            raise document.root.refuse_key("extensionsRequired", f"{name[:80]!r} is not read: {remedy}")
    for each in listed(document.root, "extensionsUsed"):
        if (name := fields.text(each)) not in KNOWN:
            notes.add(": ".join(["not read", *([REMEDIES[name]] if name in REMEDIES else [])]), f"extension {name[:80]!r}")
    if a_list(document.root, "animations").value:
        notes.add("its animations are not played: it is at rest", "the scene")


def _camera(importer: _Importer) -> tuple[Perspective | Orthographic, NDArray[np.float64]]:
    """The camera of the file or one that frames it, and the unit vector towards it."""
    if importer.cameras:
        if len(importer.cameras) > 1:
            importer.notes.add(f"of {len(importer.cameras)} cameras the first is taken", "the scene")
        camera = importer.cameras[0]
        return camera, np.subtract(camera.eye, camera.target) / np.linalg.norm(np.subtract(camera.eye, camera.target))
    towards = np.array(VIEW[0]) / np.linalg.norm(VIEW[0])
    points = np.concatenate([shape.vertices[np.unique(shape.faces)] for shape in importer.shapes])
    camera = Perspective(triple(towards), (0.0, 0.0, 0.0), VIEW[1], FOV, "y", RESOLUTION)
    return framing(camera, points, towards), towards


@dataclass(slots=True)
class _Importer:
    """The nodes of the scene that is shown, and what they hold."""

    document: Document
    notes: Notes
    meshes: Meshes
    shapes: list[Mesh] = field(default_factory=list)
    lights: list[Light] = field(default_factory=list)
    cameras: list[Perspective | Orthographic] = field(default_factory=list)
    worlds: dict[int, Matrix] = field(default_factory=dict)
    joints: dict[int, NDArray[np.float64]] = field(default_factory=dict)
    """The transforms of nodes that have been visited, and of the joints of skins."""

    def read(self) -> None:
        """Visits the nodes of the default scene, or of the first. Raises `SceneError`."""
        visited = list(self._visit())
        for node in visited:
            world = self.worlds[int(node.path[-1])]
            mesh, camera, light = optional(node, "mesh"), optional(node, "camera"), extension(node, "KHR_lights_punctual")
            if mesh is not None:
                self._mesh(node, mesh, world)
            if camera is not None:
                self.cameras.append(_seen(self.document.item("cameras", camera), world))
            if light is not None:
                self.lights.append(self._light(required(light, "light"), world))

    def _visit(self) -> Iterator[Located]:
        """Every node with its transform in `worlds`, from the roots; none twice."""
        if (count := len(a_list(self.document.root, "nodes").value)) > MAX_NODES:
            raise self.document.root.refuse_key("nodes", f"there are {count}: at most {MAX_NODES:,} are read")
        root = self.document.root
        if a_list(root, "scenes").value:
            index = optional(root, "scene") or child(root, 0, "scene")
            roots = list(listed(self.document.item("scenes", index), "nodes"))
        else:
            roots = self._parentless()
        waiting = [(each, np.eye(4)) for each in reversed(roots)]
        while waiting:
            named, outer = waiting.pop()
            node = self.document.item("nodes", named)
            if named.value in self.worlds:
                raise named.refuse("this node is its own ancestor, or has two parents: a tree is expected")
            with np.errstate(over="ignore", invalid="ignore"):
                world = outer @ _local(node)
            if not (np.abs(world) < LARGEST).all():
                raise node.refuse("its transform leaves the range of numbers")
            self.worlds[named.value] = world
            yield node
            waiting += [(each, world) for each in reversed(list(listed(node, "children")))]

    def _parentless(self) -> list[Located]:
        """Of a file without scenes, the nodes that are no child of another one."""
        self.notes.add("the file does not say what it shows: all nodes are shown", "the scene")
        nodes = list(listed(self.document.root, "nodes"))
        children = {fields.integer(each, 0, 2**53) for node in nodes for each in listed(mapping(node), "children")}
        return [child(node, index) for index, node in enumerate(nodes) if index not in children]

    def _mesh(self, node: Located, mesh: Located, world: Matrix) -> None:
        skin, copies = optional(node, "skin"), extension(node, "EXT_mesh_gpu_instancing")
        joints = None if skin is None else self._joints(skin)
        for matrix in [world] if copies is None else self._copies(copies, world):
            self.shapes += self.meshes.placed(mesh, matrix, joints)

    def _joints(self, named: Located) -> NDArray[np.float64]:
        """(k, 4, 4) from the space of the mesh to the scene's, for each joint of a skin."""
        skin = self.document.item("skins", named)
        if named.value not in self.joints:
            self.notes.add("it is shown in the pose of its nodes", f"skin {name_of(skin, 'skin')!r}")
            self.joints[named.value] = self._bound(skin)
        return self.joints[named.value]

    def _bound(self, skin: Located) -> NDArray[np.float64]:
        worlds = []
        for each in listed(skin, "joints"):
            self.document.item("nodes", each)
            if each.value not in self.worlds:
                raise each.refuse("this joint is no node of the scene")
            worlds.append(self.worlds[each.value])
        if not worlds:
            raise skin.refuse_key("joints", "is missing or empty")
        bound = optional(skin, "inverseBindMatrices")
        if bound is None:
            return np.array(worlds)
        inverse = self.document.array(bound, ("MAT4",)).reshape(-1, 4, 4).transpose(0, 2, 1)
        if len(inverse) < len(worlds):
            raise bound.refuse(f"has {len(inverse)} matrices for {len(worlds)} joints")
        with np.errstate(over="ignore", invalid="ignore"):
            return np.array(worlds) @ inverse[: len(worlds)]

    def _copies(self, node: Located, world: Matrix) -> Iterator[Matrix]:
        """The transforms of EXT_mesh_gpu_instancing."""
        given = mapping(required(node, "attributes"))
        parts = {
            key: None if (found := optional(given, key)) is None else self.document.array(found, (kind,))
            for key, kind in (("TRANSLATION", "VEC3"), ("ROTATION", "VEC4"), ("SCALE", "VEC3"))
        }
        counts = {len(array) for array in parts.values() if array is not None}
        if len(counts) != 1:
            raise given.refuse("TRANSLATION, ROTATION and SCALE, as far as they are there, must be of one length")
        for index in range(counts.pop()):
            t, r, s = (None if array is None else tuple(array[index].tolist()) for array in parts.values())
            local = _matrix(node, t or (0.0, 0.0, 0.0), r or (0.0, 0.0, 0.0, 1.0), s or (1.0, 1.0, 1.0))
            with np.errstate(over="ignore", invalid="ignore"):
                matrix = world @ local
            if not (np.abs(matrix) < LARGEST).all():
                raise node.refuse("its transforms leave the range of numbers")
            yield matrix

    def _light(self, named: Located, world: Matrix) -> Light:
        root = self.document.root
        light = self.document.item("lights", named, extension(root, "KHR_lights_punctual") or child(root, {}))
        intensity = number(light, "intensity", 1.0)
        color = product(triple(numbers(light, "color", (1.0, 1.0, 1.0))), intensity)
        if min(color) < 0.0 or not max(color) < LARGEST:
            raise light.refuse(f"color times intensity must lie in [0, {LARGEST:g}]")
        kind = fields.one_of(required(light, "type"), ("directional", "point", "spot"), "type of light")
        name = f"light {name_of(light, 'light')!r}"
        position, direction = triple(world[:3, 3]), fields.unit(triple(-world[:3, 2]))
        if optional(light, "range") is not None and kind != "directional":
            self.notes.add("its range is left out: it falls off with the square of the distance", name)
        if kind == "point":
            return PointLight(position, color)
        if direction is None:
            raise light.refuse("the scale of its node leaves it no direction")
        return (
            DirectionalLight(direction, color) if kind == "directional" else self._spot(light, name, position, direction, color)
        )

    def _spot(self, light: Located, name: str, position: Triple, direction: Triple, color: Triple) -> SpotLight:
        spot = optional(light, "spot") or child(light, {}, "spot")
        inner, outer = number(spot, "innerConeAngle", 0.0), number(spot, "outerConeAngle", math.pi / 4.0)
        if not 0.0 <= inner <= outer <= math.pi / 2.0 + 1e-6 or outer == 0.0:
            raise spot.refuse("0 <= innerConeAngle <= outerConeAngle <= pi / 2 are expected, and outerConeAngle above 0")
        self.notes.add("between its cones it falls off linearly with the angle", name)
        cutoff = max(math.degrees(outer), NARROWEST)
        return SpotLight(position, direction, color, cutoff, max(math.degrees(inner), NARROWEST))


def _local(node: Located) -> Matrix:
    """(4, 4) the transform of a node within its parent."""
    if optional(node, "matrix") is not None:
        matrix = np.array(numbers(node, "matrix", (0.0,) * 16)).reshape(4, 4).T
        if not np.allclose(matrix[3], [0.0, 0.0, 0.0, 1.0], 0.0, 1e-6):
            raise node.refuse_key("matrix", "must be affine: its last row must be 0, 0, 0, 1")
        return matrix
    translation, scale = numbers(node, "translation", (0.0, 0.0, 0.0)), numbers(node, "scale", (1.0, 1.0, 1.0))
    return _matrix(node, translation, numbers(node, "rotation", (0.0, 0.0, 0.0, 1.0)), scale)


def _matrix(node: Located, translation: tuple[float, ...], rotation: tuple[float, ...], scale: tuple[float, ...]) -> Matrix:
    """(4, 4) of a translation, a quaternion x, y, z, w, and scales."""
    length = math.hypot(*rotation)
    if not 0.0 < length < math.inf:
        raise node.refuse("a rotation must be a quaternion, and not 0")
    x, y, z, w = (each / length for each in rotation)
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    with np.errstate(over="ignore", invalid="ignore"):
        matrix[:3, :3] *= scale
    matrix[:3, 3] = translation
    return matrix


def _seen(camera: Located, world: Matrix) -> Perspective | Orthographic:
    """The camera of a node: it looks along -z, and +y is up."""
    eye = world[:3, 3]
    forward, up = fields.unit(triple(-world[:3, 2])), fields.unit(triple(world[:3, 1]))
    if forward is None or up is None or np.linalg.norm(np.cross(forward, up)) < 1e-6:
        raise camera.refuse("the transform of its node leaves it no direction")
    # a target as far away as the eye is from the origin: the direction keeps its digits
    target = eye + np.array(forward) * max(1.0, float(np.abs(eye).max()))
    frame = {"eye": triple(eye), "target": triple(target), "up": up, "mirror": mirrored(world)}
    if fields.one_of(required(camera, "type"), ("perspective", "orthographic"), "type of camera") == "perspective":
        lens = mapping(required(camera, "perspective"))
        yfov = fields.within(required(lens, "yfov"), 1e-4, math.pi - 1e-4)
        aspect = number(lens, "aspectRatio", RESOLUTION[0] / RESOLUTION[1])
        return Perspective(**frame, fov=math.degrees(yfov), fov_axis="y", resolution=_resolution(lens, aspect))
    lens = mapping(required(camera, "orthographic"))
    xmag, ymag = (abs(fields.number(required(lens, key))) for key in ("xmag", "ymag"))
    if not 0.0 < min(xmag, ymag) <= max(xmag, ymag) < LARGEST:
        raise lens.refuse("xmag and ymag must not be 0")
    return Orthographic(**frame, height=2.0 * ymag, resolution=_resolution(lens, xmag / ymag))


def _resolution(lens: Located, aspect: float) -> tuple[int, int]:
    """Of an image with this ratio of width to height, the height that images of meshes have."""
    height = RESOLUTION[1]
    if not 1.0 / height <= aspect <= LARGEST_SIDE / height:
        raise lens.refuse(f"its width is {aspect:g} times its height: must lie in [1/{height}, {LARGEST_SIDE // height}]")
    return round(height * aspect), height

"""A whole scene from Mitsuba's XML."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.scene.cameras import Camera, CustomCamera, Orthographic, Perspective, PerspectiveArctan, ThinLens
from engines.scene.context import SceneReader
from engines.scene.lights import EnvironmentLight, Light
from engines.scene.mesh import Mesh
from engines.scene.mitsuba_xml.context import Importer
from engines.scene.mitsuba_xml.document import Document, Element
from engines.scene.mitsuba_xml.emitters import light
from engines.scene.mitsuba_xml.groups import shapes
from engines.scene.mitsuba_xml.integrators import shader
from engines.scene.mitsuba_xml.properties import Plugin, plugin_tree
from engines.scene.mitsuba_xml.sensors import camera
from engines.scene.mitsuba_xml.transforms import has_odd_axis
from engines.scene.notes import Notes, enumeration
from engines.scene.scene import Scene, assembled
from engines.scene.shapes import Shape

CLIP_REACH = 4.0
"""Distance of the corners of the near plane from the eye, in distances of the plane, at least: 1 / cos(75 degrees)."""


def import_scene(document: Document) -> Scene:
    """The scene of a Mitsuba XML file, of version 0.4 to 3.x.

    What was dropped or approximated stands in the warnings of the scene. Raises `SceneError` with file and line for what is
    wrong, and for what is not supported.
    """
    file, root = document.file, document.root
    ids: dict[str, Plugin] = {}
    tree = plugin_tree(root, ids)
    name = file.resolve().parent.name if file.stem == "scene" else file.stem
    reader = SceneReader(document.place, name, str(file))
    importer = Importer(reader, ids, Notes(lambda element: element.line_within(str(file))))
    _note_axes(importer, root)
    seen = _camera(importer, tree)
    lights = _lights(importer, tree)
    all_shapes: list[Shape] = []
    for plugin in importer.taken(tree, "shape"):
        all_shapes += shapes(importer, plugin)
    suggested = _integrator(importer, tree)
    _finish(importer, tree)
    reader.warnings += importer.notes.sentences()
    seen = _unclipped(seen, all_shapes)
    return assembled(reader, name, seen, all_shapes, lights, suggested, tuple(importer.media))


def _note_axes(importer: Importer, element: Element) -> None:
    if element.tag == "rotate" and has_odd_axis(element):
        # of spheres, disks and cylinders Mitsuba 3 takes the transpose for the inverse of such a rotation
        taken = "taken as it is, as in Mitsuba 3: shapes are distorted (spheres, disks and cylinders in another way there)"
        said = "scaled to it, as in Mitsuba 0.x" if element.source.old else taken
        importer.notes.add(f"the axis of a rotation is not of length 1, and {said}", element)
    for child in element.children:
        _note_axes(importer, child)


def _integrator(importer: Importer, tree: Plugin) -> dict[str, Any] | None:
    integrators = importer.taken(tree, "integrator")
    if len(integrators) > 1:
        importer.notes.add("of several integrators the first is taken", integrators[1].element)
    return shader(importer, integrators[0]) if integrators else None


def _camera(importer: Importer, tree: Plugin) -> Camera:
    sensors = importer.taken(tree, "sensor")
    if not sensors:
        raise tree.refuse("has no sensor")
    if len(sensors) > 1:
        importer.notes.add(f"of {len(sensors)} sensors the first is taken", sensors[1].element)
    return camera(importer, sensors[0])


def _lights(importer: Importer, tree: Plugin) -> list[Light]:
    lights: list[Light] = []
    for plugin in importer.taken(tree, "emitter"):
        if plugin.type == "area":
            continue  # that of a shape which refers to it
        made = light(importer, plugin)
        if isinstance(made, EnvironmentLight) and any(isinstance(other, EnvironmentLight) for other in lights):
            raise plugin.refuse("a second environment: a scene may have one")
        lights.append(made)
    return lights


def _finish(importer: Importer, tree: Plugin) -> None:
    """Notes about the scene as a whole. BSDFs, textures and media that nothing refers to are left aside."""
    importer.taken(tree, "bsdf", "texture", "spectrum", "medium", "phase", "volume")
    for emitter in importer.taken(tree, "emitter"):
        if emitter.type == "area" and id(emitter) not in importer.emitting:
            importer.notes.add("an area emitter of no shape gives no light", emitter.element)
    for sampler in importer.taken(tree, "sampler"):
        importer.notes.drop(f"sampler {sampler.type}")
    for film in importer.taken(tree, "film", "rfilter"):
        importer.notes.drop(f"{film.kind} {film.type}")
    tree.read.add("embree_use_robust_intersections")
    importer.finish(tree)
    if importer.one_sided:
        named = enumeration(importer.one_sided)
        importer.reader.warnings.append(f"black from behind, as they are outside of twosided: {named}")


# ---- clipping planes -------------------------------------------------------------------------------------------------


def _unclipped(seen: Camera, scene_shapes: list[Shape]) -> Camera:
    """The camera without clipping planes that cannot clip anything: rays that need not be clipped are cheaper. In a
    medium rays start at the near plane."""
    if isinstance(seen, CustomCamera | PerspectiveArctan) or seen.medium is not None:
        return seen
    near, far = seen.clip
    eye, axis = np.array(seen.eye), np.subtract(seen.target, seen.eye)
    axis /= np.linalg.norm(axis)
    boxes = [_boxes(shape) for shape in scene_shapes]
    low, high = (np.concatenate([box[side] for box in boxes] or [np.empty((0, 3))]) for side in (0, 1))
    # the farthest and nearest depth of any corner of each box
    center, half = (low + high) / 2.0 - eye, (high - low) / 2.0
    depth, spread = center @ axis, half @ np.abs(axis)
    if (depth + spread).max(initial=0.0) < far:
        far = np.inf
    distance = np.linalg.norm(np.maximum(np.maximum(low - eye, eye - high), 0.0), axis=1)
    behind_the_plane = (depth - spread > near) | (distance > _reach(seen) * near) | (depth + spread < 0.0)
    if behind_the_plane.all():
        near = 0.0
    return replace(seen, clip=(near, far))


def _reach(seen: Perspective | ThinLens | Orthographic) -> float:
    """Distance of the farthest corner of the near plane from the eye, in distances of the plane."""
    if isinstance(seen, Orthographic):
        return np.inf
    tangent, aspect = math.tan(math.radians(seen.fov) / 2.0), seen.resolution[0] / seen.resolution[1]
    half = np.array([tangent, tangent / aspect] if seen.fov_axis == "x" else [tangent * aspect, tangent])
    corner = half * (1.0 + 2.0 * np.abs(seen.principal_point))
    return max(CLIP_REACH, math.hypot(1.0, *corner))


def _boxes(shape: Shape) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n, 3) lowest and highest coordinates, of a mesh those of each face."""
    if isinstance(shape, Mesh):
        corners = shape.vertices[shape.faces]
        return corners.min(axis=1), corners.max(axis=1)
    box = shape.bounds()
    assert box is not None
    return box[:1], box[1:]

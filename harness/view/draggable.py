"""Objects that can be dragged: spheres, emitting shapes, lights that stand at a point; and the scene with an object moved."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from engines.scene import Cylinder, Disk, Mesh, PointLight, ProjectorLight, Scene, Shape, Sphere, SpotLight, Triangle
from harness.view.projection import Vector

_PLACED = PointLight | SpotLight | ProjectorLight
"""Lights that stand at a point."""


class Draggable(NamedTuple):
    """An object that can be dragged. `id`, such as `shape:3` or `light:0`, has its index in the scene."""

    id: str
    name: str
    kind: str

    @property
    def scene_index(self) -> int:
        return int(self.id.partition(":")[2])

    @property
    def is_shape(self) -> bool:
        return self.id.startswith("shape:")


def draggables(scene: Scene) -> list[Draggable]:
    """All objects of the scene that can be dragged, shapes first."""
    return [*_shapes(scene), *_lights(scene)]


def _shapes(scene: Scene) -> Iterator[Draggable]:
    spheres = emitters = 0
    for index, shape in enumerate(scene.shapes):
        if not isinstance(shape, (Sphere, Triangle, Mesh, Disk, Cylinder)):
            continue
        used = shape.materials[:1].tolist() if isinstance(shape, Mesh) else [shape.material]
        material = scene.materials[used[0]]
        if material.emits:
            emitters += 1
            yield Draggable(f"shape:{index}", f"light {emitters} ({material.name})", "light")
        elif isinstance(shape, Sphere):
            spheres += 1
            yield Draggable(f"shape:{index}", f"sphere {spheres} ({material.name})", "sphere")


def _lights(scene: Scene) -> Iterator[Draggable]:
    for index, light in enumerate(scene.lights):
        if isinstance(light, _PLACED):
            kind = type(light).__name__.removesuffix("Light").lower()
            yield Draggable(f"light:{index}", f"{kind} light {index + 1}", kind)


def center(scene: Scene, draggable: Draggable) -> Vector:
    """The centre of an object; for triangles and meshes that of the bounding box, for cylinders that of the axis."""
    if not draggable.is_shape:
        light = scene.lights[draggable.scene_index]
        assert isinstance(light, _PLACED)
        return np.array(light.position)
    shape = scene.shapes[draggable.scene_index]
    if isinstance(shape, (Sphere, Disk)):
        return np.array(shape.center)
    corners = shape.vertices if isinstance(shape, Mesh) else np.array(_corners(shape))
    return (corners.min(axis=0) + corners.max(axis=0)) / 2


def _corners(shape: Any) -> tuple[Any, ...]:
    return (shape.p0, shape.p1) if isinstance(shape, Cylinder) else (shape.a, shape.b, shape.c)


def moved(scene: Scene, draggable: Draggable, offset: Vector) -> Scene:
    """The scene with an object moved by `offset`; a light keeps its direction. The content hash is not updated."""
    if draggable.is_shape:
        shapes = list(scene.shapes)
        shapes[draggable.scene_index] = _moved_shape(shapes[draggable.scene_index], offset)
        return replace(scene, shapes=tuple(shapes))
    lights = list(scene.lights)
    light = lights[draggable.scene_index]
    assert isinstance(light, _PLACED)
    lights[draggable.scene_index] = replace(light, position=_triple(np.array(light.position) + offset))
    return replace(scene, lights=tuple(lights))


def _moved_shape(shape: Shape, offset: Vector) -> Shape:
    if isinstance(shape, (Sphere, Disk)):
        return replace(shape, center=_triple(np.array(shape.center) + offset))
    if isinstance(shape, Cylinder):
        p0, p1 = (_triple(np.array(end) + offset) for end in _corners(shape))
        return replace(shape, p0=p0, p1=p1)
    if isinstance(shape, Triangle):
        a, b, c = (_triple(np.array(corner) + offset) for corner in _corners(shape))
        return replace(shape, a=a, b=b, c=c)
    assert isinstance(shape, Mesh)
    vertices = shape.vertices + offset
    vertices.flags.writeable = False
    return replace(shape, vertices=vertices)


def _triple(vector: Vector) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])

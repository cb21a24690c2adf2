"""What can be dragged: spheres, shapes that emit, and point lights; and what a scene is after it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from engines.scene import Mesh, PointLight, Scene, Shape, Sphere, Triangle
from harness.view.pixels import Vector


class Movable(NamedTuple):
    """`id` is `shape:3` or `light:0`, by place in the scene."""

    id: str
    name: str
    kind: str

    @property
    def place(self) -> int:
        return int(self.id.partition(":")[2])

    @property
    def is_shape(self) -> bool:
        return self.id.startswith("shape:")


def movables(scene: Scene) -> list[Movable]:
    """Everything in the scene that can be dragged, shapes first."""
    return [*_shapes(scene), *_lights(scene)]


def _shapes(scene: Scene) -> Iterator[Movable]:
    spheres = lamps = 0
    for index, shape in enumerate(scene.shapes):
        if not isinstance(shape, (Sphere, Triangle, Mesh)):
            continue
        used = shape.materials[:1].tolist() if isinstance(shape, Mesh) else [shape.material]
        material = scene.materials[used[0]]
        if material.emits:
            lamps += 1
            yield Movable(f"shape:{index}", f"light {lamps} ({material.name})", "light")
        elif isinstance(shape, Sphere):
            spheres += 1
            yield Movable(f"shape:{index}", f"sphere {spheres} ({material.name})", "sphere")


def _lights(scene: Scene) -> Iterator[Movable]:
    for index, light in enumerate(scene.lights):
        if isinstance(light, PointLight):
            yield Movable(f"light:{index}", f"point light {index + 1}", "point")


def center(scene: Scene, movable: Movable) -> Vector:
    """The middle of a thing: of its box, for meshes."""
    if not movable.is_shape:
        light = scene.lights[movable.place]
        assert isinstance(light, PointLight)
        return np.array(light.position)
    shape = scene.shapes[movable.place]
    if isinstance(shape, Sphere):
        return np.array(shape.center)
    corners = shape.vertices if isinstance(shape, Mesh) else np.array(_corners(shape))
    return (corners.min(axis=0) + corners.max(axis=0)) / 2


def _corners(shape: Any) -> tuple[Any, Any, Any]:
    return shape.a, shape.b, shape.c


def moved(scene: Scene, movable: Movable, offset: Vector) -> Scene:
    """The scene with that thing moved; its content hash is still the old one."""
    if movable.is_shape:
        shapes = list(scene.shapes)
        shapes[movable.place] = _moved_shape(shapes[movable.place], offset)
        return replace(scene, shapes=tuple(shapes))
    lights = list(scene.lights)
    light = lights[movable.place]
    assert isinstance(light, PointLight)
    lights[movable.place] = replace(light, position=_triple(np.array(light.position) + offset))
    return replace(scene, lights=tuple(lights))


def _moved_shape(shape: Shape, offset: Vector) -> Shape:
    if isinstance(shape, Sphere):
        return replace(shape, center=_triple(np.array(shape.center) + offset))
    if isinstance(shape, Triangle):
        a, b, c = (_triple(np.array(corner) + offset) for corner in _corners(shape))
        return replace(shape, a=a, b=b, c=c)
    assert isinstance(shape, Mesh)
    vertices = shape.vertices + offset
    vertices.flags.writeable = False
    return replace(shape, vertices=vertices)


def _triple(vector: Vector) -> tuple[float, float, float]:
    return float(vector[0]), float(vector[1]), float(vector[2])

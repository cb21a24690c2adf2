"""Lights as rows: the list of docs/transport.md, and which of them each primitive belongs to.

A light's parameters are up to `LIGHT_PARAMETERS` numbers, whose meaning its kind fixes; its lane function `sample` reads them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.kernels.flatten import shapes
from engines.kernels.flatten.plugins import kind_of, light_sample
from engines.kernels.flatten.programs import NONE, plain_emission
from engines.kernels.lane import lights as lane_lights
from engines.kernels.rows import LightFrameRow, LightRow
from engines.scene import (
    CustomLight,
    Cylinder,
    DirectionalLight,
    Disk,
    EnvironmentLight,
    Light,
    Material,
    Mesh,
    PointLight,
    ProjectorLight,
    Sphere,
    SphereSet,
    SpotLight,
    Texture,
    Triangle,
)
from engines.scene.support import option_numbers

POINT, DIRECTIONAL, CONSTANT_ENVIRONMENT, IMAGE_ENVIRONMENT, MESH, SPHERE, DISK, SPOT, CYLINDER, PROJECTOR = range(10)

Reals = NDArray[np.float64]


class LightModel(NamedTuple):
    """A kind of light in kernels."""

    sample: Any
    """Its lane function; None for the environment's image, which is sampled by table."""
    parameters: int
    """How many of a row's parameters it reads."""
    pdf: Any = None
    """Of a shape that emits: the lane function with which hits of it are weighted."""
    shape: int = -1
    """The kind of that shape."""


MODELS: dict[int, LightModel] = {
    POINT: LightModel(lane_lights.sample_point, 4),
    DIRECTIONAL: LightModel(lane_lights.sample_directional, 3),
    CONSTANT_ENVIRONMENT: LightModel(lane_lights.sample_constant_environment, 0),
    IMAGE_ENVIRONMENT: LightModel(None, 0),
    MESH: LightModel(lane_lights.sample_mesh, 1, lane_lights.mesh_pdf, shapes.TRIANGLE),
    SPHERE: LightModel(lane_lights.sample_sphere, 4, lane_lights.sphere_pdf, shapes.SPHERE),
    DISK: LightModel(lane_lights.sample_disk, 7, lane_lights.disk_pdf, shapes.DISK),
    SPOT: LightModel(lane_lights.sample_spot, 8),
    CYLINDER: LightModel(lane_lights.sample_cylinder, 7, lane_lights.cylinder_pdf, shapes.CYLINDER),
    PROJECTOR: LightModel(lane_lights.sample_projector, 6),
}
"""By kind; those of plugins are added where a scene has them."""


def _point(light: PointLight, center: Reals) -> list[float]:
    parameters = [*np.subtract(light.position, center), light.falloff]
    return LightRow.packed(kind=POINT, color=light.intensity, parameters=parameters)


def _directional(light: DirectionalLight, center: Reals) -> list[float]:
    return LightRow.packed(kind=DIRECTIONAL, color=light.irradiance, parameters=np.negative(light.direction))


def _spot(light: SpotLight, center: Reals) -> list[float]:
    angles = np.radians([light.cutoff, light.beam_width])
    parameters = [*np.subtract(light.position, center), *light.direction, *angles]
    return LightRow.packed(kind=SPOT, color=light.intensity, parameters=parameters)


def _projector(light: ProjectorLight, center: Reals) -> list[float]:
    parameters = [*np.subtract(light.position, center), *light.direction]
    return LightRow.packed(kind=PROJECTOR, color=light.irradiance, parameters=parameters)


def _environment(light: EnvironmentLight, center: Reals) -> list[float]:
    kind = CONSTANT_ENVIRONMENT if light.image is None else IMAGE_ENVIRONMENT
    return LightRow.packed(kind=kind, color=light.radiance)


def plugin_parameters(light: CustomLight, center: Reals) -> list[float]:
    """The options of a plugin in order, but for its colour; points become relative to `center`."""
    options = {name: value for name, value in light.options.items() if name != "color"}
    for name in getattr(light.plugin, "positions", ()):
        options[name] = tuple(np.subtract(options[name], center))
    return option_numbers(options)


def _plugin(light: CustomLight, center: Reals) -> list[float]:
    plugin, parameters = light.plugin, plugin_parameters(light, center)
    kind = kind_of(MODELS, plugin.name, LightModel(light_sample(plugin.jitted), len(parameters)))
    return LightRow.packed(kind=kind, color=light.options.get("color", (1.0, 1.0, 1.0)), parameters=parameters)


ROWS: dict[type, Callable[[Any, Reals], list[float]]] = {
    PointLight: _point,
    DirectionalLight: _directional,
    SpotLight: _spot,
    ProjectorLight: _projector,
    EnvironmentLight: _environment,
    CustomLight: _plugin,
}
"""How a light of the model becomes a row: (light, center) -> numbers."""


def frame_rows(lights: Sequence[Light], texture: Callable[[Texture], int]) -> list[list[float]]:
    """The frames of all listed lights, if one of them shows a texture, whose index is `texture` of it; else none."""
    rows = [_frame(light, texture) for light in lights]
    return rows if any(row[0] != NONE for row in rows) else []


def _frame(light: Light, texture: Callable[[Texture], int]) -> list[float]:
    if not isinstance(light, SpotLight | ProjectorLight) or light.texture is None:
        return LightFrameRow.packed(texture=NONE)
    right = np.cross(light.direction, light.up)
    right /= np.linalg.norm(right)
    down, (x, y) = np.cross(light.direction, right), light.half_extents
    frame = {"axis": light.direction, "across": right / (2.0 * x), "down": down / (2.0 * y)}
    return LightFrameRow.packed(texture=texture(light.texture), **frame)


class LightList:
    """Listed lights first, then the emitting shapes in order."""

    def __init__(self, scene: Any, first_id: list[int], primitives: int, center: Reals) -> None:
        self.rows: list[list[float]] = []
        self.faces: list[Any] = [np.zeros(0, np.int64)]
        self.cdf: list[Any] = [np.zeros(0)]
        self.ranges: list[tuple[int, int]] = []
        self.primitives: list[int] = []
        """Of each light, the id of the shape that it is; -1 of a mesh, and of what is no shape."""
        self.environment = next((light for light in scene.lights if isinstance(light, EnvironmentLight)), None)
        self.of_primitive = np.full(primitives, -1, np.int32)
        self.center = center
        for light in scene.lights:
            self._append(ROWS[type(light)](light, center))
        for shape, first in zip(shapes.outside(scene.shapes), first_id, strict=False):
            self._add_shape(scene.materials, shape, first)

    def kinds(self) -> tuple[int, ...]:
        return tuple(sorted({int(row[0]) for row in self.rows}))

    def _append(self, row: list[float], faces: tuple[int, int] = (0, 0), primitive: int = -1) -> None:
        self.rows.append(row)
        self.ranges.append(faces)
        self.primitives.append(primitive)

    def _add_shape(self, materials: tuple[Material, ...], shape: Any, first: int) -> None:
        if isinstance(shape, (Triangle, Mesh)):
            self._add_faces(materials, shape, first)
            return
        material = materials[shape.material]
        if not material.emits or type(shape) not in SHAPES:
            return
        for k, (kind, parameters) in enumerate(SHAPES[type(shape)](shape, self.center)):
            self.of_primitive[first + k] = len(self.rows)
            emission = {"color": plain_emission(material), "two_sided": material.two_sided}
            self._append(LightRow.packed(kind=kind, parameters=parameters, **emission), primitive=first + k)

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
        self.faces.append(first + chosen)
        sums = np.cumsum(areas)
        self.cdf.append(sums / sums[-1])
        self._append(LightRow.packed(kind=MESH, parameters=[sums[-1]]), (start, len(chosen)))


def _spheres(shape: Any, center: Reals) -> list[tuple[int, list[float]]]:
    if isinstance(shape, Sphere):
        return [(SPHERE, [*np.subtract(shape.center, center), shape.radius])]
    return [(SPHERE, [*(place - center), radius]) for place, radius in zip(shape.centers, shape.radii, strict=True)]


def _disk(shape: Disk, center: Reals) -> list[tuple[int, list[float]]]:
    return [(DISK, [*np.subtract(shape.center, center), *shape.normal, shape.radius])]


def _cylinder(shape: Cylinder, center: Reals) -> list[tuple[int, list[float]]]:
    return [(CYLINDER, [*np.subtract(shape.p0, center), *np.subtract(shape.p1, shape.p0), shape.radius])]


SHAPES: dict[type, Callable[[Any, Reals], list[tuple[int, list[float]]]]] = {
    Sphere: _spheres,
    SphereSet: _spheres,
    Disk: _disk,
    Cylinder: _cylinder,
}
"""How an emitting shape becomes lights, one a primitive: (shape, center) -> (kind, parameters) of each."""

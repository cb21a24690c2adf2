"""What choosing one light among many goes by: the power of each, and where it lies and shines (docs/transport.md).

These numbers steer samples and are no part of an estimate: any positive probability of a light leaves the mean as it is.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.scene.geometry import has_area
from engines.scene.lights import CustomLight, DirectionalLight, EnvironmentLight, PointLight, ProjectorLight, SpotLight
from engines.scene.mesh import Mesh, SphereSet
from engines.scene.scene import Scene
from engines.scene.shapes import Cylinder, Disk, Sphere, Triangle, as_mesh, as_spheres
from engines.scene.textures import mean_color
from engines.scene.triple import product

Array = NDArray[np.float64]

CONE_MARGIN = 1e-3
"""Radians by which the cone of a light is widened, so that rounding at its edge leaves no light unsampled."""
MOST_EXTENT = 4.0
"""Up to here the half extents of a projector's image count in its power. That of a very wide image would leave hardly any
samples to the other lights."""


class LightBounds(NamedTuple):
    """A light: power in W (a plugin's is NaN), box, and cone of directions.

    Light leaves within `reach` of directions that are within `spread` of the unit vector `axis`, in radians. Lights from
    everywhere have no box.
    """

    power: float
    box: Array | None = None
    axis: Array = np.array([0.0, 0.0, 1.0])
    spread: float = math.pi
    reach: float = math.pi / 2


def light_bounds(scene: Scene) -> list[LightBounds]:
    """All lights of a scene in their order: its `lights`, then the shapes that emit and have an area."""
    scale = math.pi * _radius(scene) ** 2
    bounds = [_LISTED[type(light)](light, scale) for light in scene.lights]
    for shape in scene.shapes:
        if type(shape) in _SHAPES:
            bounds += _SHAPES[type(shape)](shape, scene.materials)
    known = [light.power for light in bounds if not math.isnan(light.power)]
    usual = sum(known) / len(known) if known else 1.0
    return [light._replace(power=usual) if math.isnan(light.power) else light for light in bounds]


def light_shares(scene: Scene) -> Array:
    """(J,) powers of a scene's lights as shares of their total; equal shares where the total is 0 or not finite."""
    powers = np.array([light.power for light in light_bounds(scene)], np.float64)
    total = powers.sum()
    return powers / total if 0.0 < total < math.inf else np.full(powers.size, 1.0 / max(powers.size, 1))


def _radius(scene: Scene) -> float:
    """Half the diagonal of the box of all finite shapes, 1 where there are none: what lights from everywhere shine on."""
    boxes = [box for shape in scene.shapes if (box := shape.bounds()) is not None]
    if not boxes:
        return 1.0
    corners = np.concatenate(boxes)
    return float(np.linalg.norm(np.ptp(corners, axis=0))) / 2.0


def _mean(color: Any) -> float:
    return float(np.mean(color))


# ---- the entries of a scene's list -------------------------------------------------------------------------------------


def _point(light: PointLight, scale: float) -> LightBounds:
    if not light.falloff:
        return LightBounds(scale * _mean(light.intensity))
    position = np.array(light.position, np.float64)
    return LightBounds(4.0 * math.pi * _mean(light.intensity), np.stack([position, position]))


def _spot(light: SpotLight, scale: float) -> LightBounds:
    cutoff, beam = math.radians(light.cutoff), math.radians(light.beam_width)
    solid_angle = math.pi * (2.0 - math.cos(beam) - math.cos(cutoff))
    intensity = light.intensity if light.texture is None else product(light.intensity, mean_color(light.texture))
    return _cone(light, solid_angle * _mean(intensity), cutoff, beam)


def _projector(light: ProjectorLight, scale: float) -> LightBounds:
    """As much as its image receives at a distance of 1."""
    half_angle = math.atan(math.hypot(*light.half_extents))
    a, b = (min(half, MOST_EXTENT) for half in light.half_extents)
    return _cone(light, 4.0 * a * b * _mean(product(light.irradiance, mean_color(light.texture))), half_angle, half_angle)


def _cone(light: SpotLight | ProjectorLight, power: float, cutoff: float, beam: float) -> LightBounds:
    position, axis = np.array(light.position, np.float64), np.array(light.direction, np.float64)
    spread = max(beam, cutoff + CONE_MARGIN - math.pi / 2)
    return LightBounds(power, np.stack([position, position]), axis, spread, cutoff + CONE_MARGIN - spread)


def _directional(light: DirectionalLight, scale: float) -> LightBounds:
    return LightBounds(scale * _mean(light.irradiance))


def _environment(light: EnvironmentLight, scale: float) -> LightBounds:
    radiance = _mean(light.radiance)
    if light.image is not None:
        rows = np.sin(np.pi * (np.arange(light.image.shape[0]) + 0.5) / light.image.shape[0])
        texels = np.asarray(light.image, np.float64) * np.array(light.radiance)
        radiance = float((texels.mean(axis=(1, 2)) * rows).sum() / rows.sum())
    return LightBounds(4.0 * math.pi * scale * radiance)


def _plugin(light: CustomLight, scale: float) -> LightBounds:
    return LightBounds(math.nan)


_LISTED: dict[type, Callable[[Any, float], LightBounds]] = {
    PointLight: _point,
    SpotLight: _spot,
    ProjectorLight: _projector,
    DirectionalLight: _directional,
    EnvironmentLight: _environment,
    CustomLight: _plugin,
}


# ---- shapes that emit --------------------------------------------------------------------------------------------------


def _exitance(material: Any) -> float:
    """W/m2, of both sides together."""
    return math.pi * _mean(material.mean_emission) * (2.0 if material.two_sided else 1.0)


def _mesh(given: Triangle | Mesh, materials: Any) -> Iterator[LightBounds]:
    shape = as_mesh(given)
    assert shape is not None
    emitting = np.flatnonzero(np.array([m.emits for m in materials], bool)[shape.materials])
    emitting = emitting[has_area(shape.vertices, shape.faces[emitting])]
    corners = shape.vertices[shape.faces[emitting]]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1)
    if not emitting.size:
        return
    faces = shape.materials[emitting]
    power = float(np.sum(np.array([_exitance(m) for m in materials])[faces] * lengths / 2.0))
    two_sided = any(materials[m].two_sided for m in np.unique(faces))
    axis, spread = (LightBounds._field_defaults["axis"], math.pi) if two_sided else bounding_cone(normals / lengths[:, None])
    yield LightBounds(power, np.stack([corners.min(axis=(0, 1)), corners.max(axis=(0, 1))]), axis, spread)


def _spheres(given: Sphere | SphereSet, materials: Any) -> Iterator[LightBounds]:
    shape = as_spheres(given)
    assert shape is not None
    if materials[shape.material].emits:
        exitance = _exitance(materials[shape.material])
        for center, radius in zip(shape.centers, shape.radii, strict=True):
            power = 4.0 * math.pi * float(radius) ** 2 * exitance
            yield LightBounds(power, np.stack([center - radius, center + radius]))


def _disk(shape: Disk, materials: Any) -> Iterator[LightBounds]:
    material = materials[shape.material]
    if material.emits:
        axis, spread = np.array(shape.normal, np.float64), math.pi if material.two_sided else 0.0
        yield LightBounds(math.pi * shape.radius**2 * _exitance(material), shape.bounds(), axis, spread)


def _cylinder(shape: Cylinder, materials: Any) -> Iterator[LightBounds]:
    material = materials[shape.material]
    if material.emits:
        long = float(np.linalg.norm(np.subtract(shape.p1, shape.p0)))
        yield LightBounds(2.0 * math.pi * shape.radius * long * _exitance(material), shape.bounds())


_SHAPES: dict[type, Callable[[Any, Any], Iterator[LightBounds]]] = {
    Triangle: _mesh,
    Mesh: _mesh,
    Sphere: _spheres,
    SphereSet: _spheres,
    Disk: _disk,
    Cylinder: _cylinder,
}


def bounding_cone(axes: Array, spreads: Any = 0.0) -> tuple[Array, float]:
    """(axis, spread) of a cone that holds the cones about unit `axes` (n, 3) of half angles `spreads`: about their sum."""
    total = axes.sum(axis=0)
    length = np.linalg.norm(total)
    if not length > 1e-6 * len(axes):
        return LightBounds._field_defaults["axis"], math.pi
    axis = total / length
    angles = np.arctan2(np.linalg.norm(np.cross(axes, axis), axis=1), axes @ axis)
    return axis, min(float(np.max(angles + spreads)), math.pi)

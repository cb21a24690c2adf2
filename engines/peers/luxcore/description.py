"""A scene in LuxCore's terms: its properties, and meshes.

Spheres are instances of one finely tessellated mesh with interpolated normals; disks, cylinders and planes are meshes, too.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.interface import Settings
from engines.peers.adapters import camera_frame, cylinder_mesh, disk_mesh, extent, flat_meshes, sphere_mesh, squares
from engines.peers.adapters.geometry import placed_uvs
from engines.peers.luxcore.materials import Properties, material_properties, texture_of
from engines.scene import (
    Cylinder,
    DirectionalLight,
    Disk,
    EnvironmentLight,
    Light,
    Perspective,
    Plane,
    PointLight,
    Scene,
    ThinLens,
)
from engines.scene.geometry import has_area
from engines.scene.shapes import as_mesh, as_spheres

Array = NDArray[np.float64]
Indices = NDArray[np.integer]
SUBDIVISIONS = 6
"""Of the icosahedron that stands for a sphere: 81,920 faces, 5e-5 radii within the sphere at most."""
SEGMENTS = 1024
"""Of the polygons that stand for disks and cylinders, which lie 5e-6 radii within them."""
PLANE_EXTENTS = 1e3
"""Half the side of the square that stands for a plane, in extents of the rest of the scene."""
GAP = 1e-5
"""Half the distance between the two surfaces that stand for one that emits on both sides, in extents of the scene."""
NEAR, FAR = 1e-4, 1e7
"""Where the camera's rays begin and end without a `clip`, in extents of the scene."""


class Shape(NamedTuple):
    """A mesh, or an instance of one that was given before: then `vertices` is None, and `transformation` (4, 4) its place."""

    name: str
    material: int
    mesh: str
    vertices: Array | None = None
    faces: Indices | None = None
    normals: Array | None = None
    uvs: Array | None = None
    transformation: Array | None = None


def shapes(scene: Scene) -> Iterator[Shape]:
    """All shapes of the scene."""
    size = extent(scene)
    for mesh in flat_meshes(scene, gap=GAP * size):
        uvs, texture = mesh.uvs, texture_of(scene.materials[mesh.material])
        if texture is not None and uvs is not None:
            uvs = placed_uvs(uvs, texture)
        yield Shape(mesh.name, mesh.material, mesh.name, mesh.vertices, mesh.faces, mesh.normals, uvs)
    unit_sphere = None
    for index, shape in enumerate(scene.shapes):
        name = f"shape_{index}"
        if (spheres := as_spheres(shape)) is not None:
            for part, (center, radius) in enumerate(zip(spheres.centers, spheres.radii, strict=True)):
                given = () if unit_sphere else sphere_mesh(SUBDIVISIONS)
                unit_sphere = "unit_sphere"
                placed = np.diag([radius, radius, radius, 1.0])
                placed[:3, 3] = center
                vertices, faces = given or (None, None)
                yield Shape(f"{name}_{part}", spheres.material, unit_sphere, vertices, faces, vertices, transformation=placed)
        elif isinstance(shape, (Plane, Disk, Cylinder)):
            yield Shape(name, shape.material, name, *_flat_or_round(shape, size))


def _flat_or_round(shape: Plane | Disk | Cylinder, size: float) -> tuple[Array, Indices, Array | None]:
    """Vertices, faces and normals."""
    if isinstance(shape, Plane):
        return *squares(shape, PLANE_EXTENTS * size), None
    made = cylinder_mesh(shape, SEGMENTS) if isinstance(shape, Cylinder) else disk_mesh(shape, SEGMENTS)
    return made.vertices, made.faces, made.normals


def images(scene: Scene) -> Iterator[tuple[str, NDArray[np.float32]]]:
    """The images of textures, (h, w, 3), by the names that `properties` has for them."""
    for index, material in enumerate(scene.materials):
        if (texture := texture_of(material)) is not None:
            yield f"m{index}_image", np.broadcast_to(texture.pixels, (*texture.pixels.shape[:2], 3))


def properties(scene: Scene, settings: Settings) -> Properties:
    """Camera, textures, materials and lights."""
    named = {f"camera.{key}": value for key, value in _camera(scene, settings).items()}
    for name, _ in images(scene):
        texture = {"type": "imagemap", "file": name, "gamma": 1.0, "gain": 1.0, "mapping.type": "uvmapping2d"}
        named |= {f"textures.{name.removesuffix('image')}map.{key}": value for key, value in texture.items()}
    uniform = settings.shader.options["light_sampler"] == "uniform"
    importance = importances(scene) if uniform else np.ones(len(scene.materials))
    for index, material in enumerate(scene.materials):
        described = material_properties(f"m{index}", material, float(importance[index]))
        named |= {f"materials.{key}": value for key, value in described.items()}
    for index, light in enumerate(scene.lights):
        named |= {f"lights.l{index}.{key}": value for key, value in _light(light).items()}
    return {f"scene.{key}": value for key, value in named.items()}


def importances(scene: Scene) -> Array:
    """(materials,) that of each triangle of an area light, so that a shape is chosen as often as any other light: LuxCore
    chooses among triangles. Shapes of one material share what they have together."""
    emits, two_sided = (np.array([getattr(m, key) for m in scene.materials], bool) for key in ("emits", "two_sided"))
    lights, triangles = np.zeros((2, len(emits)))
    for shape in scene.shapes:
        mesh = as_mesh(shape)
        if mesh is None:
            continue
        faces = np.bincount(mesh.materials[has_area(mesh.vertices, mesh.faces)], minlength=len(emits)) * emits
        lights += faces / max(faces.sum(), 1)
        triangles += faces * (1 + two_sided)
    return np.divide(lights, triangles, out=np.ones(len(emits)), where=triangles > 0)


def _camera(scene: Scene, settings: Settings) -> Properties:
    camera, frame = scene.camera, camera_frame(scene, settings)
    assert isinstance(camera, (Perspective, ThinLens))
    left, right, bottom, top = frame.window
    row = (top - bottom) / settings.size(scene)[1]  # its film is one row of pixels off
    near, far = camera.clip
    size = extent(scene)
    lens = isinstance(camera, ThinLens)
    return {
        "type": "perspective",
        "lookat.orig": frame.origin.tolist(),
        "lookat.target": (frame.origin + frame.forward).tolist(),
        "up": frame.up.tolist(),
        "fieldofview": 90.0,
        "screenwindow": [left, right, bottom - row, top - row],
        "cliphither": max(near, NEAR * size),
        "clipyon": FAR * size if math.isinf(far) else far,
        "lensradius": float(camera.aperture_radius) if lens else 0.0,
        "focaldistance": float(camera.focus_distance) if lens else 1.0,
        "autofocus.enable": False,
        "autovolume.enable": False,
    }


def _light(light: Light) -> Properties:
    if isinstance(light, PointLight):
        return {"type": "point", "position": list(light.position), "color": list(light.intensity), "gain": [4.0 * math.pi] * 3}
    if isinstance(light, DirectionalLight):
        return {"type": "sharpdistant", "direction": list(light.direction), "color": list(light.irradiance), "gain": [1.0] * 3}
    assert isinstance(light, EnvironmentLight)
    return {"type": "constantinfinite", "color": list(light.radiance), "gain": [1.0] * 3}

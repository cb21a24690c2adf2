"""A scene without instances: copies of their shapes, for renderers that do not support instances."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.errors import SceneError
from engines.scene import tessellate
from engines.scene.attributes import of_elements
from engines.scene.content import content_hash
from engines.scene.frames import facing
from engines.scene.geometry import unit_rows
from engines.scene.materials import Material
from engines.scene.mesh import Mesh, read_only_mesh
from engines.scene.scene import Scene
from engines.scene.shapes import (
    Cylinder,
    Disk,
    Instance,
    Shape,
    Single,
    Sphere,
    as_mesh,
    as_spheres,
    materials_of,
    primitives_of,
)
from engines.scene.triple import triple

__all__ = ["flattened"]

MAX_COPIED = 4_000_000
"""Triangles and other primitives in all copies."""
SEGMENTS, RINGS, DISK_RINGS = 192, 96, 16
"""Around a round shape, a chord of which lies 1.3e-4 radii within the circle; from pole to pole of a sphere; of a disk."""
CORNERS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
"""Texture coordinates of a triangle that has none."""


def flattened(scene: Scene) -> Scene:
    """The scene with copies of shapes in place of instances, and with another content hash; the scene itself where it has no
    instances.

    Spheres, disks and cylinders that their matrix stretches, or turns where their texture shows it, are made of triangles.
    Raises `SceneError` where the copies have more than `MAX_COPIED` primitives.
    """
    if not any(isinstance(shape, Instance) for shape in scene.shapes):
        return scene
    shapes: list[Shape] = []
    copied = 0
    for shape in scene.shapes:
        if not isinstance(shape, Instance):
            shapes.append(shape)
            continue
        for member in shape.group.shapes:
            in_triangles = _in_triangles(member, shape.matrix, scene.materials)
            copied += primitives_of(member) * (len(_unit(type(member)).faces) if in_triangles else 1)
            if copied > MAX_COPIED:
                raise SceneError(f"copies of instances have more than {MAX_COPIED:,} triangles and other primitives in all")
            made = _triangles(member, shape.matrix) if in_triangles else _copy(member, shape.matrix, scene.materials)
            shapes.append(made)
    digest = content_hash(scene.camera, scene.materials, shapes, scene.lights, scene.media)
    return replace(scene, shapes=tuple(shapes), content_hash=digest)


def _scale(linear: NDArray[np.float64]) -> float | None:
    """How many times as large it makes round shapes; None where they do not stay round."""
    from engines.scene.mitsuba_xml.transforms import similarity  # readers of XML are loaded where they are needed

    return similarity(linear)


def _in_triangles(shape: Single, matrix: NDArray[np.float64], materials: Sequence[Material]) -> bool:
    """Whether the copy of a round shape under a `matrix` (3, 4) is a mesh."""
    if as_mesh(shape) is not None:
        return False
    scale, linear = _scale(matrix[:, :3]), matrix[:, :3]
    turned = scale is None or not np.array_equal(linear, scale * np.eye(3))
    return scale is None or (turned and any(materials[index].uses_uvs for index in materials_of(shape)))


def _copy(shape: Single, matrix: NDArray[np.float64], materials: Sequence[Material]) -> Single:
    """The shape as an instance with this `matrix` (3, 4) shows it, which keeps round shapes round."""
    if (mesh := as_mesh(shape)) is not None:
        return _with_media(_mesh(mesh, matrix, materials), shape)
    scale = _scale(matrix[:, :3])
    assert scale is not None
    if (spheres := as_spheres(shape)) is not None:
        centers = _points(matrix, spheres.centers)
        if isinstance(shape, Sphere):
            return replace(shape, center=triple(centers[0]), radius=shape.radius * scale)
        return replace(spheres, centers=centers, radii=spheres.radii * scale)
    if isinstance(shape, Disk):
        (center,), (normal,) = _points(matrix, np.array([shape.center])), _turned(matrix, np.array([shape.normal]))
        return replace(shape, center=triple(center), normal=triple(normal), radius=shape.radius * scale)
    assert isinstance(shape, Cylinder)
    p0, p1 = _points(matrix, np.array([shape.p0, shape.p1]))
    return replace(shape, p0=triple(p0), p1=triple(p1), radius=shape.radius * scale)


@cache
def _unit(kind: type) -> tessellate.Triangles:
    """What a round shape of a kind is made of: the unit sphere, disk or cylinder."""
    if kind is Disk:
        return tessellate.disk(SEGMENTS, DISK_RINGS)
    return tessellate.cylinder(SEGMENTS) if kind is Cylinder else tessellate.sphere(SEGMENTS, RINGS)


def _triangles(shape: Single, matrix: NDArray[np.float64]) -> Mesh:
    """A mesh of a round shape."""
    unit = _unit(type(shape))
    if (spheres := as_spheres(shape)) is not None:
        local = [np.column_stack([r * np.eye(3), center]) for center, r in zip(spheres.centers, spheres.radii, strict=True)]
    elif isinstance(shape, Disk):
        local = [facing(shape.center, shape.normal, shape.radius)[:3]]
    else:
        assert isinstance(shape, Cylinder), "meshes stay meshes, and planes are in no group"
        way = np.subtract(shape.p1, shape.p0)
        length = float(np.linalg.norm(way))
        local = [facing(shape.p0, way / length, shape.radius, length)[:3]]
    world = [np.column_stack([matrix[:, :3] @ each[:, :3], _points(matrix, each[None, :, 3])[0]]) for each in local]
    parts = [_placed(each, unit.vertices, unit.faces, unit.normals) for each in world]
    vertices = np.concatenate([part[0] for part in parts])
    faces = np.concatenate([part[1] + number * len(unit.vertices) for number, part in enumerate(parts)])
    normals = None if unit.normals is None else np.concatenate([part[2] for part in parts])
    uvs, material = np.tile(unit.uvs, (len(parts), 1)), np.full(len(faces), materials_of(shape)[0])
    mesh = read_only_mesh(vertices, faces, material, normals, type(shape).__name__.lower(), uvs)
    return _with_media(mesh, shape)


def _mesh(mesh: Mesh, matrix: NDArray[np.float64], materials: Sequence[Material]) -> Mesh:
    vertices, faces, normals, uvs, attributes = mesh.vertices, mesh.faces, mesh.normals, mesh.uvs, mesh.attributes
    if uvs is None and _mirrors(matrix) and any(materials[index].uses_uvs for index in materials_of(mesh)):
        # texture coordinates are those of corners, two of which are about to be exchanged
        corners = faces.reshape(-1)
        vertices, normals = vertices[corners], None if normals is None else normals[corners]
        attributes, uvs = of_elements(attributes, corners, slice(None)), np.tile(CORNERS, (len(faces), 1))
        faces = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    vertices, faces, normals = _placed(matrix, vertices, faces, normals)
    return read_only_mesh(vertices, faces, mesh.materials, normals, mesh.name, uvs, attributes)


def _with_media(mesh: Mesh, shape: Single) -> Mesh:
    """The mesh with the media of `shape`."""
    return replace(mesh, interior=shape.interior, exterior=shape.exterior)


def _placed(
    matrix: NDArray[np.float64], vertices: NDArray[np.float64], faces: NDArray[np.int32], normals: NDArray[np.float64] | None
) -> tuple[NDArray[np.float64], NDArray[np.int32], Any]:
    """Vertices, faces and normals under a `matrix` (3, 4), which keeps fronts: two corners are exchanged where it mirrors."""
    normals = None if normals is None else _turned(matrix, normals)
    return _points(matrix, vertices), faces[:, [0, 2, 1]] if _mirrors(matrix) else faces, normals


def _turned(matrix: NDArray[np.float64], normals: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) unit M^-T n."""
    return unit_rows(normals @ np.linalg.inv(matrix[:, :3]))


def _points(matrix: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) points of the world."""
    return points @ matrix[:, :3].T + matrix[:, 3]


def _mirrors(matrix: NDArray[np.float64]) -> bool:
    return bool(np.linalg.det(matrix[:, :3]) < 0.0)

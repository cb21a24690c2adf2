"""A scene's triangles by material, and its camera's frame: what most renderers want to be given."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.interface import Settings
from engines.scene import BLACK, Mesh, Orthographic, Perspective, Plane, Scene, ThinLens, Triangle
from engines.scene.geometry import face_normals, has_area, unit_rows
from engines.scene.procedural.solids import tessellated_sphere

Array = NDArray[np.float64]
OWN_UVS = np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
"""Texture coordinates of a face without any: the weights of its second and third vertex."""


@dataclass(frozen=True, slots=True, eq=False)
class FlatMesh:
    """Triangles of one material: `vertices` (n, 3) float64 in world space, `faces` (m, 3) int32, counter-clockwise from the
    front. `normals` (n, 3) unit where it is smooth, else None. `uvs` (n, 2), v = 0 at the top of an image, else None.

    `material` is an index into `Scene.materials`; `name` is unique within the scene, of letters, digits and underscores.
    """

    name: str
    material: int
    vertices: Array
    faces: NDArray[np.int32]
    normals: Array | None = None
    uvs: Array | None = None


def extent(scene: Scene) -> float:
    """The largest coordinate of anything finite in the scene, the camera included; at least 1e-3."""
    reach = [np.abs(box).max() for shape in scene.shapes if (box := shape.bounds()) is not None]
    reach += [np.abs(shape.point).max() for shape in scene.shapes if isinstance(shape, Plane)]
    reach += [np.abs(getattr(scene.camera, name, BLACK)).max() for name in ("eye", "target")]
    return float(max(1e-3, *reach))


def tangents(normal: Array) -> tuple[Array, Array]:
    """Unit vectors u, v with u x v = `normal`, a unit vector."""
    u = np.cross(np.eye(3)[np.argmin(np.abs(normal))], normal)
    u /= np.linalg.norm(u)
    return u, np.cross(normal, u)


def sphere_mesh(subdivisions: int) -> tuple[Array, NDArray[np.int32]]:
    """Vertices, which are the normals too, and 20 * 4^`subdivisions` faces of a unit sphere."""
    made = tessellated_sphere(subdivisions, BLACK, 1.0)
    return made.vertices, made.faces


def flat_meshes(scene: Scene, gap: float | None = None) -> list[FlatMesh]:
    """All triangles and meshes of the scene, one mesh for each material (two where only some of it is smooth, or has uvs).

    Faces of zero area are left out. Where light depends on texture coordinates (`Material.uses_uvs`) every mesh has
    them. Other shapes are the caller's: an engine lists in `AdapterEngine.shapes` the kinds that it takes. With a `gap` every
    face that emits on both sides is two that emit on one, `gap` away from its place.
    """
    groups: dict[tuple[int, bool, bool], list[_Piece]] = {}
    for piece in _pieces(scene, gap):
        groups.setdefault((piece.material, piece.normals is not None, piece.uvs is not None), []).append(piece)
    found = []
    for index, ((material, _, _), pieces) in enumerate(sorted(groups.items())):
        first = np.cumsum([0, *(len(piece.vertices) for piece in pieces)])
        faces = [piece.faces + start for piece, start in zip(pieces, first[:-1], strict=True)]
        normals, uvs = ([getattr(piece, name) for piece in pieces] for name in ("normals", "uvs"))
        found.append(
            FlatMesh(
                f"mesh_{index}",
                material,
                np.concatenate([piece.vertices for piece in pieces]),
                np.concatenate(faces).astype(np.int32),
                None if normals[0] is None else np.concatenate(normals),
                None if uvs[0] is None else np.concatenate(uvs),
            )
        )
    return found


class _Piece(NamedTuple):
    material: int
    vertices: Array
    faces: NDArray[np.int32]
    normals: Array | None
    uvs: Array | None


def _pieces(scene: Scene, gap: float | None) -> Iterator[_Piece]:
    """The faces of each shape, of one material at a time, with the vertices that they use."""
    wanted = [material.uses_uvs for material in scene.materials]
    for shape in scene.shapes:
        if isinstance(shape, Triangle):
            corners = np.array([shape.a, shape.b, shape.c])
            mesh = Mesh(corners, np.array([[0, 1, 2]], np.int32), np.array([shape.material], np.int32))
        elif isinstance(shape, Mesh):
            mesh = shape
        else:
            continue
        area = has_area(mesh.vertices, mesh.faces)
        for material in np.unique(mesh.materials[area]).tolist():
            faces = mesh.faces[area & (mesh.materials == material)]
            if wanted[material] and mesh.uvs is None:
                corners, order = faces.reshape(-1), np.arange(faces.size, dtype=np.int32).reshape(-1, 3)
                uvs = np.tile(OWN_UVS, (len(faces), 1))
            else:
                corners, order = np.unique(faces, return_inverse=True)
                order = order.reshape(-1, 3).astype(np.int32)
                uvs = mesh.uvs[corners] if wanted[material] and mesh.uvs is not None else None
            normals = None if mesh.normals is None else mesh.normals[corners]
            piece = _Piece(material, mesh.vertices[corners], order, normals, uvs)
            two = gap is not None and scene.materials[material].emits and scene.materials[material].two_sided
            yield from _two_sides(piece, gap or 0.0) if two else (piece,)


def _two_sides(piece: _Piece, gap: float) -> Iterator[_Piece]:
    """The faces moved to their front, and turned around and moved to their back."""
    corners = piece.faces.reshape(-1)
    normal = np.repeat(unit_rows(face_normals(piece.vertices, piece.faces)), 3, axis=0)
    order = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    normals, uvs = (None if each is None else each[corners] for each in (piece.normals, piece.uvs))
    yield _Piece(piece.material, piece.vertices[corners] + gap * normal, order, normals, uvs)
    back = None if normals is None else -normals
    yield _Piece(piece.material, piece.vertices[corners] - gap * normal, order[:, [0, 2, 1]], back, uvs)


@dataclass(frozen=True, slots=True, eq=False)
class CameraFrame:
    """A camera's place and window. `right`, `up`, `forward` are unit and perpendicular; `right` is negated by `mirror`.

    `fov_x`, `fov_y`: full angles in degrees, of a pinhole or thin lens, as if its axis met the middle of the image; 0 of an
    orthographic camera. `window` (left, right, bottom, top): of the image, in multiples of `right` and `up`, at distance 1
    along `forward`, or in metres for an orthographic camera; the principal point is in it.
    """

    origin: Array
    right: Array
    up: Array
    forward: Array
    fov_x: float
    fov_y: float
    window: tuple[float, float, float, float]


def camera_frame(scene: Scene, settings: Settings) -> CameraFrame:
    """The frame of a perspective, thin lens or orthographic camera, for an image of the settings' size (docs/transport.md)."""
    camera = scene.camera
    assert isinstance(camera, (Perspective, ThinLens, Orthographic))
    width, height = settings.size(scene)
    forward = _unit(np.subtract(camera.target, camera.eye))
    right = _unit(np.cross(forward, camera.up))
    up = np.cross(right, forward)
    if isinstance(camera, Orthographic):
        half = np.array(camera.window(width / height)) / 2.0
        fov = np.zeros(2)
    else:
        along = np.array([width / height, 1.0] if camera.fov_axis == "y" else [1.0, height / width])
        half = along * np.tan(np.radians(camera.fov) / 2.0)
        fov = 2.0 * np.degrees(np.arctan(half))
    middle = 2.0 * half * np.multiply(camera.principal_point, (-1.0, 1.0))
    (left, bottom), (to_right, top) = (middle - half).tolist(), (middle + half).tolist()
    return CameraFrame(
        np.array(camera.eye),
        -right if camera.mirror else right,
        up,
        forward,
        float(fov[0]),
        float(fov[1]),
        (left, to_right, bottom, top),
    )


def _unit(vector: Array) -> Array:
    return vector / np.linalg.norm(vector)

"""A scene's triangles by material, and its camera's frame: what most renderers want to be given."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.interface import Settings
from engines.scene import BLACK, Checkerboard, ImageTexture, Mesh, Orthographic, Perspective, Plane, Scene, ThinLens
from engines.scene.attributes import Attributes, of_elements
from engines.scene.frames import look_at
from engines.scene.geometry import face_normals, has_area, unit_rows
from engines.scene.shapes import as_mesh

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


def flat_meshes(scene: Scene, gap: float | None = None) -> list[FlatMesh]:
    """All triangles and meshes of the scene, one mesh for each material (two where only some of it is smooth, or has uvs).

    Faces of zero area are left out. Where light depends on texture coordinates (`Material.uses_uvs`) every mesh has
    them. Other shapes are the caller's: an engine lists in `AdapterEngine.shapes` the kinds that it takes. With a `gap` every
    face that emits on both sides is two that emit on one, `gap` away from its place.
    """
    groups: dict[tuple[int, bool, bool], list[Piece]] = {}
    for piece in _pieces(scene, gap):
        groups.setdefault((piece.material, piece.normals is not None, piece.uvs is not None), []).append(piece)
    meshes = []
    for index, ((material, _, _), parts) in enumerate(sorted(groups.items())):
        first = np.cumsum([0, *(len(piece.vertices) for piece in parts)])
        faces = [piece.faces + start for piece, start in zip(parts, first[:-1], strict=True)]
        normals, uvs = ([getattr(piece, name) for piece in parts] for name in ("normals", "uvs"))
        meshes.append(
            FlatMesh(
                f"mesh_{index}",
                material,
                np.concatenate([piece.vertices for piece in parts]),
                np.concatenate(faces).astype(np.int32),
                None if normals[0] is None else np.concatenate(normals),
                None if uvs[0] is None else np.concatenate(uvs),
            )
        )
    return meshes


class Piece(NamedTuple):
    """Faces of a mesh, of one material, as a mesh of their own; `primitives` are their numbers in the mesh."""

    material: int
    primitives: NDArray[np.int64]
    vertices: Array
    faces: NDArray[np.int32]
    normals: Array | None
    uvs: Array | None
    attributes: Attributes


def pieces(mesh: Mesh) -> Iterator[Piece]:
    """The faces of each material, with the vertices that they use."""
    for material in np.unique(mesh.materials).tolist():
        chosen = np.flatnonzero(mesh.materials == material)
        used, order = np.unique(mesh.faces[chosen], return_inverse=True)
        normals, uvs = (None if each is None else each[used] for each in (mesh.normals, mesh.uvs))
        attributes = of_elements(mesh.attributes, used, chosen)
        yield Piece(material, chosen, mesh.vertices[used], order.reshape(-1, 3).astype(np.int32), normals, uvs, attributes)


def unshared(piece: Piece) -> Piece:
    """The faces with three vertices of their own each."""
    corners = piece.faces.reshape(-1)
    normals, uvs = (None if each is None else each[corners] for each in (piece.normals, piece.uvs))
    order = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    attributes = of_elements(piece.attributes, corners, slice(None))
    return piece._replace(vertices=piece.vertices[corners], faces=order, normals=normals, uvs=uvs, attributes=attributes)


def two_sides(piece: Piece, gap: float) -> tuple[Piece, Piece]:
    """The faces moved by `gap` to their front, and turned around and moved to their back."""
    apart = unshared(piece)
    away = gap * np.repeat(unit_rows(face_normals(apart.vertices, apart.faces)), 3, axis=0)
    normals = None if apart.normals is None else -apart.normals
    back = apart._replace(vertices=apart.vertices - away, faces=apart.faces[:, [0, 2, 1]], normals=normals)
    return apart._replace(vertices=apart.vertices + away), back


def _pieces(scene: Scene, gap: float | None) -> Iterator[Piece]:
    """The faces that have an area, with texture coordinates where their material looks at them."""
    for mesh in filter(None, map(as_mesh, scene.shapes)):
        area = has_area(mesh.vertices, mesh.faces)
        attributes = of_elements(mesh.attributes, slice(None), area)
        with_area = replace(mesh, faces=mesh.faces[area], materials=mesh.materials[area], attributes=attributes)
        for piece in pieces(with_area):
            material = scene.materials[piece.material]
            placed = with_uvs(piece) if material.uses_uvs else piece._replace(uvs=None)
            yield from two_sides(placed, gap) if gap is not None and material.emits and material.two_sided else (placed,)


def with_uvs(piece: Piece) -> Piece:
    """The faces with texture coordinates: their own, or those of faces without any."""
    return piece if piece.uvs is not None else unshared(piece)._replace(uvs=np.tile(OWN_UVS, (len(piece.faces), 1)))


def placed_uvs(uvs: Array, texture: ImageTexture | Checkerboard) -> Array:
    """(n, 2) texture coordinates by the `to_uv` of a texture, for renderers that have none."""
    return np.column_stack([uvs, np.ones(len(uvs))]) @ np.reshape(texture.to_uv, (2, 3)).T


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
    left, up, forward = look_at(camera.eye, camera.target, camera.up)[:3, :3].T
    right = -left
    if isinstance(camera, Orthographic):
        half = np.array(camera.window(width / height)) / 2.0
        fov = np.zeros(2)
    else:
        along = np.array([width / height, 1.0] if camera.fov_axis == "y" else [1.0, height / width])
        half = along * np.tan(np.radians(camera.fov) / 2.0)
        fov = 2.0 * np.degrees(np.arctan(half))
    middle = 2.0 * half * np.multiply(camera.principal_point, (-1.0, 1.0))
    (to_left, bottom), (to_right, top) = (middle - half).tolist(), (middle + half).tolist()
    return CameraFrame(
        np.array(camera.eye),
        -right if camera.mirror else right,
        up,
        forward,
        float(fov[0]),
        float(fov[1]),
        (to_left, to_right, bottom, top),
    )

"""Shapes that are no triangles, as Blender has them: planes and disks as triangles, spheres as points or as triangles."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from engines.peers.adapters import FlatMesh, disk_mesh, extent, flat_meshes, sphere_mesh, squares
from engines.scene import Disk, Plane, Scene
from engines.scene.bsdf_tree import is_opaque
from engines.scene.geometry import face_normals
from engines.scene.shapes import as_spheres

Array = NDArray[np.float64]
RINGS, GROWTH = 10, 4.0
"""Squares around each other that stand for a plane, and how much larger each is: the last reaches 500,000 extents of the scene.
Triangles as large would be as far off in float32 near the eye; of rings the near ones are small."""
DISK_EDGES = 512
FINEST, COARSEST, MOST_FACES = 6, 3, 1_000_000
"""Subdivisions of the icosahedron that stands for a sphere, and faces of all that stand for the spheres of a material."""


@dataclass(frozen=True, slots=True, eq=False)
class SphereGroup:
    """Spheres of one material: `centers` (n, 3), `radii` (n,)."""

    material: int
    centers: Array
    radii: Array


def meshes_of(scene: Scene) -> Iterator[FlatMesh]:
    """Everything but the spheres that `points_of` has, as triangles."""
    yield from map(_fronts_agree, flat_meshes(scene))
    size = extent(scene)
    for index, shape in enumerate(scene.shapes):
        if isinstance(shape, Plane):
            yield FlatMesh(f"plane_{index}", shape.material, *squares(shape, size * GROWTH ** np.arange(RINGS)))
        elif isinstance(shape, Disk):
            made = disk_mesh(shape, DISK_EDGES, same_area=True)
            yield FlatMesh(f"disk_{index}", shape.material, made.vertices, made.faces)
    for group in spheres_of(scene):
        if not _are_points(scene, group):
            yield FlatMesh(f"spheres_{group.material}", group.material, *tessellated(group))


def _fronts_agree(mesh: FlatMesh) -> FlatMesh:
    """The mesh with each vertex normal on the front of most of its faces.

    raybench turns a shading normal to the side of the face that a ray hits. Cycles does not: where normals point to the
    back of the faces, it renders a surface black.
    """
    if mesh.normals is None:
        return mesh
    front = np.sign(np.einsum("fvc,fc->fv", mesh.normals[mesh.faces], face_normals(mesh.vertices, mesh.faces)))
    votes = np.bincount(mesh.faces.ravel(), front.ravel(), len(mesh.vertices))
    return replace(mesh, normals=np.where(votes[:, None] < 0.0, -mesh.normals, mesh.normals))


def points_of(scene: Scene) -> list[SphereGroup]:
    """Spheres that Cycles can be given as points, which are exact spheres without an inside."""
    return [group for group in spheres_of(scene) if _are_points(scene, group)]


def spheres_of(scene: Scene) -> list[SphereGroup]:
    """All spheres of the scene, by material."""
    groups: dict[int, list[tuple[Array, Array]]] = {}
    for shape in scene.shapes:
        if (spheres := as_spheres(shape)) is not None:
            groups.setdefault(spheres.material, []).append((spheres.centers, spheres.radii))
    return [SphereGroup(material, *map(np.concatenate, zip(*parts, strict=True))) for material, parts in sorted(groups.items())]


def subdivisions(count: int) -> int:
    """How fine `count` spheres of a material can be."""
    return next((level for level in range(FINEST, 0, -1) if 20 * 4**level * count <= MOST_FACES), 0)


def spheres_lack(scene: Scene) -> str | None:
    """One sentence where a material has too many spheres that have to be triangles, or None."""
    for group in spheres_of(scene):
        if subdivisions(len(group.radii)) < COARSEST and not _are_points(scene, group):
            name = scene.materials[group.material].name
            return f"material {name!r}: Cycles' points neither emit nor transmit, and its spheres are too many for triangles"
    return None


def _are_points(scene: Scene, group: SphereGroup) -> bool:
    """Whether nobody can see the difference: rays leave a point unhindered, its light is not sampled."""
    material, eye = scene.materials[group.material], getattr(scene.camera, "eye", None)
    inside = eye is not None and bool((np.linalg.norm(group.centers - eye, axis=1) <= group.radii).any())
    return not inside and not material.emits and is_opaque(material.as_bsdf)


def tessellated(group: SphereGroup) -> tuple[Array, NDArray[np.int32], Array]:
    """Vertices, faces and normals of all spheres; each has the area of the sphere that it stands for."""
    unit, faces = sphere_mesh(subdivisions(len(group.radii)))
    corners = unit[faces]
    area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum()
    swelling = np.sqrt(4.0 * np.pi / area)
    vertices = group.centers[:, None] + group.radii[:, None, None] * swelling * unit
    faces = faces + len(unit) * np.arange(len(group.radii))[:, None, None]
    return vertices.reshape(-1, 3), faces.reshape(-1, 3).astype(np.int32), np.tile(unit, (len(group.radii), 1))

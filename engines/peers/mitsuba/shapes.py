"""Shapes in Mitsuba's terms. Meshes are files; a surface that emits on both sides is two surfaces a hair apart."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from engines.peers.adapters.geometry import extent, pieces, two_sides
from engines.peers.mitsuba.media import sides_node
from engines.peers.mitsuba.nodes import Array, Node, Placing
from engines.peers.mitsuba.textures import Textures
from engines.scene import (
    Cylinder,
    Disk,
    Instance,
    Mesh,
    MeshAttribute,
    Plane,
    Scene,
    Shape,
    Sphere,
    SphereSet,
    Texture,
    Triangle,
)
from engines.scene.bsdf_tree import anisotropic, members, uses_uvs
from engines.scene.frames import facing
from engines.scene.shapes import as_mesh, as_spheres
from engines.scene.textures import IDENTITY

PLANE_EXTENTS = 1e4
"""Radius of the disk that stands for a plane, in extents of the rest of the scene. Hits of a rectangle of that size are so far
off it in float32 that it shadows itself where it is tilted."""
GAP = 1e-5
"""Half the distance between the sides of a surface that emits on both, in extents of the scene."""


SHAPES = (Plane, Disk, Cylinder, Sphere, SphereSet, Triangle, Mesh)


@dataclass(frozen=True, slots=True)
class Part:
    """A shape of Mitsuba's: `node` without its name, the scene's shape it comes from, and what its primitives are there.

    `flipped` parts have their second and third vertices exchanged.
    """

    node: Node
    shape: int
    material: int
    primitives: Array
    flipped: bool = False


def planes_lack(scene: Scene) -> str | None:
    """One sentence on what Mitsuba does not support of the scene's planes, which are disks there, or None."""
    for shape in scene.shapes:
        if isinstance(shape, Plane) and uses_uvs(bsdf := (material := scene.materials[shape.material]).as_bsdf):
            turned = next((type(part).__name__.lower() for part in members(bsdf) if anisotropic(part)), None)
            what = "textures" if turned is None else f"an anisotropic {turned}"
            return f"material {material.name!r}: Mitsuba does not support {what} on a plane"
    return None


def emission_lacks(scene: Scene) -> str | None:
    """One sentence on what Mitsuba does not support of the textures that surfaces emit, or None. It samples them through
    (u, v) in [0, 1], and misses all else."""
    for shape in scene.shapes:
        assert not isinstance(shape, Instance), "declined before"
        indices = np.unique(shape.materials) if isinstance(shape, Mesh) else [shape.material]
        for material in (scene.materials[index] for index in indices):
            if isinstance(material.emission, MeshAttribute):
                return f"material {material.name!r}: Mitsuba has no emission from attributes of meshes"
            if isinstance(material.emission, Texture):
                uvs = shape.uvs if isinstance(shape, Mesh) else None
                inside = uvs is not None and uvs.min(initial=0.0) >= 0.0 and uvs.max(initial=0.0) <= 1.0
                if not inside or material.two_sided or material.emission.to_uv != IDENTITY:
                    return (
                        f"material {material.name!r}: Mitsuba has emission from a texture on one side of meshes alone, with "
                        "texture coordinates in [0, 1] and without to_uv"
                    )
    return None


def parts(scene: Scene, placing: Placing, textures: Textures) -> Iterator[Part]:
    """Every shape of the scene, in one part for each of its materials and emitting sides."""
    size = extent(scene)
    for index, shape in enumerate(scene.shapes):
        mesh = as_mesh(shape)
        if mesh is None:
            yield from _round_or_flat(scene, index, shape, size, textures)
            continue
        for piece in pieces(mesh):
            material = scene.materials[piece.material]
            two = material.emits and material.two_sided
            for each, side in zip(two_sides(piece._replace(uvs=None), GAP * size) if two else (piece,), (1, -1), strict=False):
                name = f"shape_{index}_{material.name}_{'back' if side < 0 else 'front'}"
                attributes = textures.attributes_of(each.attributes)
                file = placing.mesh(name, each.vertices, each.faces, each.normals, each.uvs, attributes)
                node: Node = {"type": "ply", "filename": file, "face_normals": each.normals is None}
                yield _finished(scene, node, Part(node, index, each.material, each.primitives, side < 0), textures)


def _round_or_flat(scene: Scene, index: int, shape: Shape, size: float, textures: Textures) -> Iterator[Part]:
    assert not isinstance(shape, (Triangle, Mesh, Instance))
    material = scene.materials[shape.material]
    sides = ((1, GAP * size), (-1, GAP * size)) if material.emits and material.two_sided else ((1, 0.0),)
    for side, gap in sides:
        for primitive, node in enumerate(_nodes(shape, side, gap, size)):
            yield _finished(scene, node, Part(node, index, shape.material, np.array([primitive]), side < 0), textures)


def _nodes(shape: Plane | Disk | Cylinder | Sphere | SphereSet, side: int, gap: float, size: float) -> Iterator[Node]:
    """The shape, or its back, `gap` out of its place."""
    turned: Node = {"flip_normals": True} if side < 0 else {}
    if isinstance(shape, (Plane, Disk)):
        plane = isinstance(shape, Plane)
        point = np.add(shape.point if plane else shape.center, np.multiply(shape.normal, side * gap))
        radius = PLANE_EXTENTS * size if plane else shape.radius
        yield {"type": "disk", "to_world": facing(point, np.multiply(shape.normal, side), radius)}
    elif isinstance(shape, Cylinder):
        axis = np.subtract(shape.p1, shape.p0)
        length = float(np.linalg.norm(axis))
        yield {"type": "cylinder", "to_world": facing(shape.p0, axis / length, shape.radius + side * gap, length), **turned}
    else:
        spheres = as_spheres(shape)
        assert spheres is not None
        for center, radius in zip(spheres.centers.tolist(), spheres.radii.tolist(), strict=True):
            yield {"type": "sphere", "center": center, "radius": radius + side * gap, **turned}


def _finished(scene: Scene, node: Node, part: Part, textures: Textures) -> Part:
    """The part with its material, media and light."""
    material = scene.materials[part.material]
    node["bsdf"] = {"type": "ref", "id": f"material_{part.material}"}
    shape = scene.shapes[part.shape]
    assert not isinstance(shape, Instance), "declined before"
    node |= sides_node(shape, part.flipped)
    if material.emits:
        node["emitter"] = {"type": "area", "radiance": textures.color(material.emission)}
    return part

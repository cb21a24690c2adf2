"""What a generator of shapes is: a function with options, which gives `Faces` or `Spheres`, and their keys."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.scene.geometry import read_only
from engines.scene.mesh import Mesh, SphereSet, read_only_mesh
from engines.schema.fields import refuse_above_memory
from engines.schema.keys import Given, Key, Record
from engines.schema.kinds import NUMBER, POINT, POSITIVE

BYTES_PER_FACE = 250
BYTES_PER_SPHERE = 200
"""Memory at the height of generating, temporaries and the checks of the loader included."""


class Faces(NamedTuple):
    """A generated mesh: `vertices` (n, 3) float64, `faces` (m, 3) int32, counter-clockwise seen from the front.

    `uvs` makes texture coordinates, (n, 2) of the vertices or (m, 3, 2) of the corners; it is called where a texture asks.
    `normals` (n, 3) are unit vertex normals of a smooth surface.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    name: str
    uvs: Callable[[], NDArray[np.float64]] | None = None
    normals: NDArray[np.float64] | None = None


class Spheres(NamedTuple):
    """Generated spheres: `centers` (n, 3) and `radii` (n,), float64."""

    centers: NDArray[np.float64]
    radii: NDArray[np.float64]
    name: str


def generator(
    make: Callable[..., Faces | Spheres],
    keys: Mapping[str, Key],
    needs: Callable[[Mapping[str, Any]], float] = lambda options: 0.0,
) -> Record:
    """What a scene file says of a generator. `make(**options)`, whose docstring explains it, makes the shape; `needs(options)`
    estimates its bytes."""

    def shape(given: Given, context: Any) -> Mesh | SphereSet:
        refuse_above_memory(given.node, needs(given.values), f"procedural shape {make.__name__!r} of this size")
        with np.errstate(over="ignore", invalid="ignore"):
            made = make(**given.values)
        arrays = (made.centers, made.radii) if isinstance(made, Spheres) else (made.vertices,)
        if not all(np.isfinite(array).all() for array in arrays):
            raise given.node.refuse("its coordinates must be finite: make it smaller")
        if isinstance(made, Faces):
            vertices, faces, normals, uvs = made.vertices, made.faces, made.normals, None
            if made.uvs is not None and context.table.materials[context.material].uses_uvs:
                uvs = np.array(made.uvs(), np.float64)
                if uvs.ndim == 3:  # corners that share a vertex differ
                    vertices, uvs = vertices[faces].reshape(-1, 3), uvs.reshape(-1, 2)
                    normals = None if normals is None else normals[faces].reshape(-1, 3)
                    faces = np.arange(len(vertices), dtype=np.int32).reshape(-1, 3)
            materials = np.full(len(faces), context.material, np.int32)
            return read_only_mesh(vertices, faces, materials, normals, made.name, uvs)
        return SphereSet(read_only(made.centers), read_only(made.radii), context.material, made.name)

    return Record(" ".join((make.__doc__ or "").split("\n\n")[0].split()), keys, shape)


ORIGIN = (0.0, 0.0, 0.0)
CENTER = Key(POINT, "Center of the shape.", ORIGIN, unit="metres")
FOOT = Key(POINT, "The middle of its lowest level.", ORIGIN, unit="metres")
RADIUS = Key(POSITIVE, "Radius of the sphere around the shape.", 1.0, unit="metres")
ROTATE_Y = Key(NUMBER, "Angle by which it is turned about +y, right-handed.", 0.0, unit="degrees")


def turned(points: NDArray[np.float64], rotate_y: float) -> NDArray[np.float64]:
    """(n, 3) points turned by degrees about +y: x' = x cos + z sin, z' = z cos - x sin."""
    x, y, z = points.T
    cos, sin = np.cos(np.radians(rotate_y)), np.sin(np.radians(rotate_y))
    return np.stack([x * cos + z * sin, y, z * cos - x * sin], axis=1)


def quads(a: NDArray[np.int32], b: NDArray[np.int32], c: NDArray[np.int32], d: NDArray[np.int32]) -> NDArray[np.int32]:
    """Two faces (a, b, c) and (a, c, d) for each place in the arrays of corners."""
    return np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)


def grid_faces(rows: int, columns: int) -> NDArray[np.int32]:
    """(2 rows columns, 3) faces of a grid of (rows + 1) x (columns + 1) vertices; front: row axis x column axis."""
    index = np.arange((rows + 1) * (columns + 1), dtype=np.int32).reshape(rows + 1, columns + 1)
    return quads(index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:])


def grid_uvs(rows: int, columns: int) -> NDArray[np.float64]:
    """((rows + 1) (columns + 1), 2) texture coordinates of the vertices of such a grid: u along columns, v along rows."""
    u, v = np.meshgrid(np.linspace(0.0, 1.0, columns + 1), np.linspace(0.0, 1.0, rows + 1))
    return np.stack([u, v], axis=2).reshape(-1, 2)

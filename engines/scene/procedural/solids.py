"""Procedural shapes with few parameters: box, quad, rectangle, the subdivided icosahedron, and tetrahedra."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from engines.scene.procedural.generator import BYTES_PER_FACE, CENTER, RADIUS, ROTATE_Y, Faces, generator, turned
from engines.scene.triple import Triple
from engines.schema import fields
from engines.schema.keys import Key
from engines.schema.kinds import POINT, ROWS, Kind, integer
from engines.schema.yaml_file import Located

PICTURE = np.array([[0.0, 1.0], [1.0, 1.0], [1.0, 0.0], [0.0, 0.0]])
"""Texture coordinates of the corners of an upright picture: lower left, lower right, upper right, upper left."""


def box(half_size: Triple, center: Triple, rotate_y: float) -> Faces:
    """A closed box of 12 triangles with outward normals, turned by `rotate_y` degrees about +y through its centre.

    Vertex k has the signs of the bits of k (x lowest). A texture is upright on all four walls.
    """
    signs = np.array([[1 if k >> axis & 1 else -1 for axis in range(3)] for k in range(8)], np.float64)
    vertices = turned(signs * np.array(half_size), rotate_y) + np.array(center)
    sides = [(0, 4, 6, 2), (1, 3, 7, 5), (0, 1, 5, 4), (2, 6, 7, 3), (0, 2, 3, 1), (4, 5, 7, 6)]
    faces = np.array([[(a, b, c), (a, c, d)] for a, b, c, d in sides], np.int32).reshape(-1, 3)
    upright = [0, 1, 0, 3, 1, 0]
    uvs = np.array([np.roll(PICTURE, -turn, axis=0)[[(0, 1, 2), (0, 2, 3)]] for turn in upright]).reshape(-1, 3, 2)
    return Faces(vertices, faces, "box", lambda: uvs)


def quad(points: NDArray[np.float64]) -> Faces:
    """Two triangles (0, 1, 2) and (0, 2, 3) of four corners."""
    return Faces(np.array(points, np.float64), np.array([[0, 1, 2], [0, 2, 3]], np.int32), "quad", lambda: PICTURE)


def rectangle(corner: Triple, edge1: Triple, edge2: Triple) -> Faces:
    """The parallelogram of a corner and two edges; its front is edge1 x edge2."""
    c, e1, e2 = np.array(corner), np.array(edge1), np.array(edge2)
    return quad(np.stack([c, c + e1, c + e1 + e2, c + e2]))._replace(name="rectangle")


def tessellated_sphere(subdivisions: int, center: Triple, radius: float) -> Faces:
    """An icosahedron whose faces are cut into four, again and again, with all vertices on the sphere."""
    golden = (1 + 5**0.5) / 2
    golden_rectangle = np.array([[-1, golden, 0], [1, golden, 0], [-1, -golden, 0], [1, -golden, 0]])
    vertices = np.concatenate([np.roll(golden_rectangle, turn, axis=1) for turn in range(3)]) / (1 + golden * golden) ** 0.5
    cap = [[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11]]
    belt = [[1, 5, 9], [5, 11, 4], [11, 10, 2], [10, 7, 6], [7, 1, 8]]
    other_cap = [[3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9]]
    other_belt = [[4, 9, 5], [2, 4, 11], [6, 2, 10], [8, 6, 7], [9, 8, 1]]
    faces = np.array(cap + belt + other_cap + other_belt)
    for _ in range(subdivisions):
        vertices, faces = _subdivided(vertices, faces)
    return Faces(vertices * radius + np.array(center), faces.astype(np.int32), "tessellated_sphere")


def _subdivided(vertices: NDArray[np.float64], faces: NDArray[np.integer]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Every face in four; each edge's midpoint, pushed out to the unit sphere, is one vertex."""
    count = len(vertices)
    edges = np.sort(np.stack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]], axis=1).reshape(-1, 2), axis=1)
    keys, inverse = np.unique(edges[:, 0].astype(np.int64) * count + edges[:, 1], return_inverse=True)
    middle = vertices[keys // count] + vertices[keys % count]
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    a, b, c = faces.T.astype(np.int64)
    ab, bc, ca = (inverse.reshape(-1, 3) + count).T
    parts = [np.stack(part, axis=1) for part in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))]
    return np.concatenate([vertices, middle]), np.stack(parts, axis=1).reshape(-1, 3)


TETRAHEDRON = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / 3**0.5


def tetra(level: int, center: Triple, radius: float) -> Faces:
    """4^(level - 1) regular tetrahedra, closed and facing outwards, that touch in their corners.

    Each of one level becomes four of half its size in its corners (the tetrahedron of tetrahedra of Haines' databases,
    Sierpinski's in space); `radius` is that of the sphere around them all.
    """
    middles, size = np.zeros((1, 3)), 1.0
    for _ in range(level - 1):
        size /= 2.0
        middles = (middles[:, None] + size * TETRAHEDRON).reshape(-1, 3)
    vertices = (middles[:, None] + size * TETRAHEDRON).reshape(-1, 3) * radius + np.array(center)
    sides = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]], np.int32)
    faces = sides + 4 * np.arange(len(middles), dtype=np.int32)[:, None, None]
    return Faces(vertices, faces.reshape(-1, 3), "tetra")


def _positive_triple(node: Located) -> Triple:
    sides = fields.triple(node)
    if min(sides) <= 0.0:
        raise node.refuse(f"{list(sides)}: must be greater than 0")
    return sides


def _four_points(node: Located) -> NDArray[np.float64]:
    corners = fields.rows(node, np.float64)
    if len(corners) != 4:
        raise node.refuse(f"{len(corners)} points: four are expected")
    return corners


POSITIVE_TRIPLE = Kind(_positive_triple, POINT.json)
_FOUR_POINTS = Kind(_four_points, {**ROWS.json, "minItems": 4, "maxItems": 4})


GENERATORS = {
    "tessellated_sphere": generator(
        tessellated_sphere,
        {
            "subdivisions": Key(integer(0, 30), "Divisions of an icosahedron's faces; 20 * 4^subdivisions faces.", 4),
            "center": CENTER,
            "radius": RADIUS,
        },
        lambda options: BYTES_PER_FACE * 20.0 * 4.0 ** options["subdivisions"],
    ),
    "tetra": generator(
        tetra,
        {"level": Key(integer(1, 30), "Generations; 4^level faces.", 4), "center": CENTER, "radius": RADIUS},
        lambda options: BYTES_PER_FACE * 4.0 ** options["level"],
    ),
    "box": generator(
        box,
        {
            "half_size": Key(POSITIVE_TRIPLE, "Half the extents along its own x, y and z.", (1.0, 1.0, 1.0), unit="metres"),
            "center": CENTER,
            "rotate_y": ROTATE_Y,
        },
    ),
    "quad": generator(quad, {"points": Key(_FOUR_POINTS, "Corners, counter-clockwise seen from the front.", unit="metres")}),
    "rectangle": generator(
        rectangle,
        {
            "corner": Key(POINT, "One corner.", unit="metres"),
            "edge1": Key(POINT, "The edge from the corner to the next.", unit="metres"),
            "edge2": Key(POINT, "The edge from the corner to the last; the front is edge1 x edge2.", unit="metres"),
        },
    ),
}

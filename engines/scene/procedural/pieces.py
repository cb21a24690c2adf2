"""What generators of furnished rooms share: grids of vertices joined to one smooth mesh, curves through points, placing."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.scene.geometry import UP, has_area, lacks_normal, unit_rows, vertex_normals
from engines.scene.procedural.generator import CENTER, ROTATE_Y, Faces, turned
from engines.scene.triple import Triple
from engines.schema import fields
from engines.schema.keys import Key
from engines.schema.kinds import NUMBER, Kind, array_of
from engines.schema.yaml_file import Located

Array = NDArray[np.float64]


class Patch(NamedTuple):
    """`points` (n, 3), `normals` (n, 3) unit, `uvs` (n, 2) and `faces` (m, 3) of a part of a mesh."""

    points: Array
    normals: Array
    uvs: Array
    faces: NDArray[np.int32]


def joined(patches: Sequence[Patch], name: str) -> Faces:
    """One mesh of the patches, without faces of no area."""
    starts = np.cumsum([0, *(len(patch.points) for patch in patches)])
    vertices = np.concatenate([patch.points for patch in patches])
    faces = np.concatenate([patch.faces + start for patch, start in zip(patches, starts, strict=False)]).astype(np.int32)
    uvs = np.concatenate([patch.uvs for patch in patches])
    faces = faces[has_area(vertices, faces)]
    return Faces(vertices, faces, name, lambda: uvs, np.concatenate([patch.normals for patch in patches]))


def seamless_normals(points: Array, faces: NDArray[np.int32]) -> Array:
    """(n, 3) means of adjacent faces, in which vertices at one place count as one; `UP` where these have no area."""
    _, same = np.unique(np.round(points, 9), axis=0, return_inverse=True)
    same = same.ravel()
    whole = np.zeros((int(same.max()) + 1, 3))
    whole[same] = points
    normals = vertex_normals(whole, same[faces].astype(np.int32))[same]
    return np.where(lacks_normal(normals)[:, None], UP, normals)


def curve(points: Array, spans: int, closed: bool = False) -> Array:
    """(n, k) points on a smooth curve through (m, k) points, `spans` pieces between two of them.

    Cubic Hermite pieces, with tangents of a parabola through three neighbours by chord length: without overshoot at points
    that stand unevenly. A closed curve does not repeat its first point.
    """
    count = len(points)
    if count == 2 and not closed:
        return points[0] + np.linspace(0.0, 1.0, spans + 1)[:, None] * (points[1] - points[0])
    around = np.concatenate([points[-1:], points, points[:2]]) if closed else points
    chord = np.linalg.norm(np.diff(around, axis=0), axis=1)
    slope = np.diff(around, axis=0) / chord[:, None]
    inner = (slope[:-1] * chord[1:, None] + slope[1:] * chord[:-1, None]) / (chord[1:] + chord[:-1])[:, None]
    if closed:
        ends, tangents, chord = around[1:-1], inner, chord[1:-1]
    else:
        ends, tangents = points, np.concatenate([2 * slope[:1] - inner[:1], inner, 2 * slope[-1:] - inner[-1:]])
    t = (np.arange(spans) / spans)[None, :, None]
    a, b = ends[:-1, None], ends[1:, None]
    da, db = tangents[:-1, None] * chord[:, None, None], tangents[1:, None] * chord[:, None, None]
    h = t * t * (3 - 2 * t)
    pieces = (a * (1 - h) + b * h + da * t * (1 - t) ** 2 - db * t * t * (1 - t)).reshape(-1, points.shape[1])
    return pieces if closed else np.concatenate([pieces, points[-1:]])


def tangents_of(path: Array, closed: bool = False) -> Array:
    """(n, k) unit tangents by differences of neighbours."""
    differences = np.roll(path, -1, axis=0) - np.roll(path, 1, axis=0) if closed else np.gradient(path, axis=0)
    return differences / np.linalg.norm(differences, axis=1, keepdims=True)


def lengths(path: Array) -> Array:
    """(n,) length of the path up to each point."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(path, axis=0), axis=1))])


def placed(made: Faces, tilt: float, rotate_y: float, center: Triple) -> Faces:
    """The mesh turned by `tilt` degrees about +x, then by `rotate_y` about +y, then moved."""
    if made.normals is None:
        return made._replace(vertices=turned(_tilted(made.vertices, tilt), rotate_y) + np.array(center))
    normals = unit_rows(turned(_tilted(made.normals, tilt), rotate_y))
    return made._replace(vertices=turned(_tilted(made.vertices, tilt), rotate_y) + np.array(center), normals=normals)


def _tilted(points: Array, tilt: float) -> Array:
    return turned(points[:, [1, 0, 2]], -tilt)[:, [1, 0, 2]]


def points_of(width: int, least: int) -> Kind:
    """A list of at least `least` rows of `width` numbers."""

    def read(node: Located) -> Array:
        points = fields.rows(node, np.float64, width=width)
        if len(points) < least:
            raise node.refuse(f"{len(points)} points: at least {least} are expected")
        return points

    return Kind(read, {"type": "array", "items": array_of(NUMBER.json, width), "minItems": least})


TILT = Key(NUMBER, "Angle by which it is turned about +x, before rotate_y.", 0.0, unit="degrees")
PLACED = {"center": CENTER, "tilt": TILT, "rotate_y": ROTATE_Y}

"""Meshes from files as Mitsuba reads them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from engines.scene.formats.mesh import MeshData, read_mesh
from engines.scene.geometry import unit_rows
from engines.scene.mitsuba_xml.context import Importer
from engines.scene.mitsuba_xml.document import Element
from engines.scene.mitsuba_xml.properties import Plugin


def read_file(importer: Importer, plugin: Plugin, named: Element, flat: bool) -> MeshData:
    """Vertices, faces, texture coordinates and (unless `flat`) normals of the file that is named."""
    return read_mesh(named.located(named.attributes["value"]), importer.place, not flat, with_materials=False)


def angle_weighted_normals(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    """(n, 3) unit: adjacent faces' normals weighted with their angles at the vertex (Thürmer and Wüthrich 1998)."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)
    sums = np.zeros_like(vertices)
    for corner in range(3):
        a = corners[:, (corner + 1) % 3] - corners[:, corner]
        b = corners[:, (corner + 2) % 3] - corners[:, corner]
        angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ij,ij->i", a, b))
        for axis in range(3):
            sums[:, axis] += np.bincount(faces[:, corner], normals[:, axis] * angle, len(vertices))
    return unit_rows(sums)

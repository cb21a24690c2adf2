"""Meshes from files as Mitsuba reads them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from engines.scene.formats.mesh import MeshData, read_mesh_file
from engines.scene.geometry import summed_normals
from engines.scene.mitsuba_xml.context import Importer
from engines.scene.mitsuba_xml.document import Element
from engines.scene.mitsuba_xml.properties import Plugin


def read_file(importer: Importer, plugin: Plugin, named: Element, flat: bool) -> MeshData:
    """Vertices, faces, texture coordinates and (unless `flat`) normals of the file that is named."""
    node, suffix = named.located(named.attributes["value"]), f".{plugin.type}"
    shape_index = plugin.integer("shape_index", default=0, low=0, high=2**31 - 1) if suffix == ".serialized" else 0
    flip = plugin.boolean("flip_tex_coords", default=suffix == ".obj") if suffix != ".serialized" else False
    file = importer.place.find(node, node.value)
    data = read_mesh_file(node, file, not flat, True, shape_index, flip_v=flip, suffix=suffix)
    for note in data.warnings:
        importer.notes.add(note, named)
    if flip and suffix != ".obj" and data.uvs is not None:
        data = replace(data, uvs=data.uvs * [1.0, -1.0] + [0.0, 1.0])
    return data


def angle_weighted_normals(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    """(n, 3) unit: adjacent faces' normals weighted with their angles at the vertex (Thürmer and Wüthrich 1998); zeros where
    they cancel."""
    corners = vertices[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, lengths, out=np.zeros_like(normals), where=lengths > 0.0)
    shares = np.empty((len(faces), 3, 3))
    for corner in range(3):
        a = corners[:, (corner + 1) % 3] - corners[:, corner]
        b = corners[:, (corner + 2) % 3] - corners[:, corner]
        angle = np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), np.einsum("ij,ij->i", a, b))
        shares[:, corner] = normals * angle[:, None]
    return summed_normals(faces, shares, len(vertices))

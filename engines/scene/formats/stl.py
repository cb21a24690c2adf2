"""Meshes as STL, text or binary: triangles that share no vertices."""

from __future__ import annotations

import re
import struct

import numpy as np
from numpy.typing import NDArray

from engines.scene.formats import FileMesh
from engines.scene.formats.ply import parse_numbers

HEADER = 84
"""Bytes before the triangles of a binary file; the last four are their number."""
TRIANGLE = np.dtype([("normal", "<f4", 3), ("vertices", "<f4", (3, 3)), ("attribute", "<u2")])
_VERTEX = re.compile(rb"^[ \t]*vertex\b(?:[ \t]+(\S+[ \t]+\S+[ \t]+\S+)[ \t]*\r?$)?", re.IGNORECASE | re.MULTILINE)
_END = re.compile(rb"^[ \t]*endsolid\b", re.IGNORECASE | re.MULTILINE)


def parse_stl(data: bytes) -> FileMesh:
    """The mesh of an STL file, each triangle with vertices of its own. Raises `ValueError` for what is no STL file.

    A binary file may begin with "solid", too: what is as long as its number of triangles says is binary.
    """
    if len(data) >= HEADER and len(data) == HEADER + struct.unpack_from("<I", data, HEADER - 4)[0] * TRIANGLE.itemsize:
        return _mesh(np.frombuffer(data, TRIANGLE, offset=HEADER)["vertices"].reshape(-1, 3).astype(np.float64))
    if not data.lstrip()[:5].lower() == b"solid":
        raise ValueError("its length is not what a binary file's number of triangles says, and a text begins with 'solid'")
    rows = _VERTEX.findall(data)
    if rows and not _END.search(data):
        raise ValueError("it is cut short: 'endsolid' is missing")
    if b"" in rows or len(rows) % 3:
        raise ValueError("a vertex has three numbers, and a facet three vertices")
    return _mesh(parse_numbers(b" ".join(rows)).reshape(-1, 3))


def _mesh(corners: NDArray[np.float64]) -> FileMesh:
    return FileMesh(corners, np.arange(len(corners)).reshape(-1, 3))

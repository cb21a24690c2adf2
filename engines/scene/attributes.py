"""Attributes of meshes: named numbers of each vertex or face, such as vertex colours."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

VERTEX, FACE = "vertex_", "face_"
"""How the names of attributes begin, by what they belong to."""
EXPECTED_NAME = "must begin with vertex_ or face_, and go on with letters, digits and _"
Attributes = Mapping[str, NDArray[np.float32]]
"""By name, (n, 3) or (n, 1) values in [0, 1] of n vertices or faces, read-only."""


def is_attribute(name: str) -> bool:
    """Whether an attribute may have this name."""
    return re.fullmatch(r"(vertex|face)_\w+", name, re.ASCII) is not None


def checked_attributes(attributes: Mapping[str, Any], vertices: int, faces: int) -> dict[str, NDArray[np.float32]]:
    """Read-only attributes of a mesh with so many vertices and faces. Raises ValueError."""
    if wrong := next((name for name in attributes if not (isinstance(name, str) and is_attribute(name))), None):
        raise ValueError(f"attribute {wrong!r}: {EXPECTED_NAME}")
    return {name: _checked(name, values, vertices if name.startswith(VERTEX) else faces) for name, values in attributes.items()}


def _checked(name: str, values: Any, rows: int) -> NDArray[np.float32]:
    array = np.asarray(values)
    if array.dtype.kind not in "iuf" or array.shape not in ((rows, 1), (rows, 3)):
        expected = f"must be {rows} rows of 1 or 3 numbers"
        raise ValueError(f"attribute {name!r}: {array.dtype} array {array.shape}: {expected}")
    if not ((array >= 0) & (array <= 1)).all():
        raise ValueError(f"attribute {name!r}: must lie in [0, 1]")
    if array.dtype != np.float32 or array.flags.writeable or not array.flags.c_contiguous:
        array = np.array(array, np.float32)
        array.flags.writeable = False
    return array


def of_copies(attributes: Attributes, vertices: NDArray[np.integer]) -> dict[str, NDArray[np.float32]]:
    """The attributes where copies of these vertices have been added behind the others."""
    return {
        name: np.concatenate([values, values[vertices]]) if name.startswith(VERTEX) and len(vertices) else values
        for name, values in attributes.items()
    }


def of_elements(attributes: Attributes, vertices: Any, faces: Any) -> dict[str, NDArray[np.float32]]:
    """The attributes of the vertices and faces that these indices choose."""
    return {name: values[vertices if name.startswith(VERTEX) else faces] for name, values in attributes.items()}

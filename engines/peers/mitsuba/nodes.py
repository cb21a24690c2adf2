"""What descriptions for Mitsuba are made of: nested dictionaries, and files that a caller places."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from engines.scene.attributes import Attributes

Array = NDArray[Any]
Node = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Placing:
    """Where a description's data goes.

    `mesh(name, vertices, faces, normals, uvs, attributes)` gives the name of a PLY file, where normals and uvs may be None.
    `image(name, array)` of (h, w, 3) or (h, w, 1) linear values gives the keys by which Mitsuba finds it.
    """

    mesh: Callable[[str, Array, Array, Array | None, Array | None, Attributes], str]
    image: Callable[[str, Array], Node]


def rgb(values: Any) -> Node:
    """A colour, three numbers of linear RGB."""
    return {"type": "rgb", "value": [float(value) for value in values]}

"""Generators of shapes by name: `{procedural: {name: sphereflake, level: 4}, material: white}`.

`GENERATORS` has them all: each with its function, its options (default, meaning, how they are read) and the size of
what it makes, which is checked against the machine's memory before anything is allocated. Each module has a table of its
own; to add one, add a line there.

The families of Haines' Standard Procedural Databases (Haines 1987, and version 3 of its programs) go by their names there,
except that `balls` is called by the name it became known by: `sphereflake`, `tetra`, `mount`, `rings`, `gears`, `lattice`,
`tree`; `level` is the size factor there, and gives as many primitives, but that cylinders, cones and the polygons of
gears are made of triangles here.
"""

from __future__ import annotations

import numpy as np

from engines.errors import suggestion
from engines.scene import fields
from engines.scene.memory import refuse_above_memory
from engines.scene.procedural import gears, rods, solids, sphereflake, stadium, surfaces, teapot, tetra
from engines.scene.procedural.generator import Faces, Generator, Spheres
from engines.scene.yaml_file import Located

__all__ = ["GENERATORS", "Faces", "Spheres", "generate"]

GENERATORS: dict[str, Generator] = {
    **sphereflake.GENERATORS, **solids.GENERATORS, **surfaces.GENERATORS, **tetra.GENERATORS, **rods.GENERATORS,
    **gears.GENERATORS, **teapot.GENERATORS, **stadium.GENERATORS,
}  # fmt: skip


def generate(node: Located) -> Faces | Spheres:
    """What the mapping at `node` asks for. Raises for unknown names and options, and for values out of range."""
    if not isinstance(node.value, dict):
        raise node.refuse("must be a mapping with a name and options")
    if "name" not in node.value:
        raise node.refuse_key("name", f"is missing: known: {', '.join(sorted(GENERATORS))}")
    named = node.value["name"]
    if not isinstance(named.value, str) or named.value not in GENERATORS:
        raise named.refuse(f"unknown procedural shape: {suggestion(str(named.value), GENERATORS)}")
    generator = GENERATORS[named.value]
    required = [key for key, option in generator.options.items() if option.default is ...]
    given = fields.mapping(node, ["name", *generator.options], required)
    options = {
        key: option.read(given[key]) if key in given else option.default for key, option in generator.options.items()
    }
    refuse_above_memory(node, generator.needs(options), f"procedural shape {named.value!r} of this size")
    with np.errstate(over="ignore", invalid="ignore"):
        made = generator.make(**options)
    arrays = (made.centers, made.radii) if isinstance(made, Spheres) else (made.vertices,)
    if not all(np.isfinite(array).all() for array in arrays):
        raise node.refuse("its coordinates must be finite: make it smaller")
    return made

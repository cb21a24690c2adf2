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

from engines.scene.procedural import furniture, gears, growth, rods, solids, sphereflake, stadium, surfaces, sweeps, teapot
from engines.schema.keys import Record, Tagged

__all__ = ["GENERATORS", "PROCEDURAL"]

GENERATORS: dict[str, Record] = {
    **sphereflake.GENERATORS,
    **solids.GENERATORS,
    **surfaces.GENERATORS,
    **rods.GENERATORS,
    **gears.GENERATORS,
    **teapot.GENERATORS,
    **stadium.GENERATORS,
    **sweeps.GENERATORS,
    **furniture.GENERATORS,
    **growth.GENERATORS,
}
PROCEDURAL = Tagged("procedural shape", "name", GENERATORS)
"""Reads a mapping with a name and options into a `Mesh` or a `SphereSet` of the material `context.material`."""

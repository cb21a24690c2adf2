"""Generators of shapes by name: `{procedural: {name: sphereflake, level: 4}, material: white}`.

`GENERATORS` is the table: each name with its function, its options (default, meaning, how they are read) and the size
of what it makes, which is checked against the machine's memory before anything is allocated. To add one, add a line.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from engines.errors import suggestion
from engines.scene import fields
from engines.scene.memory import refuse_above_memory
from engines.scene.solids import Faces, box, quad, rectangle, tessellated_sphere
from engines.scene.sphereflake import Spheres, sphere_count, sphereflake
from engines.scene.surfaces import terrain, torus_knot
from engines.scene.yaml_file import Located

BYTES_PER_FACE = 250
BYTES_PER_SPHERE = 200
"""Memory at the height of generating, temporaries and the checks of the loader included."""


@dataclass(frozen=True, slots=True)
class Option:
    """`read` turns a Located value into a plain one or raises; no `default` means that the option must be given."""

    read: Callable[[Located], Any]
    meaning: str
    default: Any = ...


@dataclass(frozen=True, slots=True)
class Generator:
    """`make(**options)` returns `Faces` or `Spheres`; `needs(options)` estimates bytes."""

    make: Callable[..., Faces | Spheres]
    options: Mapping[str, Option]
    needs: Callable[[Mapping[str, Any]], float] = lambda options: 0.0


def _integer(low: int, high: int) -> Callable[[Located], int]:
    return lambda node: fields.integer(node, low, high)


def _within(low: float, high: float) -> Callable[[Located], float]:
    return lambda node: fields.within(node, low, high)


def _positive_triple(node: Located) -> Any:
    found = fields.triple(node)
    if min(found) <= 0.0:
        raise node.refuse(f"{list(found)}: must be greater than 0")
    return found


def _four_points(node: Located) -> Any:
    found = fields.rows(node, np.float64)
    if len(found) != 4:
        raise node.refuse(f"{len(found)} points: four are wanted")
    return found


_CENTER = Option(fields.triple, "the middle", (0.0, 0.0, 0.0))
_RADIUS = Option(fields.positive, "in metres", 1.0)

GENERATORS: dict[str, Generator] = {
    "sphereflake": Generator(
        sphereflake,
        {
            "level": Option(_integer(0, 30), "generations; (9^(level + 1) - 1)/8 spheres", 2),
            "center": _CENTER,
            "radius": Option(fields.positive, "of the largest sphere, in metres", 0.5),
        },
        lambda options: BYTES_PER_SPHERE * sphere_count(options["level"]),
    ),
    "tessellated_sphere": Generator(
        tessellated_sphere,
        {
            "subdivisions": Option(_integer(0, 30), "of an icosahedron; 20 * 4^subdivisions faces", 4),
            "center": _CENTER,
            "radius": _RADIUS,
        },
        lambda options: BYTES_PER_FACE * 20.0 * 4.0 ** options["subdivisions"],
    ),
    "terrain": Generator(
        terrain,
        {
            "cells": Option(_integer(1, 1 << 20), "along each side; 2 cells^2 faces", 128),
            "size": Option(fields.positive, "of a side, in metres", 10.0),
            "height": Option(fields.positive, "from lowest to highest point, in metres", 2.0),
            "roughness": Option(_within(0.0, 1.0), "what an octave adds, as a share of the one before", 0.5),
            "seed": Option(_integer(0, 2**32 - 1), "of the random gradients", 0),
            "center": Option(fields.triple, "the middle of the lowest level", (0.0, 0.0, 0.0)),
        },
        lambda options: BYTES_PER_FACE * 2.0 * options["cells"] ** 2,
    ),
    "torus_knot": Generator(
        torus_knot,
        {
            "p": Option(_integer(1, 64), "turns about the axis", 2),
            "q": Option(_integer(1, 64), "turns about the ring", 3),
            "segments": Option(_integer(8, 1 << 24), "along the tube", 512),
            "sides": Option(_integer(3, 1 << 16), "around the tube", 32),
            "radius": Option(fields.positive, "of the ring, in metres", 1.0),
            "tube": Option(fields.positive, "radius of the tube, in metres", 0.2),
            "center": _CENTER,
        },
        lambda options: BYTES_PER_FACE * 2.0 * options["segments"] * options["sides"],
    ),
    "box": Generator(
        box,
        {
            "half_size": Option(_positive_triple, "half the extents along its own x, y, z", (1.0, 1.0, 1.0)),
            "center": _CENTER,
            "rotate_y": Option(fields.number, "degrees about +y, right-handed", 0.0),
        },
    ),
    "quad": Generator(quad, {"points": Option(_four_points, "corners, counter-clockwise seen from the front")}),
    "rectangle": Generator(
        rectangle,
        {
            "corner": Option(fields.triple, "one corner"),
            "edge1": Option(fields.triple, "from the corner to the next"),
            "edge2": Option(fields.triple, "from the corner to the last; the front is edge1 x edge2"),
        },
    ),
}


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

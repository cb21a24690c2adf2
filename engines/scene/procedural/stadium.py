"""A stadium, for teapots to stand in: few large triangles around many small ones."""

from __future__ import annotations

import numpy as np

from engines.scene.procedural.generator import BYTES_PER_FACE, ORIGIN, Faces, generator, quads
from engines.scene.triple import Triple
from engines.schema.keys import Key
from engines.schema.kinds import POINT, POSITIVE, integer


def stadium(tiers: int, segments: int, size: float, rise: float, depth: float, center: Triple) -> Faces:
    """Steps around an oval field `size` long and two thirds as wide, front inwards and upwards; the field is left open.

    `center` is the middle of the field; a step is `rise` high and `depth` deep. 4 * tiers * segments faces.
    """
    around = 2.0 * np.pi * np.arange(segments) / segments
    step = np.repeat(np.arange(tiers + 1), 2)
    out, up = step[:-1] * depth, step[1:] * rise
    x = (size / 2 + out)[:, None] * np.cos(around)
    z = (size / 3 + out)[:, None] * np.sin(around)
    y = np.broadcast_to(up[:, None], x.shape)
    vertices = np.stack([x, y, z], axis=2, dtype=np.float64).reshape(-1, 3) + np.array(center)
    index = np.arange(x.size, dtype=np.int32).reshape(x.shape)
    ahead = np.roll(index, -1, axis=1)
    return Faces(vertices, quads(index[:-1], ahead[:-1], ahead[1:], index[1:]), "stadium")


GENERATORS = {
    "stadium": generator(
        stadium,
        {
            "tiers": Key(integer(1, 10_000), "Number of steps.", 12),
            "segments": Key(integer(3, 1 << 20), "Segments along a step.", 48),
            "size": Key(POSITIVE, "Length of the field.", 100.0, unit="metres"),
            "rise": Key(POSITIVE, "Height of a step.", 0.8, unit="metres"),
            "depth": Key(POSITIVE, "Depth of a step.", 1.5, unit="metres"),
            "center": Key(POINT, "The middle of the field.", ORIGIN, unit="metres"),
        },
        lambda options: BYTES_PER_FACE * 4.0 * options["tiers"] * options["segments"],
    )
}

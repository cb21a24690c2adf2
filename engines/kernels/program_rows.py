"""Rows of the scene's table that materials with programs have (`engines.kernels.flatten.programs`)."""

from __future__ import annotations

import numpy as np

from engines.kernels.compile.records import Row, real, reals, vector


class NodeRow(Row):
    """A step of a material's program: see `engines.kernels.flatten.programs`."""

    dtype = np.float64
    kind = real()
    first = real()  # node to go on with, the first of two; of a leaf, the kind of its model
    second = real()  # node; of a leaf, its row of parameters; of a tilt, whether light passes what it leads to
    texture = real()  # -1 for none; of a leaf, its first lookup
    value = real()  # where there is no texture; scale of a bump map; of a leaf, how many lookups


class LookupRow(Row):
    """A parameter of a leaf that a texture gives: a channel, or 3 for the luminance, held in [low, high]."""

    dtype = np.float64
    parameter = real()
    texture = real()
    channel = real()
    low = real()
    high = real()


class TextureRow(Row):
    """Of an image: texels, filter and wrap; of a checkerboard: its two colours. Then the matrix of `to_uv`, and whether the
    image has a palette (`engines.kernels.flatten.palettes`)."""

    dtype = np.float64
    kind = real()
    width = real()
    height = real()
    channels = real()
    nearest = real()
    wrap = real()
    to_uv = reals(6)
    a = vector()
    b = vector()
    indexed = real()


class UVRow(Row):
    """Texture coordinates of a vertex; `given` is 0 where its mesh has none."""

    dtype = np.float64
    u = real()
    v = real()
    given = real()

"""Rows of the scene's table about lights."""

from __future__ import annotations

import numpy as np

from engines.kernels.compile.records import Row, real, reals, vector

LIGHT_PARAMETERS = 8


class LightRow(Row):
    """Parameters depend on the kind: see `engines.kernels.flatten.lights`."""

    kind = real()
    color = vector()
    two_sided = real()
    parameters = reals(LIGHT_PARAMETERS)


class EnvironmentRow(Row):
    """How directions become places in an environment's image: y = v `rows` - `first_row` counts its rows; the local axes are
    those of the image in the scene."""

    dtype = np.float64
    rows = real()
    first_row = real()
    x = vector()
    y = vector()
    z = vector()


class RangeRow(Row):
    """The faces of a mesh that is a light."""

    dtype = np.int32
    first = real()
    count = real()

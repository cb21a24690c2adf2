"""Rows of the scene's table about shapes."""

from __future__ import annotations

import numpy as np

from engines.kernels.compile.records import Row, real, reals, vector

SHAPE_PARAMETERS = 7


class TriangleRow(Row):
    """Indices of vertices."""

    dtype = np.int32
    a = real()
    b = real()
    c = real()


class SphereRow(Row):
    dtype = np.float64
    center = vector()
    radius = real()


class PlaneRow(Row):
    dtype = np.float64
    point = vector()
    normal = vector()


class AnalyticRow(Row):
    """A shape of `engines.kernels.flatten.shapes.ANALYTIC`."""

    dtype = np.float64
    parameters = reals(SHAPE_PARAMETERS)


class PrimitiveRow(Row):
    """Kind of the shape, index among those of its kind, material, light (-1: not in the list of lights)."""

    dtype = np.int32
    shape = real()
    index = real()
    material = real()
    light = real()

"""Rows of the arrays of a flattened scene: shapes, lights, materials and their programs, the camera."""

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


class InstanceRow(Row):
    """How a group is placed: the rows of the matrix and of its inverse, which take differences of points from the group's
    coordinates to the tracing coordinates and back, and where the group's origin comes to lie. Then the group; the place among
    the scene's shapes; the id of the first primitive of the group; and the lowest id of the shapes behind it that are no
    instances: of hits at equal distances those of lower ids win, and lose those of others."""

    dtype = np.float64
    out_x = vector()
    out_y = vector()
    out_z = vector()
    in_x = vector()
    in_y = vector()
    in_z = vector()
    moved = vector()
    group = real()
    shape = real()
    first = real()
    behind = real()


class PrimitiveRow(Row):
    """Kind of the shape, index among those of its kind, material, light (-1: not in the list of lights)."""

    dtype = np.int32
    shape = real()
    index = real()
    material = real()
    light = real()


LIGHT_PARAMETERS = 8


class LightRow(Row):
    """Parameters depend on the kind: see `engines.kernels.flatten.lights`."""

    kind = real()
    color = vector()
    two_sided = real()
    parameters = reals(LIGHT_PARAMETERS)


class LightFrameRow(Row):
    """How directions d from a light become places in its texture: u = 1/2 + (d . across)/(d . axis), v the same with `down`.
    `texture` is -1 where the light has none."""

    dtype = np.float64
    texture = real()
    axis = vector()
    across = vector()
    down = vector()


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
    """Of an image: texels, filter and wrap; of a checkerboard: its two colours; of an attribute of meshes: its scale, in `a`.
    Then the matrix of `to_uv`, and whether the image has a palette (`engines.kernels.flatten.palettes`)."""

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


BSDF_PARAMETERS = 15


class MaterialRow(Row):
    """What every scene reads comes first, and the first parameters of the model in the same cache line."""

    emission = vector()
    two_sided = real()
    model = real()
    bsdf = reals(BSDF_PARAMETERS)  # of the model; of a program, of its first leaf


class LeafRow(Row):
    """The parameters of a model, 0 where they are looked up."""

    bsdf = reals(BSDF_PARAMETERS)


class MediumRow(Row):
    """A homogeneous medium, in 1/m. The last row is vacuum."""

    sigma_t = vector()
    albedo = vector()
    g = real()


class CameraRow(Row):
    """`right` and `up` are scaled by half the width and height; for the arctangent map they are unit vectors, and the
    half angles are given. Two pixels' widths are `2 / width`, and the axis of view passes at `middle_x / 2` of the width, from
    the left, and at `middle_y / 2` of the height, from the top."""

    dtype = np.float64
    eye = vector()
    forward = vector()
    right = vector()
    up = vector()
    width = real()
    height = real()
    half_angle_x = real()
    half_angle_y = real()
    middle_x = real()
    middle_y = real()
    near = real()  # distances along the axis of view, of cameras that clip
    far = real()
    lens_right = vector()  # as long as the radius of the aperture
    lens_up = vector()
    focus_distance = real()


class GuideRow(Row):
    """The box of an SD-tree, in tracing coordinates, and the share of guided directions that BSDFs sample."""

    corner = vector()
    size = vector()
    bsdf_fraction = real()


class MarginRow(Row):
    """How far off the surface new rays start, as a share of the largest coordinate there; the share of the way to a
    light that a shadow ray covers."""

    dtype = np.float64
    offset = real()
    shadow_share = real()

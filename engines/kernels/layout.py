"""The memory that kernels work on, as named and typed records: the ray batch, and the flattened scene.

A *ray batch* is the state of sixteen paths, one a lane. The *scene* is a table of arrays; geometry is relative to
`FlatScene.center`, in the tracing precision unless it says otherwise. Every primitive has an id: its place in the order
of shapes that are no instances, then of primitives within a shape; behind them come those of each group, once. Among hits at
equal distances the lowest id wins. What a ray meets or leaves is a pair (instance, primitive), where there are instances.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.kernels.compile.jit import inline
from engines.kernels.compile.masks import copy_lanes
from engines.kernels.compile.records import (
    LANES,  # noqa: F401 (stages import it from here)
    REAL,
    LaneRecord,
    Table,
    array,
    bits_of,
    doubles,
    flag,
    integer,
    lane_view,
    real,
    reals,
    record,
    rows,
    scalar,
    table_view,
    vector,
    vectors,
)
from engines.kernels.compile.vec3 import Vec3
from engines.kernels.integrators.interface import Path
from engines.kernels.lane.bsdf.interface import Scattering
from engines.kernels.lane.lights import LightSample
from engines.kernels.lane.shapes.intersection import ShapeIntersection
from engines.kernels.rows import (
    BSDF_PARAMETERS,
    LIGHT_PARAMETERS,
    SHAPE_PARAMETERS,
    AnalyticRow,
    CameraRow,
    EnvironmentRow,
    GuideRow,
    InstanceRow,
    LeafRow,
    LightFrameRow,
    LightRow,
    LookupRow,
    MarginRow,
    MaterialRow,
    MediumRow,
    NodeRow,
    PlaneRow,
    PrimitiveRow,
    RangeRow,
    SphereRow,
    TextureRow,
    TriangleRow,
    UVRow,
)

SHADER_OPTIONS = 8
"""Numbers in the scene's options that belong to the integrator."""
POINT_U0, POINT_U1, LIGHT, LOBE, DIRECTION_U0, DIRECTION_U1, ROULETTE = range(7)
"""The random numbers of a vertex: the place on the light, which light, the lobe, the direction, roulette."""
VERTEX_DRAWS = 7
MOST_LIGHT_CANDIDATES = 32
"""Light samples at a vertex of which one is taken, at most."""
VERTEX_DIMENSIONS = 8
"""Dimensions from the first of a vertex to the first of the next. No vertex draws the last one; a thin lens takes those of the
first two vertices."""
MOST_NULL_LOBES = 1024
"""Null lobes that a path or a shadow ray crosses at most: rounding must not hold a ray for ever."""
CAMERA_DIMENSIONS = 2
"""Dimensions before the first vertex: the place in the pixel."""
RUN = 16
"""Texels of an environment's row whose densities are summed in the tables by which one is chosen: a cache line of float32."""
SURFACE, MISS, MEDIUM = range(3)
"""What a ray has met: a medium scatters it where it is `MEDIUM`."""


class Hit(NamedTuple):
    """What a ray has met. Where that is nothing, `emission` is the environment's, and `t` of the ray is infinite. Where a
    medium scatters the ray, both normals are 0, and nothing is emitted.

    Until the surface stage stores it, `point` and `geometric_normal` are those of the last vertex, where the ray starts."""

    kind: int
    """SURFACE, MISS or MEDIUM."""
    front: bool
    """Met from the side of the shape's own normal."""
    shape: int
    """Kind of shape."""
    u: float
    v: float
    point: Vec3
    normal: Vec3
    """Shading normal, towards the viewer, as the next."""
    geometric_normal: Vec3
    tangent: Vec3
    """Derivative of the point by the shape's first coordinate, where some material is anisotropic."""
    offset: float
    """How far from the surface new rays start; in a medium, by how much shadow rays end early."""
    emission: Vec3
    """Towards the viewer."""
    light_pdf: float
    """With which the light sample would have found this emission; 0 where it never does."""


class Face(NamedTuple):
    """A triangle of a mesh: the indices of its vertices, and where they are."""

    corner0: int
    corner1: int
    corner2: int
    vertex0: Vec3
    vertex1: Vec3
    vertex2: Vec3


class ShadowRay(NamedTuple):
    """A ray from the surface to the light sample, and what it brings if it is free."""

    origin: Vec3
    direction: Vec3
    t_max: float
    """Not above 0 for no ray."""
    destination: Vec3
    """The place on the light, where null lobes are crossed."""
    occluded: int
    """1 or 0: loops that join flags cost more than those that select numbers."""
    direct: Vec3
    """Added to the radiance if the ray is free."""
    transmittance: Vec3
    """In the batch of shadow rays that cross null lobes: what has passed so far."""


class Branch(NamedTuple):
    """A second ray that leaves later, on the side where the viewer is."""

    there: bool
    origin: Vec3
    direction: Vec3
    throughput: Vec3


class Wrapped(NamedTuple):
    """What wrappers of BSDFs have made of the surface."""

    opacity: float
    """The share of the surface that is there."""
    passing: bool
    """The sample goes straight through."""
    untilted_normal: Vec3
    """The shading normal before the innermost map, whose result is that of the hit."""
    outer_normal: Vec3
    """The shading normal before the outermost map."""


class Crossing(NamedTuple):
    """The way of a path through surfaces that are no vertices."""

    absent: bool
    """The surface is an emitter that hides."""
    scattered: bool
    """Something else than null lobes lies between the camera and the ray."""
    way: float
    """From the last vertex to the ray's origin."""
    point: Vec3
    """The last vertex."""
    normal: Vec3
    """Its geometric normal."""


class Flight(NamedTuple):
    """The way of a ray through its medium, a row of `SceneTable.media`."""

    medium: int
    lead: float
    """From the surface that the ray has left to its origin, along the ray."""
    distance: float
    """From that surface to where the medium scatters the ray, unless a surface lies before; infinite for never."""
    sigma_t: Vec3
    albedo: Vec3
    g: float
    near: int
    """The medium of rays that leave the vertex on the viewer's side."""
    far: int
    """The same on the other side."""


class Attenuation(NamedTuple):
    """The way of a shadow ray through its medium."""

    medium: int
    lead: float
    """As that of `Flight`."""
    distance: float
    """To the light, from the surface that the ray has left; 0 without a ray."""


class Guide(NamedTuple):
    """The choice between the BSDF's direction and that of an SD-tree (`stages.guiding`)."""

    leaf: int
    """Of the tree over space, where the vertex lies."""
    bsdf_share: float
    """With which the BSDF samples the direction, else the tree does."""
    by_tree: bool
    """The tree does."""
    wi: Vec3
    """Its sample."""
    node: int
    """In a walk through the tree, below 0 at its end."""
    place: Vec3
    """The vertex, in halves of halves of the box."""
    u0: float
    u1: float
    x: float
    y: float
    """A direction as a place in the square, or in a part of it."""
    pdf: float
    """With which the tree samples it, per solid angle."""


class Recorded(NamedTuple):
    """A direction that the tree will learn from."""

    vertex: int
    """Its number along the path, from 0 on; -1 for none."""
    cell: int
    """4 times the tree's node in which it lies, plus the quarter."""
    throughput: Vec3
    """Of the path, before the vertex."""


class RayBatch(LaneRecord):
    """Sixteen lanes, field by field. Behind the fields lies scratch memory for intersectors."""

    # the path: `copy_paths` copies all fields down to `waiting` from the batch in which the camera begins samples. What lies
    # below is written for each vertex before it counts, but for `crossing` (for each sample, whose first ray is known by its
    # dimension) and `hit` (see there)
    alive = flag()  # the lane has a sample in flight
    slot = integer()  # where in the tile's buffer the radiance goes
    pixel = integer()  # y * width + x
    sample = integer()  # index of the sample
    dimension = integer()  # first dimension of the next draws; it counts rays where null lobes are crossed
    origin = vector()
    direction = vector()
    t = real()  # in: t_max, not above 0 for a lane without a ray; out: distance of the hit
    origin_primitive = integer()  # id of the primitive that the ray and the shadow ray leave, and do not meet; -1 for none
    path = record(Path)
    radiance = vector()
    cosine_pdf = real()  # of the last direction under the cosine rule
    waiting = integer()  # rays on the lane's stack

    light_index = integer()  # which light's turn it is, for integrators that visit all: the same in every lane
    pixel_x = real()
    pixel_y = real()
    pixel_key = integer()  # the sampler's key of the pixel
    draw = reals(VERTEX_DRAWS)  # the random numbers of this vertex, in [0, 1)
    draw_bits = bits_of(draw)
    primitive = integer()  # id of the primitive hit, -1 for none
    done = flag()  # the path has just ended

    hit = record(Hit)  # as the surface stage leaves it; programs of materials change the shading normal and the tangent
    bsdf = reals(BSDF_PARAMETERS)  # of the material's model
    bsdf_model = integer()  # which model, where the scene holds several

    # what the surface stage loads of the scene before it computes, so that loops over lanes are vector code on any machine
    primitive_row = integer()  # the id of the primitive, 0 for none
    shape_row = integer()  # the index of its shape among those of its kind, or of its triangle
    formula_row = integer()  # of a shape that is no triangle
    face = record(Face)
    vertex_normal0, vertex_normal1, vertex_normal2 = vector(), vector(), vector()
    # where the ray meets its shape, in scenes with other shapes than triangles; further down, `two_spheres` was 12 % slower
    # (measured; probably what a loop loads and stores lay 4 KiB apart)
    found = record(ShapeIntersection)
    shape_parameters = doubles(SHAPE_PARAMETERS)
    material = integer()
    two_sided = real()  # 1 or 0
    emitter = integer()  # index of the light that the primitive belongs to, -1 for none
    emitter_row = integer()  # the same, 0 for none
    emitter_parameters = reals(LIGHT_PARAMETERS)
    emitter_inverse_pmf = real()  # 1 / the probability with which it would be chosen, where that differs between lights

    # what the light stage loads of the light that it samples
    chosen_light = integer()  # its index, -1 for none
    light_node = integer()  # on the way there, in a hierarchy of lights
    light_cell = integer()  # the part of a grid's cell that the vertex lies in
    light_row = integer()  # the index, 0 for none
    light_rest = doubles(1)  # what is left of the random number that chose the light
    light_kind = integer()
    light_row_kind = real()  # the same, as the row of the light has it
    light_parameters = reals(LIGHT_PARAMETERS)
    light_color = vector()
    light_two_sided = real()
    light_face = record(Face)  # of a mesh
    light_primitive = integer()  # id of the face
    light_material = integer()
    light_inverse_pmf = real()

    # places on the environment's image, and the sine of the angle from its axis: of a ray that misses, and of a light sample
    missed_place = doubles(3)
    environment_place = doubles(3)
    environment_row = integer()  # of the light sample
    environment_column = integer()  # the first of its run

    # what the stages of materials and of null lobes keep between their loops
    program = integer()  # the first node of the hit's program, -1 for none
    coordinates = doubles(8)  # (u, v) and the derivatives of the point, of hits that have a program

    light_sample = record(LightSample)  # at the surface, as the light stage leaves it
    shadow = record(ShadowRay)  # as the shade stage leaves it; `occluded` is the intersector's
    branch = record(Branch)

    # scratch of intersectors
    shear_x = vector()
    shear_y = vector()
    shear_z = vector()

    scatter = record(Scattering)  # the BSDF at this vertex, where models have stages of their own

    wrapped = record(Wrapped)  # where the scene has masks, bump or normal maps; written by the material stage
    crossing = record(Crossing)  # where null lobes are crossed freely, or emitters hide from the camera
    guide = record(Guide)  # where paths are guided
    recorded = record(Recorded)
    flight = record(Flight)  # in scenes with media, as is the next
    attenuation = record(Attenuation)

    # where the light sample is one of several candidates (`stages.resampling`)
    drawn = reals(3)  # the vertex's random numbers, from which each candidate's follow
    candidate = integer()
    targets = reals(MOST_LIGHT_CANDIDATES)  # candidates are picked in proportion to these
    target_sum = real()
    target_begin = real()  # the sum of those before a candidate
    target = real()  # of the candidate that is picked

    # in scenes with instances
    instance = integer()  # in which the primitive was hit, -1 for none
    origin_instance = integer()  # the same of `origin_primitive`, where that is not -1


PATH_NUMBERS = RayBatch.fields["waiting"].first + 1
"""Numbers of a lane, from the first on, that are its path."""


class PathNumbers(LaneRecord):
    """The same memory without names."""

    numbers = reals(PATH_NUMBERS)


class WaitingRay(LaneRecord):
    """A ray on a lane's stack."""

    origin = vector()
    direction = vector()
    throughput = vector()
    depth = integer()
    origin_primitive = integer()
    origin_instance = integer()


class SceneTable(Table):
    """What stages read. Indices are int32."""

    n_triangles = scalar()
    n_spheres = scalar()  # outside of groups, as the next two
    n_planes = scalar()
    n_analytic = scalar()
    n_instances = scalar()
    n_lights = scalar()
    light_choices = scalar()  # the lights of which one is chosen: all, or 1 where the integrator visits each
    n_unbounded_lights = scalar()
    light_parts = scalar()  # lights without a box, and one more for the hierarchy
    light_steps = scalar()  # of a bisection among the faces of a light
    lit_through = scalar()  # 1 where some surface may be lit from behind, else 0
    environment_light = scalar()  # index of the environment among the lights, 0 where there is none
    environment_width = scalar()
    environment_height = scalar()

    vertices = vectors(REAL)
    vertex_normals = vectors(REAL)
    triangles = rows(TriangleRow)
    triangle_primitives = array(np.int32)  # ids, in ascending order, as of every kind
    spheres = rows(SphereRow)
    sphere_primitives = array(np.int32)
    planes = rows(PlaneRow)
    plane_primitives = array(np.int32)
    analytic = rows(AnalyticRow)
    analytic_primitives = array(np.int32)
    analytic_bounds = array(np.float64)  # six a shape: lowest and highest coordinates
    instances = rows(InstanceRow)
    instance_bounds = array(np.float64)  # six each, as of analytic shapes
    primitives = rows(PrimitiveRow)
    materials = rows(MaterialRow)
    lights = rows(LightRow)
    light_faces = array(np.int32)  # primitive ids
    light_cdf = array(np.float64)  # by area, of each range of faces
    light_ranges = rows(RangeRow)
    light_cumulative = array(np.float64)  # by power; like the next one where the integrator chooses lights so
    light_inverse_pmf = array(REAL)  # 1 / the probability of each, in a hierarchy of each without a box
    # of a hierarchy of lights (`engines.kernels.flatten.light_samplers`)
    light_nodes = array(REAL)  # eight children each
    light_children = array(np.int32)  # eight a node: index of a node, or -1 - index of a light
    light_parents = array(np.int32)  # 8 times the node's parent plus its place there, -1 of the root
    light_places = array(np.int32)  # the same of each light, -1 of those in no node
    unbounded_lights = array(np.int32)
    # of cells with probabilities of all lights (`engines.light_cells`)
    light_grid = array(REAL)  # corner, 1 / size, number of cells along each axis
    light_rows = array(np.int32)  # six a cell
    light_bins = array(np.int32)  # four numbers each
    n_light_bins = scalar()  # a row
    # an image (`flatten.environment`)
    environment = vectors(REAL)  # texels, times the radiance
    environment_pdf = array(REAL)  # in (u, v)
    environment_rows = array(np.float64)  # cumulative shares
    environment_runs = array(np.float64)  # cumulative sums of densities, of each row
    environment_row_guide = array(np.int32)  # where searches in the cumulative tables begin
    environment_run_guide = array(np.uint16)
    environment_map = rows(EnvironmentRow)
    environment_radiance = vectors(REAL)  # one, of a constant environment

    bsdf_tables = array(REAL)  # of BSDFs that read some: how many numbers there are in all, then one behind the other

    # where some material in use has a program
    programs = array(np.int32)  # a material: its first node, -1 for none
    program_textures = array(np.int32)  # a material: some images that its program may read, -1 for none
    nodes = rows(NodeRow)
    leaves = rows(LeafRow)
    lookups = rows(LookupRow)
    textures = rows(TextureRow)
    texels = array(np.int64)  # addresses of the images, and of three numbers for each vertex or triangle of the scene
    vertex_uvs = rows(UVRow)
    # where some surface emits what a texture holds
    emission_textures = array(np.int32)  # a material: the texture, -1 for none
    light_primitives = array(np.int32)  # a light: id of the shape that it is, -1 of a mesh and of what is no shape

    # where some spot light or projector shows a texture
    light_frames = rows(LightFrameRow)  # of each light that is no shape

    # an SD-tree (`engines.sd_tree`), where paths are guided
    guide = rows(GuideRow)
    guide_root = scalar()
    guide_halves = array(np.int32)  # two a node over space
    guide_quarters = array(np.int32)  # four a node over directions
    guide_densities = array(REAL)  # four
    guide_shares = array(REAL)  # three

    # set by the renderer
    camera = rows(CameraRow)
    options = array(np.float64)  # eight of the integrator, then the sampler's
    sample_points = array(np.uint32)
    points_stride = scalar()
    first_sample = scalar()
    seed_key = scalar()
    wanted_draws = scalar()
    margins = rows(MarginRow)

    # where there are media
    media = rows(MediumRow)  # the last one is vacuum
    medium_sides = array(np.int32)  # two a primitive: the media inside and outside, -1 of a surface that is no boundary
    camera_medium = scalar()


ACCELERATOR = SceneTable.slots
"""The first of sixteen slots of the table that belong to the accelerator."""
SLOTS = ACCELERATOR + 16

ray_batch = lane_view(RayBatch)
path_numbers = lane_view(PathNumbers)
waiting_rays = lane_view(WaitingRay)
scene_table = table_view(SceneTable)


@inline
def copy_paths(to, source, lanes, scalar_type):
    """Copies the paths of the lanes of a word from the batch at address `source` to the same lanes of that at address `to`."""
    target, begun = path_numbers(to, scalar_type), path_numbers(source, scalar_type)
    copy_lanes(target, begun, target.numbers, lanes)


def batch_bytes(scalar_type: type, scratch: int) -> int:
    """Bytes of a ray batch with `scratch` numbers of scratch memory."""
    return RayBatch.bytes(scalar_type) + scratch * np.dtype(scalar_type).itemsize


def stack_bytes(scalar_type: type, capacity: int) -> int:
    """Bytes of the stacks of a batch's lanes, with room for `capacity` rays each."""
    return WaitingRay.bytes(scalar_type) * capacity


def aligned(size: int) -> NDArray[np.uint8]:
    """Zeroed memory that starts on a cache line."""
    memory = np.zeros(size + 64, np.uint8)
    start = -memory.ctypes.data % 64
    return memory[start : start + size]

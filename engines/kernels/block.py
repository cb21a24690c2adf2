"""A block: the state of sixteen lanes, field by field, in one flat buffer of the tracing precision.

Each field is sixteen numbers; integers are kept as their bits. Behind the fields lies scratch memory for intersectors.
Field names are indices; those of a vector name its x. The lanes' stacks, for shaders that follow two rays from one hit,
have memory of their own, laid out in the same way.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from engines.kernels.jit import LANES, get, inline, put
from engines.kernels.vector import Vec3

_order = iter(range(1000))


def _field(size: int = 1) -> int:
    first = next(_order)
    for _ in range(size - 1):
        next(_order)
    return first


# a path, as the camera begins it: what a lane takes over with its next sample
JOB_FIRST = ALIVE = _field()  # int: 1 while the lane has a sample in flight
SLOT = _field()  # int: where in the tile's buffer the radiance goes
PIXEL = _field()  # int: y * width + x
SAMPLE = _field()  # int: index of the sample
DIMENSION = _field()  # int: first dimension of the next draws
ORIGIN = _field(3)
DIRECTION = _field(3)
T = _field()  # in: t_max, not above 0 for a lane without a ray; out: distance of the hit
LEFT = _field()  # int: rank of the flat primitive the ray left, -1 for none
HELD = _field()  # int: rank of a hit that is shaded once more (next light), -1 for none
DEPTH = _field()  # int: segments so far, 1 for the camera ray
THROUGHPUT = _field(3)
RADIANCE = _field(3)
PDF = _field()  # of the last scattering, solid angle; inf after a specular one and from the camera
COS_PDF = _field()  # the cosine rule's own pdf for the last direction
LIGHT = _field()  # int: which light, for shaders that visit all
STACK = _field()  # int: branches waiting
JOB_LAST = STACK + 1

COLUMN = _field()
ROW = _field()
PIXEL_KEY = _field()  # int: the sampler's key of the pixel
DRAW = _field(8)  # the draws of this vertex, [0, 1)
RANK = _field()  # int: rank of the primitive hit, -1 for none
DONE = _field()  # int: 1 when the path has just ended

# the surface that was hit
MISS = _field()  # int
FRONT = _field()  # int: met from the side of the stored normal
POINT = _field(3)
NORMAL = _field(3)  # shading, towards the viewer
GEOMETRIC = _field(3)  # towards the viewer
U = _field()
V = _field()
OFFSET = _field()  # how far new rays start from the surface
KD = _field(3)
KS = _field(3)
KT = _field(3)
IOR = _field()
FRESNEL = _field()  # 1 or 0
EMISSION = _field(3)  # towards the viewer; a miss emits the environment
LIGHT_PDF = _field()  # with which the light strategy would have found this emission; 0 where it never does

# what the stages read of the world before they compute, so that loops over lanes are vector code on any machine
KIND = _field()  # int: of the primitive hit; of the light asked
CORNER = _field(9)  # of a triangle
CORNER_NORMAL = _field(9)
TWO_SIDED = _field()  # 1 or 0
LIGHT_ROW = _field()  # int: the light that a primitive belongs to, -1 for none
LIGHT_PLACE = _field(3)
LIGHT_SIZE = _field()
LIGHT_AREA = _field()
LIGHT_COLOUR = _field(3)
WIDE = _field(12)  # six float64 numbers: a sphere's centre and radius, or a plane's point and normal

# the light sample at the surface
TO_LIGHT = _field(3)
DISTANCE = _field()
INCIDENT = _field(3)  # radiance over pdf
SAMPLE_PDF = _field()  # solid angle, with the choice of the light; inf for delta lights

# the pending shadow ray
SHADOW_ORIGIN = _field(3)
SHADOW_T = _field()  # not above 0 for none
OCCLUDED = _field()  # int
DIRECT = _field(3)  # added if nothing is in the way

# the ray that follows later, from SHADOW_ORIGIN
BRANCH = _field()  # int
BRANCH_DIRECTION = _field(3)
BRANCH_THROUGHPUT = _field(3)

# scratch fields of intersectors: the ray's own frame
FRAME = _field(9)

SCRATCH_FIRST = next(_order)
STACK_FIELDS = 11  # of a waiting ray: origin 3, direction 3, throughput 3, depth, left


def block_bytes(real: type, scratch: int) -> int:
    """Bytes of a block with `scratch` numbers of scratch memory."""
    return (SCRATCH_FIRST * LANES + scratch) * np.dtype(real).itemsize


def stack_bytes(real: type, capacity: int) -> int:
    """Bytes of the stacks of a block's lanes, with room for `capacity` rays each."""
    return STACK_FIELDS * capacity * LANES * np.dtype(real).itemsize


def aligned(size: int) -> NDArray[np.uint8]:
    """Zeroed memory that starts on a cache line."""
    memory = np.zeros(size + 64, np.uint8)
    start = -memory.ctypes.data % 64
    return memory[start : start + size]


@inline
def get3(block, field, lane):
    return Vec3(get(block, field, lane), get(block, field + 1, lane), get(block, field + 2, lane))


@inline
def put3(block, field, lane, value):
    put(block, field, lane, value.x)
    put(block, field + 1, lane, value.y)
    put(block, field + 2, lane, value.z)

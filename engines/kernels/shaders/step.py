"""What a shader's step takes and gives. A shader is one function

    step(hit, material, light, draws, path, options, needs) -> Step

of one lane, called at every vertex of a path, without branches where it can (use `select`): then sixteen lanes run as
vector code. Vectors are `Vec3`; numbers have the tracing precision, so write constants as `const(0.5, hit.t)`.
"""

from __future__ import annotations

from typing import NamedTuple

from engines.kernels.jit import const, inline
from engines.kernels.vector import Vec3


class Hit(NamedTuple):
    """Where the ray ended. Normals face the viewer. On a miss only `direction`, `origin` and `miss` mean anything."""

    miss: bool
    t: float
    point: Vec3
    normal: Vec3
    """Shading normal, unit."""
    geometric: Vec3
    """Geometric normal, unit."""
    direction: Vec3
    """Of the ray, unit, towards the surface."""
    origin: Vec3
    front: bool
    """Whether the surface was met from the side of its own normal."""


class Material(NamedTuple):
    """kd, ks, kt as in scene files (0 on a miss). `emission` is what this side sends to the viewer; a miss emits the
    environment. `light_pdf`: solid-angle pdf with which the light sample would have found this emission, 0 where never."""

    kd: Vec3
    ks: Vec3
    kt: Vec3
    ior: float
    """Index behind the surface over index before it, for the side the ray is on."""
    fresnel: bool
    emission: Vec3
    light_pdf: float


class Light(NamedTuple):
    """One sample of a light: `wi` unit, `radiance` over pdf (0 for none), `pdf` solid angle, inf for a delta light."""

    wi: Vec3
    distance: float
    radiance: Vec3
    pdf: float


class Draws(NamedTuple):
    """Random numbers in [0, 1) of this vertex that the light sample has not used."""

    lobe: float
    u0: float
    u1: float
    roulette: float


class Path(NamedTuple):
    throughput: Vec3
    depth: int
    """Segments so far: 1 for the camera ray."""
    pdf: float
    """Solid-angle pdf of the last direction; inf after a mirror or glass, and from the camera."""


class Step(NamedTuple):
    """What happens at the vertex: `radiance` is added at once, `direct` if nothing stands between the point and the light
    sample; then the path goes on along `direction`, if `alive`. Both include the path's throughput."""

    radiance: Vec3
    direct: Vec3
    alive: bool
    direction: Vec3
    through: bool
    """The next ray leaves on the far side of the surface."""
    throughput: Vec3
    pdf: float
    branch: bool
    """A second ray follows this one later: whitted's refraction."""
    branch_direction: Vec3
    branch_throughput: Vec3


@inline
def finish(like, radiance, direct):
    """A step that ends the path."""
    zero = const(0.0, like)
    none = Vec3(zero, zero, zero)
    return Step(radiance, direct, False, none, False, none, zero, False, none, none)

"""What an integrator's step takes and gives. An integrator is one function

    step(si, light, bsdf, draws, path, options) -> ScatterResult

of one lane, called at every vertex of a path, without branches where it can (use `select`): then sixteen lanes run as
vector code. Vectors are `Vec3`; numbers have the tracing precision, which literals take from what they meet. `light`
is a `LightSample`, `bsdf` a `Scattering`, `options` eight numbers.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from engines.kernels.compile.jit import inline
from engines.kernels.compile.vec3 import BLACK, ZERO, Vec3

MAX_DEPTH = 0
"""The place among the options of a built-in integrator of the depth at which its paths end, if it has one."""


class SurfaceInteraction(NamedTuple):
    """Where the ray ended. Normals face the viewer. On a miss only `direction`, `origin`, `emission`, `light_pdf` and
    `miss` mean anything."""

    miss: bool
    t: float
    point: Vec3
    normal: Vec3
    """Shading normal, unit."""
    geometric_normal: Vec3
    """Unit."""
    direction: Vec3
    """Of the ray, unit, towards the surface: -wo."""
    origin: Vec3
    front: bool
    """Whether the surface was met from the side of its own normal."""
    tangent: Vec3
    """Derivative of the point by the shape's first coordinate, where some material is anisotropic."""
    emission: Vec3
    """What this side sends to the viewer; a miss has the environment's radiance."""
    light_pdf: float
    """Solid-angle pdf with which the light sample would have found this emission, 0 where never."""
    tables: Any
    """Numbers by index, of the models that have tables."""


class Draws(NamedTuple):
    """Random numbers in [0, 1) of this vertex that the light sample has not used."""

    lobe: float
    u0: float
    u1: float
    roulette: float


class Path(NamedTuple):
    throughput: Vec3
    depth: int
    """Segments so far: 1 for the camera ray. A step gets it in the tracing precision."""
    pdf: float
    """Solid-angle pdf of the last direction; inf after a specular event, from the camera, and along a second ray."""
    eta_scale: float
    """The product of `Scattering.eta_scale` along the path; 1 for an integrator without `roulette`."""


class ScatterResult(NamedTuple):
    """What happens at the vertex: `radiance` is added at once, `direct` if nothing stands between the point and the
    light sample; then the path goes on along `direction`, if `alive`. Both include the path's throughput."""

    radiance: Vec3
    direct: Vec3
    alive: bool
    direction: Vec3
    transmitted: bool
    """The next ray leaves on the far side of the surface."""
    throughput: Vec3
    pdf: float
    branch: bool
    """A second ray follows this one later: whitted's reflection, where there is a refraction too. It counts as specular: its
    `Path.pdf` is infinite."""
    branch_direction: Vec3
    branch_throughput: Vec3


class Uses(NamedTuple):
    """Which parts of `Scattering` a step reads; the others are not computed."""

    value: bool = False
    """`value` and `pdf`."""
    sample: bool = False
    specular: bool = False
    """`reflection` and `transmission`."""
    albedos: bool = False
    """`diffuse` and `albedo`."""


class Integrator(NamedTuple):
    """A step, and its properties that stages depend on."""

    step: Any
    uses: Uses
    every_light: bool = False
    """The step is called once for each light."""
    branches: bool = False
    """Two rays may follow from one hit."""
    branches_at_specular: bool = False
    """The same, in a scene with both specular reflection and transmission."""
    lit: bool = True
    """It samples lights."""
    roulette: bool = False
    """Its paths follow `Scattering.sample` alone, and play Russian roulette, for which `Path.eta_scale` is kept."""
    shadows: bool = True
    crossing_step: Any = None
    """`step` where rays may cross surfaces that are no vertices: a last argument says whether this sample does."""
    medium_step: Any = None
    """The same where media scatter light: one more argument says whether this vertex lies in one."""


@inline
def finish(like, radiance, direct):
    """A result that ends the path. `like` is not read: shaders give it since it once said the type of the zeros."""
    return ScatterResult(radiance, direct, False, BLACK, False, BLACK, ZERO, False, BLACK, BLACK)

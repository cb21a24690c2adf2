"""What is in a scene: frozen dataclasses that know neither YAML nor any engine.

Right-handed, metres, linear RGB. A `Triple` is three floats. Shapes and lights name materials by index into
`Scene.materials`. The arrays are read-only float64/int32. Everything here has been checked by the loader
(`engines.scene.load`): engines may rely on finite numbers, unit plane normals and valid indices.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.errors import UnknownName

Triple = tuple[float, float, float]
BLACK: Triple = (0.0, 0.0, 0.0)
WHITE: Triple = (1.0, 1.0, 1.0)
ENERGY_TOLERANCE = 1e-9
"""By how much kd + ks + kt may pass 1, so that sums such as 0.6 + 0.3 + 0.1 are not refused for rounding."""


@dataclass(frozen=True, slots=True)
class Conductor:
    """A metal: reflection alone, weighted by the unpolarised Fresnel reflectance of the complex index `eta` + i `k`.

    `alpha` are the GGX (Trowbridge-Reitz) roughnesses along the two tangents of the surface: both 0 for a smooth surface,
    a mirror, else both in [1e-4, 1]. `reflectance` in [0, 1] scales the reflection. Both sides of the surface reflect.

    The first tangent is dp/du, made perpendicular to the shading normal: of a sphere along phi, counter-clockwise about +z;
    of a disk away from its center; of a triangle from its first corner to its second; of a plane t1 of the local frame of its
    normal (docs/transport.md). The second is normal x first.
    """

    eta: Triple
    k: Triple
    alpha: tuple[float, float] = (0.0, 0.0)
    reflectance: Triple = WHITE

    @property
    def albedo(self) -> Triple:
        """The share of light that a smooth surface reflects at normal incidence; the shader `albedo` shows it."""
        r, g, b = (
            scale * ((eta - 1.0) ** 2 + k**2) / ((eta + 1.0) ** 2 + k**2)
            for eta, k, scale in zip(self.eta, self.k, self.reflectance, strict=True)
        )
        return r, g, b


@dataclass(frozen=True, slots=True)
class CustomBSDF:
    """A BSDF plugin (see `engines.plugin.BSDF`). `options` has a number, or three, for every option of the plugin, in
    the plugin's order: those that are not given have their defaults. Raises `UnknownName`."""

    plugin: Any
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "options", _all_options("BSDF", self.plugin, self.options))


def _all_options(what: str, plugin: Any, given: Mapping[str, Any]) -> dict[str, Any]:
    known = plugin.options
    for name in given:
        if name not in known:
            raise UnknownName(f"option of the {what} {plugin.name!r}", name, known)
    values = {name: given.get(name, default) for name, default in known.items()}
    return {name: tuple(map(float, x)) if np.ndim(x) else float(x) for name, x in values.items()}


Bsdf = Conductor | CustomBSDF


@dataclass(frozen=True, slots=True)
class Material:
    """Surface response: kd Lambertian albedo (f = kd/pi), ks mirror, kt refraction, emission radiance (W/sr/m2).

    With `fresnel` the mirror is weighted by F and the refraction by 1 - F (exact dielectric, unpolarised). Emission
    leaves the front side, or both when `two_sided`. `ior` is relative to the outside of the shape. Where `bsdf` is given
    it replaces kd, ks, kt, ior and fresnel, which then have their defaults.
    """

    name: str
    kd: Triple = BLACK
    ks: Triple = BLACK
    kt: Triple = BLACK
    ior: float = 1.0
    fresnel: bool = False
    emission: Triple = BLACK
    two_sided: bool = False
    bsdf: Bsdf | None = None

    @property
    def energy(self) -> Triple:
        """The share of light that kd, ks and kt return at most, a channel."""
        r, g, b = (
            d + (max(s, t) if self.fresnel else s + t) for d, s, t in zip(self.kd, self.ks, self.kt, strict=True)
        )
        return r, g, b

    @property
    def emits(self) -> bool:
        """Whether any channel of `emission` is above zero."""
        return max(self.emission) > 0.0


@dataclass(frozen=True, slots=True)
class Plane:
    """Infinite; `normal` is unit and points to the front."""

    point: Triple
    normal: Triple
    material: int


@dataclass(frozen=True, slots=True)
class Sphere:
    """Outside is the front: the normal points away from `center`; `radius` is above zero."""

    center: Triple
    radius: float
    material: int


@dataclass(frozen=True, slots=True)
class Disk:
    """Flat and round; `normal` is unit and points to the front; `radius` is above zero. One that emits is sampled."""

    center: Triple
    normal: Triple
    radius: float
    material: int


@dataclass(frozen=True, slots=True)
class Triangle:
    """Counter-clockwise seen from the front: the normal is (b - a) x (c - a)."""

    a: Triple
    b: Triple
    c: Triple
    material: int


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Indexed triangles: `vertices` (n, 3) float64, `faces` (m, 3) int32, `materials` (m,) int32, one per face.

    `normals` (n, 3) unit vertex normals, or None where the mesh is flat-shaded. Faces of zero area may occur: they are
    never hit and never sampled.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    materials: NDArray[np.int32]
    normals: NDArray[np.float64] | None = None
    name: str = "mesh"


@dataclass(frozen=True, slots=True, eq=False)
class SphereSet:
    """Many spheres that make one shape (a sphereflake): `centers` (n, 3), `radii` (n,), one material."""

    centers: NDArray[np.float64]
    radii: NDArray[np.float64]
    material: int
    name: str = "spheres"


Shape = Plane | Sphere | Disk | Triangle | Mesh | SphereSet


@dataclass(frozen=True, slots=True)
class PointLight:
    """`intensity` in W/sr; `falloff` off is for the historical scenes only: the light then acts as at distance 1."""

    position: Triple
    intensity: Triple
    falloff: bool = True


@dataclass(frozen=True, slots=True)
class DirectionalLight:
    """`direction` of travel, unit; `irradiance` in W/m2 on a surface that faces it."""

    direction: Triple
    irradiance: Triple


@dataclass(frozen=True, slots=True)
class SpotLight:
    """A point light that shines into a cone about the unit vector `direction`.

    `intensity` in W/sr holds within `beam_width` degrees of `direction` and falls linearly with the angle theta to 0 at
    `cutoff` degrees: times (cutoff - theta) / (cutoff - beam_width). Half angles; 0 < `beam_width` <= `cutoff` < 180.
    """

    position: Triple
    direction: Triple
    intensity: Triple
    cutoff: float
    beam_width: float


@dataclass(frozen=True, slots=True, eq=False)
class EnvironmentLight:
    """Radiance from infinity: constant `radiance`, or `image` (h, w, 3) latitude-longitude times `radiance`.

    Image convention: +y up, row 0 at the top (theta = 0); a direction d has v = acos(d.y)/pi and
    u = atan2(d.x, -d.z)/(2 pi) modulo 1, so -z is at the left edge and +z in the middle. Looked up bilinearly.
    """

    radiance: Triple
    image: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True)
class CustomLight:
    """A light plugin (see `engines.plugin.Light`); `options` as in `CustomBSDF`."""

    plugin: Any
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "options", _all_options("light", self.plugin, self.options))


Light = PointLight | DirectionalLight | SpotLight | EnvironmentLight | CustomLight


@dataclass(frozen=True, slots=True)
class Perspective:
    """Pinhole: `fov` in degrees is the full angle along `fov_axis` ("x" or "y")."""

    eye: Triple
    target: Triple
    up: Triple
    fov: float
    fov_axis: str
    resolution: tuple[int, int]


@dataclass(frozen=True, slots=True)
class PerspectiveArctan:
    """MobileRT's camera: a ray's slope is the arctangent of an angle in proportion to its place on the image.

    A ray at the share s of the half image, from -1 to 1, has the slope A(s fov/2), `fov` (degrees) along `fov_axis`;
    along the other axis the angle is in proportion to the sides. A is MobileRT's polynomial for the arctangent, right
    to 0.0015: `A(x) = x (pi/4 + (1 - |x|)(0.2447 + 0.0663 |x|))` up to x = 1, and `pi/2 - A(1/x)` beyond. It shows less
    than a pinhole of that angle (40.9 degrees for 45), and bends lines that miss the middle.
    """

    eye: Triple
    target: Triple
    up: Triple
    fov: float
    fov_axis: str
    resolution: tuple[int, int]


@dataclass(frozen=True, slots=True)
class Orthographic:
    """Parallel rays along target - eye from a window centred on `eye`, `height` metres high in full."""

    eye: Triple
    target: Triple
    up: Triple
    height: float
    resolution: tuple[int, int]


@dataclass(frozen=True, slots=True)
class CustomCamera:
    """A camera plugin (see `engines.plugin.Camera`); `options` as in `CustomBSDF`, or any where the plugin lists none."""

    plugin: Any
    options: Mapping[str, Any]
    resolution: tuple[int, int]

    def __post_init__(self) -> None:
        if getattr(self.plugin, "options", None) is not None:
            object.__setattr__(self, "options", _all_options("camera", self.plugin, self.options))


Camera = Perspective | PerspectiveArctan | Orthographic | CustomCamera


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """All that is rendered. `content_hash` identifies what the pixels depend on (not names, comments or key order)."""

    name: str
    camera: Camera
    materials: tuple[Material, ...]
    shapes: tuple[Shape, ...]
    lights: tuple[Light, ...]
    content_hash: str
    source: str = ""
    warnings: tuple[str, ...] = field(default=())

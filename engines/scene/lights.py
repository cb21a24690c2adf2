"""Lights: what engines get of each, and beside it the keys of a scene file. A light is one entry of `LIGHTS`.

Area lights are not among them: they are shapes whose material emits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.errors import SceneError
from engines.scene.cameras import LENS, PARALLEL
from engines.scene.context import SceneReader
from engines.scene.formats.texture import FLOATS, read_texels
from engines.scene.frames import LARGEST
from engines.scene.geometry import read_only
from engines.scene.plugins import PluginKind, all_options
from engines.scene.textures import IMAGE_FILE, PROJECTED, UVTexture, image_array, sides
from engines.scene.triple import Triple, triple
from engines.schema import fields
from engines.schema.keys import Given, Key, Record, Variants
from engines.schema.kinds import ANGLE, DIRECTION, POINT, Kind, array_of, color, one_of, within
from engines.schema.yaml_file import Located

__all__ = ["CustomLight", "DirectionalLight", "EnvironmentLight", "Light", "PointLight", "ProjectorLight", "SpotLight"]

_UP: Triple = (0.0, 1.0, 0.0)
_POSITION = Key(POINT, "Position of the light.", unit="metres")
_AXIS = {
    "target": Key(POINT, "A point on the axis.", None, unit="metres"),
    "direction": Key(DIRECTION, "Direction of the axis, of any length.", None),
}
_EITHER_AXIS = (("target",), ("direction",))


@dataclass(frozen=True, slots=True)
class PointLight:
    """`intensity` in W/sr; `falloff` off is for the historical scenes only: the light then acts as at distance 1."""

    position: Triple
    intensity: Triple
    falloff: bool = True


def _point(given: Given, context: SceneReader) -> PointLight:
    return PointLight(given["position"], given["intensity"], given["falloff"] != "none")


_FALLOFF = one_of(("inverse_square", "none"), "falloff")
_POINT = Record(
    "A point light that is equal in all directions.",
    {
        "position": _POSITION,
        "intensity": Key(color(), "Radiant intensity.", unit="W/sr"),
        "falloff": Key(_FALLOFF, "Dependence on distance; with none it is everywhere that at 1 m.", "inverse_square"),
    },
    _point,
)


@dataclass(frozen=True, slots=True)
class SpotLight:
    """A point light that shines into a cone about the unit vector `direction`.

    `intensity` in W/sr holds within `beam_width` degrees of `direction` and falls linearly with the angle theta to 0 at
    `cutoff` degrees: times (cutoff - theta) / (cutoff - beam_width). Half angles; 0 < `beam_width` <= `cutoff` < 180.

    A `texture` is a factor of the intensity: it fills the square around the cone, with `up` (unit) upwards, as a camera in the
    light's place would see it. `cutoff` is below 90 then.
    """

    position: Triple
    direction: Triple
    intensity: Triple
    cutoff: float
    beam_width: float
    texture: UVTexture | None = None
    up: Triple = _UP

    def __post_init__(self) -> None:
        if self.texture is not None and not self.cutoff < 90.0:
            raise SceneError(f"cutoff of a spot light with a texture: {self.cutoff:g}: must be below 90 degrees")

    @property
    def half_extents(self) -> tuple[float, float]:
        """Half the width and height of the frame of the texture, at a distance of 1 along the axis."""
        half = math.tan(math.radians(self.cutoff))
        return half, half


def _direction(given: Given) -> Triple:
    """Of the axis, unit."""
    return given["direction"] or fields.towards(given.at("target"), given["position"], "position")


def _framed_direction(given: Given) -> Triple:
    """Of the axis of a light with `up`, unit."""
    direction = _direction(given)
    if np.linalg.norm(np.cross(direction, given["up"])) < PARALLEL:
        node = given.at("up") if given.has("up") else given.node
        raise node.refuse("up must not be parallel to the axis of the light")
    return direction


def _spot(given: Given, context: SceneReader) -> SpotLight:
    cutoff, beam_width, textured = given["cutoff"], given["beam_width"], given["texture"] is not None
    direction = _framed_direction(given) if textured else _direction(given)
    if beam_width is None:
        beam_width = 0.75 * cutoff
    elif beam_width > cutoff:
        raise given.at("beam_width").refuse(f"must not exceed cutoff, which is {cutoff:g}")
    if textured and cutoff >= 90.0:
        raise given.at("cutoff").refuse("must be below 90 with a texture")
    if given.has("up") and not textured:
        raise given.node.refuse_key("up", "belongs to a texture: a cone is the same all around")
    values = given["intensity"], cutoff, beam_width, given["texture"], given["up"]
    return SpotLight(given["position"], direction, *values)


_SPOT = Record(
    "A point light that is limited to a cone about an axis.",
    {
        "position": _POSITION,
        **_AXIS,
        "intensity": Key(color(), "Radiant intensity within beam_width of the axis.", unit="W/sr"),
        "cutoff": Key(ANGLE, "Angle from the axis beyond which there is no light.", 20, unit="degrees"),
        "beam_width": Key(
            ANGLE,
            "Angle from the axis beyond which intensity falls linearly, to 0 at cutoff; by default 3/4 of that.",
            None,
            unit="degrees",
        ),
        "texture": Key(
            PROJECTED, "Name of an image or checkerboard, a factor of the intensity: it fills the square around the cone.", None
        ),
        "up": Key(DIRECTION, "Direction that is up in the texture.", [*_UP]),
    },
    _spot,
    either=_EITHER_AXIS,
)


@dataclass(frozen=True, slots=True)
class ProjectorLight:
    """A point light that projects `texture` along the unit vector `direction`, with `up` (unit) upwards. A camera in its place,
    with this `fov` (degrees) along `fov_axis` ("x" or "y"), would see the texture fill the image. No light leaves elsewhere.

    `irradiance` in W/m2, times the texture, is that of a plane across the axis at a distance of 1: the radiant intensity at an
    angle theta from the axis is irradiance * texture / cos(theta)^3.
    """

    position: Triple
    direction: Triple
    up: Triple
    irradiance: Triple
    texture: UVTexture
    fov: float
    fov_axis: str

    @property
    def half_extents(self) -> tuple[float, float]:
        """Half the width and height of the image at a distance of 1 along the axis. A checkerboard is square."""
        height, width = sides(self.texture)
        half = math.tan(math.radians(self.fov) / 2.0)
        return (half, half * height / width) if self.fov_axis == "x" else (half * width / height, half)


def _projector(given: Given, context: SceneReader) -> ProjectorLight:
    values = (given[name] for name in ("up", "irradiance", "texture", "fov", "fov_axis"))
    return ProjectorLight(given["position"], _framed_direction(given), *values)


_PROJECTOR = Record(
    "A point light that projects an image.",
    {
        "position": _POSITION,
        **_AXIS,
        "up": Key(DIRECTION, "Direction that is up in the image.", [*_UP]),
        "irradiance": Key(
            color(), "Irradiance of a plane across the axis at a distance of 1 m, where the texture is 1.", 1, unit="W/m²"
        ),
        "texture": Key(PROJECTED, "Name of the image, or of a checkerboard, which is square."),
        **LENS,
    },
    _projector,
    either=_EITHER_AXIS,
)


@dataclass(frozen=True, slots=True)
class DirectionalLight:
    """`direction` of travel, unit; `irradiance` in W/m2 on a surface that faces it."""

    direction: Triple
    irradiance: Triple


_DIRECTIONAL = Record(
    "Parallel light from infinity, as from the sun.",
    {
        "direction": Key(DIRECTION, "Direction in which light travels, of any length."),
        "irradiance": Key(color(), "Irradiance of a surface that faces the light.", unit="W/m²"),
    },
    lambda given, context: DirectionalLight(**given.values),
)


@dataclass(frozen=True, slots=True, eq=False)
class EnvironmentLight:
    """Radiance from infinity: constant `radiance`, or `image` (h, w, 3) latitude-longitude times `radiance`.

    Image convention: +y up, row 0 at the top (theta = 0); a direction d has v = acos(d.y)/pi and
    u = atan2(d.x, -d.z)/(2 pi) modulo 1, so -z is at the left edge and +z in the middle. Looked up bilinearly. `rotation`
    are the rows of an orthogonal matrix that takes such directions to the scene's. The rows of an image are cells of equal
    height ("cells"), or their first and last lie on the poles ("poles", as in Mitsuba).
    """

    radiance: Triple
    image: NDArray[np.float64] | None = None
    rotation: tuple[Triple, Triple, Triple] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    rows: str = "cells"


def _environment(given: Given, context: SceneReader) -> EnvironmentLight:
    if not (given.has("radiance") or given.has("image")):
        raise given.node.refuse("needs radiance, image, or both")
    for key in ("rotation", "rows"):
        if given.has(key) and not given.has("image"):
            raise given.node.refuse_key(key, "belongs to an image: a constant environment is the same all around")
    r, g, b = (given["scale"] * channel for channel in given["radiance"])
    if not math.isfinite(max(r, g, b)):
        raise given.at("scale").refuse("must leave radiance finite")
    image = _image(given, context) if given.has("image") else None
    return EnvironmentLight((r, g, b), image, given["rotation"], given["rows"])


def _image(given: Given, context: SceneReader) -> Any:
    """(h, w, 3) of a file or an array, as a texture's."""
    from engines.image import read_image

    node = given.at("image")
    if isinstance(node.value, np.ndarray):
        image = image_array(node, 3).astype(np.float64)
    else:
        file = context.place.find(node, given["image"])
        try:
            image = read_texels(file).astype(np.float64) if file.suffix.lower() in FLOATS else read_image(file)
        except SceneError as problem:
            raise SceneError(f"{node.where}: {problem}") from problem
    if not np.isfinite([image.min(), image.max()]).all():
        raise node.refuse("holds radiance that is infinite or not a number")
    image, negative = without_negative(np.broadcast_to(image, (*image.shape[:2], 3)))
    if negative:
        context.warnings.append(f"{node.where}: {negative}")
    return image


def without_negative(image: NDArray[np.float64]) -> tuple[NDArray[np.float64], str]:
    """(h, w, 3) radiance, read-only, in which negative texels are 0, and the note that says so, or "". Filters that sharpen
    leave such texels in maps. Images without any are large and not copied."""
    note, lowest = "", image.min()
    if lowest < 0.0:
        count = int((image < 0.0).any(axis=2).sum())
        note, image = (f"{count} texels with negative radiance, down to {lowest:g}, are taken as 0", np.maximum(image, 0.0))
    return read_only(np.ascontiguousarray(image)), note


ORTHOGONAL = 1e-5
"""By how much the scalar products of the rows of a rotation may miss 0 and 1."""


def _rotation(node: Located) -> tuple[Triple, Triple, Triple]:
    """Three rows."""
    rows = np.array([fields.triple(row) for row in fields.several(node, 3, "must be three rows of three numbers")])
    if not (np.abs(rows) < 2.0).all() or np.abs(rows @ rows.T - np.eye(3)).max() > ORTHOGONAL:
        raise node.refuse("must be a rotation: rows of length 1, at right angles")
    a, b, c = map(triple, rows)
    return a, b, c


_ENVIRONMENT = Record(
    "Light from infinity, all around. At least one of radiance and image is required.",
    {
        "radiance": Key(color(), "Radiance from all directions; with an image, a factor.", 1, unit="W/(sr m²)"),
        "image": Key(
            IMAGE_FILE, "Latitude-longitude image, +y up: .exr, .hdr, .pfm or 8-bit, relative to the scene's folder.", None
        ),
        "scale": Key(within(0, LARGEST), "Factor of the light.", 1),
        "rotation": Key(
            Kind(_rotation, array_of(POINT.json, 3)),
            "Rows of the rotation of an image, which may mirror: it takes its directions to the scene's.",
            [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
        ),
        "rows": Key(
            one_of(("cells", "poles"), "kind of rows"),
            "Whether rows of an image are cells of equal height, or the first and last lie on the poles, as in Mitsuba.",
            "cells",
        ),
    },
    _environment,
)


@dataclass(frozen=True, slots=True)
class CustomLight:
    """A light plugin (see `engines.plugin.Light`); `options` as in `CustomBSDF`."""

    plugin: Any
    options: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "options", all_options("light", self.plugin, self.options))


Light = PointLight | DirectionalLight | SpotLight | ProjectorLight | EnvironmentLight | CustomLight
LIGHTS = Variants(
    "light",
    {
        "point": _POINT,
        "spot": _SPOT,
        "projector": _PROJECTOR,
        "directional": _DIRECTIONAL,
        "environment": _ENVIRONMENT,
        "plugin": PluginKind("light", "Your own light; loaded only with --allow-imports.", CustomLight),
    },
)

"""Cameras: what engines get, and the keys of a scene file. One is an entry of `CAMERAS`, or a plugin `module:attribute`."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from engines.scene.media import NAMED_MEDIUM
from engines.scene.plugins import all_options, load_plugin, read_options
from engines.scene.triple import Triple
from engines.schema import fields
from engines.schema.keys import Given, Key, Record, Tagged
from engines.schema.kinds import ANGLE, BOOLEAN, POINT, POSITIVE, Kind, array_of, integer, one_of, within
from engines.schema.yaml_file import Located

__all__ = ["Camera", "CustomCamera", "Orthographic", "Perspective", "PerspectiveArctan", "ThinLens"]

DEFAULT_RESOLUTION = (256, 256)
LARGEST_SIDE = 65_536
PARALLEL = 1e-9
"""Sine of the angle between `up` and the view below which they count as parallel."""
MOST_SHIFT = 65_536.0
"""Image widths by which the axis of view may miss the middle of the image: it may be one pixel of the largest film."""
BYTES_PER_PIXEL = 200
"""Sums, squares, halves and counts of a film, and a mean and a bitmap made from it."""


@dataclass(frozen=True, slots=True)
class Perspective:
    """Pinhole: `fov` in degrees is the full angle along `fov_axis` ("x" or "y").

    Of any camera but MobileRT's and plugins: the axis of view meets the film at 1/2 + `principal_point`, in shares of its
    width and height, y downwards; with `mirror` left and right are exchanged; nothing is seen that lies outside `clip`, two
    distances along the axis.

    `medium` is the place in `Scene.media` of the medium in which rays start, None for vacuum; plugins have none.
    """

    eye: Triple
    target: Triple
    up: Triple
    fov: float
    fov_axis: str
    resolution: tuple[int, int]
    principal_point: tuple[float, float] = (0.0, 0.0)
    mirror: bool = False
    clip: tuple[float, float] = (0.0, math.inf)
    medium: int | None = None


@dataclass(frozen=True, slots=True)
class ThinLens:
    """A perspective camera with a round aperture: points at `focus_distance` along the axis of view are sharp."""

    eye: Triple
    target: Triple
    up: Triple
    fov: float
    fov_axis: str
    resolution: tuple[int, int]
    aperture_radius: float
    focus_distance: float
    principal_point: tuple[float, float] = (0.0, 0.0)
    mirror: bool = False
    clip: tuple[float, float] = (0.0, math.inf)
    medium: int | None = None


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
    medium: int | None = None


@dataclass(frozen=True, slots=True)
class Orthographic:
    """Parallel rays along target - eye from a window centred on `eye`, `width` x `height` metres in full. One of them may be
    None: pixels are square then, whatever the shape of the image."""

    eye: Triple
    target: Triple
    up: Triple
    height: float | None
    resolution: tuple[int, int]
    principal_point: tuple[float, float] = (0.0, 0.0)
    mirror: bool = False
    clip: tuple[float, float] = (0.0, math.inf)
    width: float | None = None
    medium: int | None = None

    def window(self, aspect: float | None = None) -> tuple[float, float]:
        """Width and height in metres, for an image that is `aspect` times as wide as high: by default that of `resolution`."""
        aspect = self.resolution[0] / self.resolution[1] if aspect is None else aspect
        if self.width is None:
            assert self.height is not None
            return aspect * self.height, self.height
        return self.width, self.width / aspect if self.height is None else self.height

    def scaled(self, factor: float) -> Orthographic:
        """The camera with a window that is `factor` times as large."""
        width, height = (None if side is None else side * factor for side in (self.width, self.height))
        return replace(self, width=width, height=height)


@dataclass(frozen=True, slots=True)
class CustomCamera:
    """A camera plugin (see `engines.plugin.Camera`); `options` as in `CustomBSDF`, or any where the plugin lists none."""

    plugin: Any
    options: Mapping[str, Any]
    resolution: tuple[int, int]

    def __post_init__(self) -> None:
        if getattr(self.plugin, "options", None) is not None:
            object.__setattr__(self, "options", all_options("camera", self.plugin, self.options))


Camera = Perspective | ThinLens | PerspectiveArctan | Orthographic | CustomCamera


def _resolution(node: Located) -> tuple[int, int]:
    sides = fields.several(node, 2, "must be [width, height] in pixels")
    width, height = (fields.integer(side, 1, LARGEST_SIDE) for side in sides)
    fields.refuse_above_memory(node, float(width) * height * BYTES_PER_PIXEL, f"an image of {width} x {height} pixels")
    return width, height


def _check_frame(given: Given) -> None:
    view = fields.towards(given.at("target"), given["eye"], "eye")
    up = fields.direction(given.at("up")) if given.has("up") else given["up"]
    if np.linalg.norm(np.cross(view, up)) < PARALLEL:
        raise given.at("up" if given.has("up") else "target").refuse("up must not be parallel to the direction of view")


def _camera(kind: Callable[..., Camera], meaning: str, **keys: Key) -> Record:
    def make(given: Given, context: Any) -> Camera:
        _check_frame(given)
        if kind is Orthographic and not (given.has("height") or given.has("width")):
            raise given.node.refuse("needs height, width, or both")
        needed = {"height": None} if kind is Orthographic else {}
        return kind(**needed | {key: value for key, value in given.values.items() if value is not None})

    return Record(meaning, {**_FRAME, **keys}, make)


_RESOLUTION = Key(
    Kind(_resolution, array_of(integer(1, LARGEST_SIDE).json, 2)),
    "Width and height of the image.",
    DEFAULT_RESOLUTION,
    unit="pixels",
)
_FRAME = {
    "eye": Key(POINT, "Position of the camera.", unit="metres"),
    "target": Key(POINT, "Point in the middle of the image.", unit="metres"),
    "up": Key(POINT, "Direction that is up in the image.", [0, 1, 0]),
    "resolution": _RESOLUTION,
    "medium": Key(NAMED_MEDIUM, "Name of the medium in which the camera is.", None),
}


def _clip(node: Located) -> tuple[float, float]:
    """[near, far] with 0 <= near < far; far may be infinite."""
    first, second = fields.several(node, 2, "must be [near, far]")
    near, far = fields.number(first), math.inf if second.value == math.inf else fields.number(second)
    if not 0.0 <= near < far:
        raise node.refuse("must be two distances with 0 <= near < far")
    return near, far


def _shift(node: Located) -> tuple[float, float]:
    x, y = (fields.within(item, -MOST_SHIFT, MOST_SHIFT) for item in fields.several(node, 2, "must be two numbers"))
    return x, y


_FILM = {
    "principal_point": Key(
        Kind(_shift, array_of(within(-MOST_SHIFT, MOST_SHIFT).json, 2)),
        "Where the axis of view meets the image, from its middle, in shares of its width (to the right) and height (down).",
        [0, 0],
    ),
    "mirror": Key(BOOLEAN, "Whether left and right are exchanged.", False),
    "clip": Key(
        Kind(_clip, array_of({"type": "number", "minimum": 0}, 2)),
        "Distances along the axis of view between which things are seen, by default all; the second may be .inf.",
        None,
        unit="metres",
    ),
}
LENS = {
    "fov": Key(ANGLE, "Full angle of view.", 40, unit="degrees"),
    "fov_axis": Key(one_of(("x", "y"), "fov_axis"), "Axis of the image along which fov is measured.", "y"),
}
CAMERAS = {
    "perspective": _camera(Perspective, "A pinhole camera.", **LENS, **_FILM),
    "thin_lens": _camera(
        ThinLens,
        "A perspective camera with a round aperture, and so with depth of field.",
        **LENS,
        aperture_radius=Key(POSITIVE, "Radius of the aperture.", unit="metres"),
        focus_distance=Key(POSITIVE, "Distance along the axis of view at which things are sharp.", unit="metres"),
        **_FILM,
    ),
    "perspective_arctan": _camera(
        PerspectiveArctan, "MobileRT's camera: slopes are arctangents of angles, and straight lines bend a little.", **LENS
    ),
    "orthographic": _camera(
        Orthographic,
        "Parallel rays from a window. At least one of height and width is required: with one, pixels are square.",
        height=Key(POSITIVE, "Height of the window.", None, unit="metres"),
        **_FILM,
        width=Key(POSITIVE, "Width of the window.", None, unit="metres"),
    ),
}


def _custom(node: Located, named: Located, context: Any) -> CustomCamera:
    plugin = load_plugin(named, "camera", context.allow_imports, context.place.folder, CAMERAS)
    if getattr(plugin, "options", None) is None:
        options = {key: child.plain() for key, child in node.value.items() if key not in ("type", "resolution")}
    else:
        options = read_options(node, plugin, ("type", "resolution"))
    written = node.value.get("resolution")
    return CustomCamera(plugin, options, DEFAULT_RESOLUTION if written is None else _RESOLUTION.kind.read(written))


CAMERA = Tagged(
    "camera",
    "type",
    CAMERAS,
    _custom,
    {
        "type": "object",
        "required": ["type"],
        "properties": {"type": {"type": "string", "pattern": ":"}},
        "description": "A plugin, module:attribute, with its own options; loaded only with --allow-imports.",
    },
)

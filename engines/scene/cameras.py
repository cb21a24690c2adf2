"""Cameras of a scene file: those of `KINDS`, or a plugin named `module:attribute`."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable
from typing import Any

from engines.errors import suggestion
from engines.scene import fields
from engines.scene.memory import refuse_above_memory
from engines.scene.model import Camera, CustomCamera, Orthographic, Perspective, PerspectiveArctan, Triple
from engines.scene.yaml_file import Located

DEFAULT_RESOLUTION = (256, 256)
LARGEST_SIDE = 65_536
PARALLEL = 1e-9
"""Sine of the angle between `up` and the view below which they count as parallel."""
BYTES_PER_PIXEL = 200
"""Sums, squares, halves and counts of a film, and a mean and a bitmap made from it."""


def read_camera(node: Located, allow_imports: bool) -> Camera:
    if not isinstance(node.value, dict):
        raise node.refuse("must be a mapping with keys such as type, eye, target, up, fov and resolution")
    kind = node.value.get("type")
    if kind is None:
        raise node.refuse_key("type", "is missing")
    if isinstance(kind.value, (dict, list, bool, int, float, bytes, type(None))):
        raise kind.refuse("must be text")
    if isinstance(kind.value, str) and kind.value in KINDS:
        return KINDS[kind.value](node)
    if isinstance(kind.value, str) and ":" not in kind.value:
        raise kind.refuse(f"unknown camera: {suggestion(kind.value, KINDS)}, or module:attribute")
    return _custom(node, kind, allow_imports)


def _perspective(node: Located) -> Perspective:
    return Perspective(*_pinhole(node))


def _perspective_arctan(node: Located) -> PerspectiveArctan:
    return PerspectiveArctan(*_pinhole(node))


def _pinhole(node: Located) -> tuple[Triple, Triple, Triple, float, str, tuple[int, int]]:
    known = ("type", "eye", "target", "up", "fov", "fov_axis", "resolution")
    given = fields.mapping(node, known, ("eye", "target"))
    fov = fields.angle(given["fov"]) if "fov" in given else 40.0
    axis = fields.one_of(given["fov_axis"], ("x", "y"), "fov_axis") if "fov_axis" in given else "y"
    eye, target, up = _frame(given)
    return eye, target, up, fov, axis, _resolution(given)


def _orthographic(node: Located) -> Orthographic:
    known = ("type", "eye", "target", "up", "height", "resolution")
    given = fields.mapping(node, known, ("eye", "target", "height"))
    eye, target, up = _frame(given)
    return Orthographic(eye, target, up, fields.positive(given["height"]), _resolution(given))


def _custom(node: Located, kind: Located, allow_imports: bool) -> CustomCamera:
    plugin: Any = kind.value
    if isinstance(plugin, str):
        if not allow_imports:
            raise kind.refuse("imports code: pass --allow-imports (from Python: allow_imports=True) to permit it")
        plugin = _load_attribute(kind)
    options = {key: child.plain() for key, child in node.value.items() if key not in ("type", "resolution")}
    return CustomCamera(plugin() if isinstance(plugin, type) else plugin, options, _resolution(node.value))


def _load_attribute(kind: Located) -> Any:
    module, _, attribute = kind.value.partition(":")
    try:
        found: Any = importlib.import_module(module)
        for part in attribute.split("."):
            found = getattr(found, part)
    except Exception as problem:
        raise kind.refuse(f"cannot be imported: {problem}") from problem
    return found


def _frame(given: dict[str, Located]) -> tuple[Triple, Triple, Triple]:
    eye, target = fields.triple(given["eye"]), fields.triple(given["target"])
    up = fields.direction(given["up"]) if "up" in given else (0.0, 1.0, 0.0)
    view = fields.towards(given["target"], eye, "eye")
    side = (view[1] * up[2] - view[2] * up[1], view[2] * up[0] - view[0] * up[2], view[0] * up[1] - view[1] * up[0])
    if math.hypot(*side) < PARALLEL:
        at = given.get("up", given["target"])
        raise at.refuse("up must not be parallel to the direction of view")
    return eye, target, fields.triple(given["up"]) if "up" in given else up


def _resolution(given: dict[str, Located]) -> tuple[int, int]:
    if "resolution" not in given:
        return DEFAULT_RESOLUTION
    node = given["resolution"]
    if not isinstance(node.value, list) or len(node.value) != 2:
        raise node.refuse("must be [width, height] in pixels")
    width, height = (fields.integer(item, 1, LARGEST_SIDE) for item in node.value)
    refuse_above_memory(node, float(width) * height * BYTES_PER_PIXEL, f"an image of {width} x {height} pixels")
    return width, height


KINDS: dict[str, Callable[[Located], Camera]] = {
    "perspective": _perspective, "perspective_arctan": _perspective_arctan, "orthographic": _orthographic,
}  # fmt: skip

"""A scene as YAML, with the camera and the objects as they were moved in the viewer."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from engines.scene import Camera, CustomCamera, Orthographic
from engines.schema.yaml_file import read_yaml, yaml_text
from harness.view.projection import Vector

DIGITS = 9
"""Significant digits of a coordinate; a float32 has no more."""

POSITION_KEYS = {
    "sphere": ("center",),
    "triangle": ("a", "b", "c"),
    "mesh": ("translate",),
    "point": ("position",),
    "spot": ("position", "target"),
    "projector": ("position", "target"),
    "disk": ("center",),
    "cylinder": ("p0", "p1"),
    "procedural": ("center",),
    "rectangle": ("corner",),
}
"""The keys with the position of each kind of object. A procedural quad has `points` instead."""


def scene_yaml(source: Path, camera: Camera, offsets: Mapping[str, Vector]) -> str:
    """The scene file with this camera, and with objects moved by `offsets` (by `Draggable.id`). Relative paths are kept."""
    scene = read_yaml(source).plain()
    if not isinstance(camera, CustomCamera):
        scene["camera"] |= {"eye": _rounded(camera.eye), "target": _rounded(camera.target)}
        sides = ("height", "width") if isinstance(camera, Orthographic) else ("fov",)
        scene["camera"] |= {side: value for side in sides if (value := getattr(camera, side)) is not None}
    for name, offset in offsets.items():
        kind, _, index = name.partition(":")
        items = scene["shapes" if kind == "shape" else "lights"]
        items[int(index)] = _moved(items[int(index)], offset)
    note = f"# {source.name}, from raybench view; paths are relative to the folder of that file.\n"
    return note + yaml_text(scene)


def _moved(item: Mapping[str, Any], offset: Vector) -> dict[str, Any]:
    """A shape or light of a scene file, moved by an offset."""
    kind = next(key for key in item if key != "material")
    body = dict(item[kind])
    if kind == "procedural" and "points" in body:
        body["points"] = [_rounded(np.array(point) + offset) for point in body["points"]]
        return {**item, kind: body}
    keys = POSITION_KEYS["rectangle" if body.get("name") == "rectangle" else kind]
    if "direction" in body:  # of a light, in the place of a target
        keys = ("position",)
    for key in keys:
        body[key] = _rounded(np.array(body.get(key, (0.0, 0.0, 0.0))) + offset)
    return {**item, kind: body}


def _rounded(values: Any) -> list[float]:
    return [float(f"{value:.{DIGITS}g}") for value in values]

"""A scene as YAML again, after its camera and its things were moved in the viewer."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from engines.scene import Camera, CustomCamera, Orthographic
from engines.schema.yaml_file import read_yaml
from harness.view.pixels import Vector

DIGITS = 9
"""Of a coordinate; a float32 has no more."""

PLACES = {
    "sphere": ("center",), "triangle": ("a", "b", "c"), "mesh": ("translate",), "point": ("position",),
    "procedural": ("center",), "rectangle": ("corner",),
}  # fmt: skip
"""The keys that say where a thing is. A procedural quad's `points` do, too."""


def scene_yaml(source: Path, camera: Camera, offsets: Mapping[str, Vector]) -> str:
    """The file's scene seen by `camera`, with things moved by `offsets` (by `Movable.id`). Relative paths stay as they are."""
    scene = read_yaml(source).plain()
    if not isinstance(camera, CustomCamera):
        scene["camera"] |= {"eye": _rounded(camera.eye), "target": _rounded(camera.target)}
        scene["camera"] |= {"height": camera.height} if isinstance(camera, Orthographic) else {"fov": camera.fov}
    for name, offset in offsets.items():
        kind, _, index = name.partition(":")
        things = scene["shapes" if kind == "shape" else "lights"]
        things[int(index)] = _moved(things[int(index)], offset)
    note = f"# {source.name}, from raybench view; paths in it start from where that file lies.\n"
    return note + yaml.safe_dump(scene, sort_keys=False, default_flow_style=None, width=120, allow_unicode=True)


def _moved(thing: Mapping[str, Any], offset: Vector) -> dict[str, Any]:
    """A shape or light of a scene file, moved."""
    kind = next(key for key in thing if key != "material")
    body = dict(thing[kind])
    if kind == "procedural" and "points" in body:
        body["points"] = [_rounded(np.array(point) + offset) for point in body["points"]]
        return {**thing, kind: body}
    keys = PLACES["rectangle" if body.get("name") == "rectangle" else kind]
    for key in keys:
        body[key] = _rounded(np.array(body.get(key, (0.0, 0.0, 0.0))) + offset)
    return {**thing, kind: body}


def _rounded(values: Any) -> list[float]:
    return [float(f"{value:.{DIGITS}g}") for value in values]

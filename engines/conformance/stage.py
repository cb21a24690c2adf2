"""The scenes that claims are held against, small enough to know every answer by hand."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from engines.scene import Scene, load_scene, scene_from

CAMERA: dict[str, Any] = {"eye": [0, 1, 5], "target": [0, 1, 0], "up": [0, 1, 0], "resolution": [24, 18]}
PINHOLE: dict[str, Any] = {"type": "perspective", "fov": 40, "fov_axis": "y"}

MATERIALS: dict[str, Any] = {
    "white": {"kd": 0.7},
    "half": {"kd": 0.5},
    "furnace": {"kd": 0.5, "emission": 0.5},
    "mirror": {"ks": 0.9},
    "glass": {"ks": 1, "kt": 1, "ior": 1.5, "fresnel": True},
    "lamp": {"emission": [5, 4, 3], "two_sided": True},
    "red": {"emission": [1, 0, 0], "two_sided": True},
    "green": {"emission": [0, 1, 0], "two_sided": True},
    "blue": {"emission": [0, 0, 1], "two_sided": True},
    "grey": {"emission": 0.5, "two_sided": True},
}


def scene(shapes: Sequence[Mapping[str, Any]], lights: Sequence[Mapping[str, Any]] = (), **camera: Any) -> Scene:
    """A scene with those of the materials above that it uses; `camera` changes the camera's keys."""
    used = {shape["material"] for shape in shapes}
    given = {
        "raybench_scene": 1,
        "name": "conformance",
        "camera": {**CAMERA, **({} if camera.get("type") == "orthographic" else PINHOLE), **camera},
        "materials": {name: material for name, material in MATERIALS.items() if name in used},
        "shapes": list(shapes),
        "lights": list(lights),
    }
    made = scene_from(given)
    _GIVEN[made.content_hash] = given
    return made


_GIVEN: dict[str, Mapping[str, Any]] = {}
"""What scenes were made from, by their content."""


def in_file(held: Scene, folder: Path) -> Scene:
    """A scene of this stage, read from a file in `folder`; one that is of no stage, or in a file, stays as it is."""
    given = _GIVEN.get(held.content_hash)
    if held.source or given is None:
        return held
    file = folder / f"{held.content_hash[:16]}.yaml"
    if not file.exists():
        file.write_text(json.dumps(given), encoding="utf-8")  # which is YAML, too
    return load_scene(file)


def sphere(center: Sequence[float] = (0, 0, 0), radius: float = 1, material: str = "white") -> dict[str, Any]:
    return {"sphere": {"center": list(center), "radius": radius}, "material": material}


def cylinder(p0: Sequence[float], p1: Sequence[float], radius: float, material: str = "white") -> dict[str, Any]:
    return {"cylinder": {"p0": list(p0), "p1": list(p1), "radius": radius}, "material": material}


def plane(point: Sequence[float], normal: Sequence[float], material: str = "white") -> dict[str, Any]:
    return {"plane": {"point": list(point), "normal": list(normal)}, "material": material}


def triangle(a: Sequence[float], b: Sequence[float], c: Sequence[float], material: str = "white") -> dict[str, Any]:
    return {"triangle": {"a": list(a), "b": list(b), "c": list(c)}, "material": material}


def mesh(vertices: Any, faces: Any, material: str = "white") -> dict[str, Any]:
    return {"mesh": {"vertices": vertices, "faces": faces}, "material": material}


def rectangle(x: Sequence[float], y: Sequence[float], z: float, material: str = "white") -> dict[str, Any]:
    """Two faces in the plane z = `z`, their front towards +z."""
    corners = [[x[0], y[0], z], [x[1], y[0], z], [x[1], y[1], z], [x[0], y[1], z]]
    return mesh(corners, [[0, 1, 2], [0, 2, 3]], material)


def inward_box(material: str) -> dict[str, Any]:
    """A cube about the origin, to 1 each way, whose faces have their front inside."""
    corners = [[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)]
    quads = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    return mesh(corners, [face for a, b, c, d in quads for face in ([a, b, c], [a, c, d])], material)


LAMP = triangle((-1, 4, -1), (1, 4, -1), (0, 4, 1), "lamp")
BACK = rectangle((-3, 3), (0, 4), -3)

ROOM = scene(
    [sphere((-1, 1, 0), 0.8, "mirror"), sphere((1, 1, 0), 0.8), plane((0, 0, 0), (0, 1, 0)), LAMP, BACK],
    [{"point": {"position": [0, 3, 2], "intensity": 3}}],
)
TRIANGLES = scene([BACK, LAMP, triangle((-1, 0, 0), (1, 0, 0), (0, 2, 0))])

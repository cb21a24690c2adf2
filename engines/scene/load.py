"""From a scene file, or a mapping of the same form, to a checked `Scene`. The format is in DESIGN section 3."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from engines.errors import SceneError
from engines.scene import fields
from engines.scene.cameras import read_camera
from engines.scene.content import content_hash
from engines.scene.files import Place, find_scene
from engines.scene.lights import read_light
from engines.scene.materials import MaterialTable, read_materials
from engines.scene.model import Light, Mesh, Scene, Shape
from engines.scene.shapes import ShapeReader
from engines.scene.yaml_file import Located, locate, read_yaml

FORMAT = 1
KEYS = ("raybench_scene", "name", "camera", "materials", "shapes", "lights")


def load_scene(path: str | PathLike[str], allow_imports: bool = False, allow_outside: bool = False) -> Scene:
    """The scene of a YAML file: a path, or the bare name of one in `scenes/`.

    Files that it names must lie in its folder, below it, or in the shipped scenes, unless `allow_outside`; a camera
    `module:attribute` is imported only with `allow_imports`. Raises `SceneError` for whatever is wrong, with file,
    line, key path, value and what is wanted.
    """
    file = find_scene(path)
    root = read_yaml(file)
    return _scene(root, Place(file.parent, allow_outside), file.stem, allow_imports, str(file))


def scene_from(
    mapping: Mapping[str, Any],
    allow_imports: bool = False,
    allow_outside: bool = False,
    folder: str | PathLike[str] = ".",
) -> Scene:
    """The scene of plain data in the form of a scene file; `vertices` and `faces` may be arrays.

    Relative paths start from `folder`. Raises `SceneError` with the key path of what is wrong.
    """
    if not isinstance(mapping, Mapping):
        raise SceneError(f"scene = {mapping!r:.80}: must be a mapping with keys of {', '.join(KEYS)}")
    return _scene(locate(mapping), Place(Path(folder), allow_outside), "scene", allow_imports, "")


def _scene(root: Located, place: Place, name: str, allow_imports: bool, source: str) -> Scene:
    given = fields.mapping(root, KEYS, ("raybench_scene", "camera"))
    fields.integer(given["raybench_scene"], FORMAT, FORMAT)
    if "name" in given:
        name = fields.text(given["name"])
    camera = read_camera(given["camera"], allow_imports)
    table = read_materials(given["materials"]) if "materials" in given else MaterialTable()
    reader = ShapeReader(table, place)
    shapes = [reader.read(node) for node in fields.items(given["shapes"], "shapes")] if "shapes" in given else []
    lights = [read_light(node, place) for node in fields.items(given["lights"], "lights")] if "lights" in given else []
    return Scene(
        name=name, camera=camera, materials=tuple(table.materials), shapes=tuple(shapes), lights=tuple(lights),
        content_hash=content_hash(camera, table.materials, shapes, lights), source=source,
        warnings=tuple(_warnings(reader, shapes, lights)),
    )  # fmt: skip


def _warnings(reader: ShapeReader, shapes: list[Shape], lights: list[Light]) -> list[str]:
    """A sentence each for what is legal but rarely meant."""
    found = list(dict.fromkeys(reader.warnings))
    if not shapes:
        found.append("the scene is empty: it has no shapes")
    if not lights and not any(_emits(reader.table, shape) for shape in shapes):
        found.append("the scene has no light: images that need light will be black")
    if reader.degenerate == 1:
        found.append("1 triangle has no area: it is never hit")
    elif reader.degenerate:
        found.append(f"{reader.degenerate} triangles have no area: they are never hit")
    return found


def _emits(table: MaterialTable, shape: Shape) -> bool:
    used = set(shape.materials.tolist()) if isinstance(shape, Mesh) else {shape.material}
    return any(table.materials[index].emits for index in used)

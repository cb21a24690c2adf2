"""From a scene file, or a mapping of the same form, to a checked `Scene`. The format: docs/guides/scene.md."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

from engines.errors import SceneError
from engines.scene.context import SceneReader
from engines.scene.files import GLTF_SUFFIXES, MESH_SUFFIXES, Place, find_scene, is_xml
from engines.scene.mesh_scene import mesh_scene
from engines.scene.scene import SCENE, Scene
from engines.schema.yaml_file import locate, read_yaml


def load_scene(
    path: str | PathLike[str],
    allow_imports: bool = False,
    allow_outside: bool = False,
    parameters: Mapping[str, str] | None = None,
    natively: bool = False,
) -> Scene:
    """The scene of a YAML file (a path, or the bare name of one in `scenes/`), of a Mitsuba XML file, of a glTF file, or of a
    mesh (OBJ, PLY or STL) in front of a default camera, under a neutral sky.

    Files that it names must lie in its folder, below it, or in the shipped scenes, unless `allow_outside`; a plugin
    `module:attribute` is imported only with `allow_imports`. `parameters` are values of `$name` in an XML file.
    With `natively` an XML file that cannot be imported is a scene for engines that take such files as they are: `Scene.native`.

    Raises `SceneError` for whatever is wrong, with file, line, key path, value and what is expected.
    """
    file = find_scene(path)
    if is_xml(file):
        from engines.scene.mitsuba_xml import import_scene, read_document
        from engines.scene.native import with_file

        document = read_document(file, Place(file.parent, allow_outside), parameters)
        return with_file(document, lambda: import_scene(document), natively)
    if parameters:
        raise SceneError(f"{file}: parameters are for Mitsuba's XML files")
    if file.suffix.lower() in MESH_SUFFIXES:
        return mesh_scene(file, Place(file.parent, allow_outside))
    if file.suffix.lower() in GLTF_SUFFIXES:
        from engines.scene.gltf import gltf_scene

        return gltf_scene(file, Place(file.parent, allow_outside))
    root = read_yaml(file)
    return SCENE.read(root, SceneReader(Place(file.parent, allow_outside), file.stem, str(file), allow_imports))


def scene_from(
    mapping: Mapping[str, Any], allow_imports: bool = False, allow_outside: bool = False, folder: str | PathLike[str] = "."
) -> Scene:
    """The scene of plain data in the form of a scene file; `vertices` and `faces` may be arrays.

    Relative paths start from `folder`; `allow_imports` and `allow_outside` are those of `load_scene`. Raises `SceneError` with
    the key path of what is wrong.
    """
    if not isinstance(mapping, Mapping):
        raise SceneError(f"scene = {mapping!r:.80}: must be a mapping with keys of {', '.join(SCENE.keys)}")
    reader = SceneReader(Place(Path(folder), allow_outside), allow_imports=allow_imports)
    return SCENE.read(locate(mapping), reader)

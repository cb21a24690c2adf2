"""The content hash: what the pixels of a scene depend on, whatever its names, comments and order of keys."""

from __future__ import annotations

import dataclasses
import hashlib
import inspect
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.scene.cameras import Camera, CustomCamera, Orthographic, Perspective
from engines.scene.lights import CustomLight, EnvironmentLight, Light, SpotLight
from engines.scene.materials import Material
from engines.scene.media import HomogeneousMedium
from engines.scene.mesh import Mesh
from engines.scene.models import Conductor, CustomBSDF
from engines.scene.shapes import Instance, Shape, Single, groups_of
from engines.scene.textures import ImageTexture
from engines.source_files import OWN, code_files, digest

VERSION = b"raybench scene 1"
CHUNK = 1 << 20
"""Numbers of an array that are copied at a time."""
_FILM = {"principal_point", "mirror", "clip"}
LATER = {
    Perspective: _FILM,
    Orthographic: _FILM | {"width"},
    EnvironmentLight: {"rotation", "rows"},
    Conductor: {"distribution"},
    SpotLight: {"texture", "up"},
}
"""Fields that came later: they count where they differ from their defaults, so that older scenes keep their hashes."""


def content_hash(
    camera: Camera,
    materials: Sequence[Material],
    shapes: Sequence[Shape],
    lights: Sequence[Light],
    media: Sequence[HomogeneousMedium] = (),
) -> str:
    """sha256, in hexadecimal, over the camera without its resolution, the shapes in order with their materials by
    value (of an instance the group's shapes and the matrix), and the lights in order. Materials and media that nothing uses do
    not count, and neither do a mesh's texture coordinates and attributes where none of its materials looks at them."""
    digest = hashlib.sha256(VERSION)
    _feed(digest, _camera(camera))
    if (medium := getattr(camera, "medium", None)) is not None:
        _feed(digest, ["medium", _fields(media[medium], {"name"})])
    values = [_material(material) for material in materials]
    groups: dict[int, str] = {}
    for group in groups_of(shapes):
        hashed = hashlib.sha256()
        for shape in group.shapes:
            _feed_shape(hashed, shape, materials, values, media)
        groups[id(group)] = hashed.hexdigest()
    for shape in shapes:
        if isinstance(shape, Instance):
            _feed(digest, ["Instance", groups[id(shape.group)], shape.matrix])
        else:
            _feed_shape(digest, shape, materials, values, media)
    for light in lights:
        _feed(digest, _part(light))
    return digest.hexdigest()


def _feed_shape(
    digest: Any, shape: Single, materials: Sequence[Material], values: Sequence[list[Any]], media: Sequence[HomogeneousMedium]
) -> None:
    """Adds a shape with its materials, whose `values` these are, and the media on its sides."""
    if isinstance(shape, Mesh):
        _feed(digest, ["Mesh", shape.vertices, shape.faces, shape.normals, *_mesh_materials(shape, values)])
        if shape.uvs is not None and any(materials[index].uses_uvs for index in np.unique(shape.materials)):
            _feed(digest, ["uvs", shape.uvs])
        if shape.attributes and (shown := set().union(*(materials[i].attributes for i in np.unique(shape.materials)))):
            _feed(digest, ["attributes", {name: shape.attributes[name] for name in shown & shape.attributes.keys()}])
    else:
        _feed(digest, [_fields(shape, {"material", "name", "interior", "exterior"}), values[shape.material]])
    if shape.is_boundary:
        sides = (None if side is None else _fields(media[side], {"name"}) for side in (shape.interior, shape.exterior))
        _feed(digest, ["media", *sides])


def _camera(camera: Camera) -> Any:
    if not isinstance(camera, CustomCamera):
        return _fields(camera, {"resolution", "medium"})
    return ["CustomCamera", *_plugin(camera.plugin), dict(camera.options)]


def _plugin(plugin: Any) -> list[Any]:
    """What identifies a plugin: its class and name, and the code of the modules that define its two halves, with what they
    import from beside them."""
    kind = plugin if hasattr(plugin, "__qualname__") else type(plugin)
    halves = (kind, getattr(plugin, "jitted", None), getattr(plugin, "numpy", None))
    files = {file for half in halves for file in _files(half)}
    values = [f"{kind.__module__}:{kind.__qualname__}", str(getattr(plugin, "name", ""))]
    return [*values, digest(code for code in code_files(files) if not code[1].is_relative_to(OWN))]


def _files(half: Any) -> Iterator[Path]:
    """The file of a function, a module, a class or its object, or those of several functions; none of Python's and of
    raybench's own."""
    if isinstance(half, tuple):
        for function in half:
            yield from _files(function)
        return
    module = inspect.getmodule(half) or inspect.getmodule(type(half))
    file = getattr(module, "__file__", None)
    known = module is not None and module.__name__.partition(".")[0] in sys.stdlib_module_names
    if file is not None and not known and not Path(file).resolve().is_relative_to(OWN):
        yield Path(file)


def _material(material: Material) -> list[Any]:
    """Its values; a `bsdf` only where there is one, so that materials without keep the hashes of version 1."""
    values = _fields(material, {"name", "bsdf"})
    return values if material.bsdf is None else [*values, tuple(_part(material.bsdf))]


def _part(part: Any) -> list[Any]:
    """A light, a BSDF or a texture by value, with the parts inside it. What is in a material can be a key of a dict."""
    if isinstance(part, CustomLight | CustomBSDF):
        return [type(part).__name__, *_plugin(part.plugin), *(tuple(option) for option in part.options.items())]
    if isinstance(part, ImageTexture):
        return ["ImageTexture", _pixels(part.pixels), part.filter, part.wrap, part.to_uv]
    return _fields(part, set())


def _pixels(pixels: NDArray[np.float32]) -> str:
    hashed = hashlib.sha256()
    _feed(hashed, pixels)
    return hashed.hexdigest()


def _fields(thing: Any, without: set[str]) -> list[Any]:
    later, values = LATER.get(type(thing), set()), [type(thing).__name__]
    for item in dataclasses.fields(thing):
        value = getattr(thing, item.name)
        if item.name in later:
            values += [] if value == item.default else [(item.name, _value(value))]
        elif item.name not in without:
            values.append(_value(value))
    return values


def _value(value: Any) -> Any:
    if isinstance(value, tuple):
        return tuple(map(_value, value))
    return tuple(_part(value)) if dataclasses.is_dataclass(value) else value


def _mesh_materials(mesh: Mesh, values: Sequence[list[Any]]) -> tuple[list[Any], NDArray[np.int32]]:
    """The values of a mesh's materials in the order of first use, and for each face which of them it has."""
    used, first, inverse = np.unique(mesh.materials, return_index=True, return_inverse=True)
    table: dict[tuple[Any, ...], int] = {}
    place = np.zeros(len(used), np.int32)
    for which in np.argsort(first).tolist():
        place[which] = table.setdefault(tuple(values[int(used[which])]), len(table))
    return list(table), place[inverse.reshape(-1)]


def _feed(digest: Any, value: Any) -> None:
    """Adds a value with its type and extent, so that no two different structures give the same bytes."""
    if isinstance(value, np.ndarray):
        digest.update(f"a{value.dtype.str}{value.shape}".encode())
        numbers = np.ascontiguousarray(value).reshape(-1)
        for start in range(0, len(numbers), CHUNK):
            digest.update(numbers[start : start + CHUNK] + value.dtype.type(0))  # + 0 turns -0.0 into 0.0
    elif isinstance(value, dict):
        _feed(digest, ["dict", *sorted(value.items())])
    elif isinstance(value, (list, tuple)):
        digest.update(f"l{len(value)}[".encode())
        for item in value:
            _feed(digest, item)
    elif isinstance(value, float):
        digest.update(f"f{(value + 0.0).hex()};".encode())
    else:
        digest.update(f"{type(value).__name__[0]}{value!r};".encode())

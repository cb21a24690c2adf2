"""Shapes of a scene, in which `merge` stands for the shapes within it, and `instance` for copies of those of a group.

What a group and an instance may hold is what Mitsuba 3.9 allows (`src/render/shapegroup.cpp`, `src/shapes/instance.cpp`).
"""

from __future__ import annotations

from collections.abc import Iterator

from engines.scene.mesh import Mesh, is_singular
from engines.scene.mitsuba_xml.context import Importer
from engines.scene.mitsuba_xml.properties import Plugin
from engines.scene.mitsuba_xml.shapes import shape
from engines.scene.shapes import Shape

MAX_COPIED = 4_000_000
"""Triangles and other primitives in all copies."""


def shapes(importer: Importer, plugin: Plugin) -> Iterator[Shape]:
    """The shapes of a plugin with their materials; none of a group, which instances show. Raises `SceneError`."""
    if plugin.type == "merge":
        importer.enter(plugin)
        for inner in _merged(importer, plugin):
            yield from shapes(importer, inner)
        importer.leave(plugin)
    elif plugin.type == "instance":
        yield from _copies(importer, plugin)
    elif plugin.type != "shapegroup":
        yield shape(importer, plugin)


def _merged(importer: Importer, plugin: Plugin) -> list[Plugin]:
    """The shapes within a merge."""
    if plugin.has("to_world"):
        raise plugin.refuse("a merge has no to_world: its shapes have their own")
    if importer.taken(plugin, "bsdf"):
        importer.notes.add("a BSDF of a merge is not used: its shapes have their own", plugin.element)
    return importer.taken(plugin, "shape")


def _copies(importer: Importer, plugin: Plugin) -> Iterator[Shape]:
    """The shapes of the group, placed by `to_world` after their own; its mirror images keep their front."""
    if importer.taken(plugin, "bsdf"):
        raise plugin.refuse("an instance has no BSDF: the shapes of its group have their own")
    groups = importer.taken(plugin, "shape")
    if len(groups) != 1 or groups[0].type != "shapegroup":
        raise plugin.refuse("an instance has one shape, a shapegroup")
    matrix = plugin.transform()
    if is_singular(matrix[:3, :3]):
        raise plugin.refuse("to_world of an instance must not flatten")
    importer.outer = matrix
    for inner in _members(importer, groups[0]):
        copy = shape(importer, inner)
        importer.copied += len(copy.faces) if isinstance(copy, Mesh) else 1
        if importer.copied > MAX_COPIED:
            raise plugin.refuse(f"instances have more than {MAX_COPIED:,} triangles and other primitives in all")
        yield copy
    importer.outer = None
    importer.finish(plugin)


def _members(importer: Importer, group: Plugin) -> list[Plugin]:
    """The shapes of a group, which have been checked once."""
    key = (id(group), "members")
    if key not in importer.built:
        if importer.taken(group, "bsdf"):
            raise group.refuse("a shapegroup has no BSDF: its shapes have their own")
        if group.has("to_world"):
            group.read.add("to_world")
            importer.notes.add("to_world of a shapegroup has no effect", group.element)
        importer.built[key] = list(_single(importer, group))
        importer.finish(group)
    return importer.built[key]


def _single(importer: Importer, plugin: Plugin) -> Iterator[Plugin]:
    for inner in importer.taken(plugin, "shape"):
        if inner.type in ("shapegroup", "instance"):
            raise inner.refuse("a shapegroup holds no groups and no instances")
        if any(found.kind in ("emitter", "sensor") for found, _ in importer.children(inner, "emitter", "sensor")):
            raise inner.refuse("a shape of a shapegroup has no emitter and no sensor")
        if inner.type == "merge":
            importer.enter(inner)
            _merged(importer, inner)
            yield from _single(importer, inner)
            importer.leave(inner)
        else:
            yield inner

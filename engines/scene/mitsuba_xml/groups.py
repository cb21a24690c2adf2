"""Shapes of a scene, in which `merge` stands for the shapes within it; and groups, which instances show.

What a group and an instance may hold is what Mitsuba 3.9 allows (`src/render/shapegroup.cpp`, `src/shapes/instance.cpp`).
"""

from __future__ import annotations

from collections.abc import Iterator

from engines.errors import SceneError
from engines.scene.mitsuba_xml.context import Importer
from engines.scene.mitsuba_xml.properties import Plugin
from engines.scene.mitsuba_xml.shapes import shape
from engines.scene.shapes import MAX_INSTANCES, Group, Instance, Shape, Single, primitives_of

MAX_MERGED = 200_000
"""Shapes in merges, those in merges within others again and again."""
MAX_REPEATED = 4_000_000
"""Triangles and other primitives of shapes that merges hold again."""


def shapes(importer: Importer, plugin: Plugin) -> Iterator[Shape]:
    """The shapes of a plugin with their materials; none of a group, which instances show. Raises `SceneError`."""
    if plugin.type == "merge":
        importer.enter(plugin)
        for inner in _merged(importer, plugin):
            yield from shapes(importer, inner)
        importer.leave(plugin)
    elif plugin.type == "instance":
        yield _instance(importer, plugin)
    elif plugin.type != "shapegroup":
        yield _made(importer, plugin)


def _made(importer: Importer, plugin: Plugin) -> Single:
    """A shape. One that merges hold again is made again, and its primitives are counted."""
    made, key = shape(importer, plugin), (id(plugin), "made")
    if key in importer.built:
        importer.repeated += primitives_of(made)
        if importer.repeated > MAX_REPEATED:
            raise plugin.refuse(f"merges repeat more than {MAX_REPEATED:,} triangles and other primitives")
    importer.built[key] = True
    return made


def _merged(importer: Importer, plugin: Plugin) -> list[Plugin]:
    """The shapes within a merge."""
    if plugin.has("to_world"):
        raise plugin.refuse("a merge has no to_world: its shapes have their own")
    if importer.taken(plugin, "bsdf"):
        importer.notes.add("a BSDF of a merge is not used: its shapes have their own", plugin.element)
    found = importer.taken(plugin, "shape")
    importer.merged += len(found)
    if importer.merged > MAX_MERGED:
        raise plugin.refuse(f"merges hold more than {MAX_MERGED:,} shapes")
    return found


def _instance(importer: Importer, plugin: Plugin) -> Instance:
    """The group, placed by `to_world`."""
    if importer.taken(plugin, "bsdf"):
        raise plugin.refuse("an instance has no BSDF: the shapes of its group have their own")
    groups = importer.taken(plugin, "shape")
    if len(groups) != 1 or groups[0].type != "shapegroup":
        raise plugin.refuse("an instance has one shape, a shapegroup")
    importer.reader.instances += 1
    if importer.reader.instances > MAX_INSTANCES:
        raise plugin.refuse(f"more than {MAX_INSTANCES:,} instances")
    group = _group(importer, groups[0])
    try:
        made = Instance(group, plugin.transform()[:3])
    except SceneError as problem:
        raise plugin.refuse(f"to_world: {problem}") from problem
    importer.finish(plugin)
    return made


def _group(importer: Importer, plugin: Plugin) -> Group:
    """The group of a shapegroup, made once."""
    key = (id(plugin), "group")
    if key not in importer.built:
        if importer.taken(plugin, "bsdf"):
            raise plugin.refuse("a shapegroup has no BSDF: its shapes have their own")
        if plugin.has("to_world"):
            plugin.read.add("to_world")
            importer.notes.add("to_world of a shapegroup has no effect", plugin.element)
        members = [_made(importer, inner) for inner in _single(importer, plugin)]
        try:
            importer.built[key] = Group(plugin.id or "group", tuple(members))
        except SceneError as problem:
            raise plugin.refuse(str(problem)) from problem
        importer.finish(plugin)
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

"""What the builders of one imported scene share: its place, its plugins by id, notes, and what has been built before."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.errors import suggestion
from engines.scene.bsdf import MAX_DEPTH, Bsdf, Sides
from engines.scene.context import SceneReader
from engines.scene.files import Place
from engines.scene.frames import LARGEST
from engines.scene.materials import Material
from engines.scene.media import HomogeneousMedium
from engines.scene.mitsuba_xml.document import Element
from engines.scene.mitsuba_xml.properties import Plugin, element_of
from engines.scene.models import Diffuse
from engines.scene.notes import Notes
from engines.scene.shapes import Shape, check_area
from engines.scene.textures import Color
from engines.scene.triple import BLACK


@dataclass(slots=True)
class Importer:
    """The state of importing one scene. `built` are results by the plugin (its identity) and how it was asked for; `one_sided`
    are names of BSDFs that are black from behind; `emitting` are the shapes of area emitters, `media` those of shapes and of
    the sensor. `merged` counts the shapes of merges, `repeated` the primitives of those that are there again."""

    reader: SceneReader
    ids: dict[str, Plugin]
    notes: Notes
    built: dict[tuple[Any, ...], Any] = field(default_factory=dict)
    building: list[Plugin] = field(default_factory=list)
    one_sided: dict[str, None] = field(default_factory=dict)
    emitting: dict[int, Plugin] = field(default_factory=dict)
    media: list[HomogeneousMedium] = field(default_factory=list)
    merged: int = 0
    repeated: int = 0

    @property
    def place(self) -> Place:
        """Where the files are that the scene names."""
        return self.reader.place

    def resolve(self, child: Plugin | Element) -> Plugin:
        """The plugin that is nested, or that a reference means. Raises `SceneError` for ids that do not exist."""
        if isinstance(child, Plugin):
            return child
        plugin = self.ids.get(child.attributes["id"])
        if plugin is None:
            raise child.refuse(f"there is no such id: {suggestion(child.attributes['id'], self.ids)}")
        return plugin

    def children(self, plugin: Plugin, *kinds: str) -> Iterator[tuple[Plugin, Plugin | Element]]:
        """The nested plugins of these kinds, references followed, in the order of the document; each with how it is nested."""
        for child in plugin.nested:
            inner = self.resolve(child)
            if inner.kind in kinds:
                yield inner, child

    def taken(self, plugin: Plugin, *kinds: str) -> list[Plugin]:
        """The nested plugins of these kinds, which then count as read."""
        nested = list(self.children(plugin, *kinds))
        for _, child in nested:
            plugin.take(child)
        return [made for made, _ in nested]

    def named(self, plugin: Plugin, name: str) -> Plugin | None:
        """The nested plugin or reference of this name, which then counts as read."""
        child = plugin.find(name)
        if child is None:
            return None
        plugin.take(child)
        return self.resolve(child)

    def enter(self, plugin: Plugin) -> None:
        """Begins to build what may hold others. Raises `SceneError` where that is within itself, or too deep."""
        if any(plugin is outer for outer in self.building):
            raise plugin.refuse("refers to itself")
        if len(self.building) >= MAX_DEPTH:
            raise plugin.refuse(f"more than {MAX_DEPTH} plugins within each other")
        self.building.append(plugin)

    def leave(self, plugin: Plugin) -> None:
        """Ends what `enter` began, and notes what was not read of the plugin."""
        self.building.pop()
        self.finish(plugin)

    def finish(self, plugin: Plugin) -> None:
        """Notes properties that nobody asked for; refuses nested plugins of that kind. Raises `SceneError`."""
        for name, element in plugin.unread():
            self.notes.add(f"{name} of {plugin.kind} {plugin.type} is not read", element)
        for child in plugin.untaken():
            inner = self.resolve(child)
            raise element_of(child).refuse(f"{plugin.kind} {plugin.type!r} has no use for {inner.kind} {inner.type!r}")

    def material(self, bsdf: Bsdf | None, radiance: Color, name: str) -> int:
        """The index of the material with this BSDF (None is black) and emission; the same for the same values."""
        bare = bsdf.front if isinstance(bsdf, Sides) and bsdf.back is None else bsdf
        if bare is None or bare == Diffuse(BLACK):
            bsdf = None
        key = ("material", bsdf, radiance)
        if key not in self.built:
            self.built[key] = self.reader.table.add_named(Material(name, emission=radiance, bsdf=bsdf))
        return self.built[key]

    def claim(self, emitter: Plugin, shape: Plugin) -> None:
        """Says that an emitter is that of a shape. Raises `SceneError` where it has one: Mitsuba allows one shape."""
        other = self.emitting.setdefault(id(emitter), shape)
        if other is not shape:
            raise shape.refuse(f"its emitter is that of {other.element.where} too: give each shape an emitter of its own")

    def check_finite(self, plugin: Plugin, vertices: NDArray[np.float64]) -> None:
        """Raises `SceneError` where a transform has led out of the range of numbers."""
        if not (np.abs(vertices) < LARGEST).all():
            raise plugin.refuse(f"vertices must lie within {LARGEST:g} of the origin")

    def check_area(self, plugin: Plugin, shape: Shape) -> None:
        """Counts triangles without area; raises `SceneError` where they are all of what emits."""
        check_area(plugin.element.located(None), shape, self.reader)

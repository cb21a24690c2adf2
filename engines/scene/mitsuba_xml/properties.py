"""Plugins of a Mitsuba scene as their builders see them: typed properties by snake_case names, nested plugins, and references.

A property that nobody has asked for in the end is worth a note; a nested plugin that nobody has asked for is refused.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from engines.errors import SceneError, suggestion
from engines.scene.frames import Matrix
from engines.scene.mitsuba_xml.document import Element
from engines.scene.mitsuba_xml.transforms import matrix, number, numbers
from engines.scene.triple import Triple, triple

PLUGIN_TAGS = (
    "scene",
    "integrator",
    "sensor",
    "sampler",
    "film",
    "rfilter",
    "shape",
    "bsdf",
    "texture",
    "emitter",
    "medium",
    "phase",
    "volume",
    "subsurface",
)
SPECTRA = ("rgb", "srgb", "spectrum", "blackbody")
VALUE_TAGS = ("integer", "float", "boolean", "string", "point", "vector", "transform", "animation", *SPECTRA)
DROPPED_TAGS = ("mode",)
MAX_NUMBERS = 10_000
TRUE, FALSE = ("true", "1"), ("false", "0")


def snake_case(name: str) -> str:
    """`intIOR` and `toWorld` of Mitsuba 0.x as `int_ior` and `to_world`."""
    return re.sub(r"([a-z0-9])([A-Z])", r"\1_\2", name).lower()


@dataclass(slots=True, eq=False)
class Plugin:
    """An element that makes an object: `kind` is its tag, `type` its plugin. `nested` are plugins and `ref` elements in the
    order of the document; `values` the other properties by name. `read` are the names that builders have asked for."""

    element: Element
    kind: str
    type: str
    id: str
    name: str
    values: dict[str, Element] = field(default_factory=dict)
    nested: list[Plugin | Element] = field(default_factory=list)
    read: set[str] = field(default_factory=set)
    taken: set[int] = field(default_factory=set)

    @property
    def label(self) -> str:
        """How messages and materials call it."""
        return self.id or self.type

    def refuse(self, expected: str) -> SceneError:
        """The error to raise about this plugin."""
        return self.element.refuse(expected)

    def refuse_property(self, name: str, expected: str) -> SceneError:
        """The error to raise about a property, or about the plugin where the property is missing."""
        return self.values[name].refuse_value(expected) if name in self.values else self.refuse(f"{name}: {expected}")

    # ---- values ------------------------------------------------------------------------------------------------------

    def has(self, *names: str) -> bool:
        """Whether any of these properties is there, as a value or as a nested plugin."""
        return any(name in self.values or self.find(name) is not None for name in names)

    def _get(self, *names: str) -> Element | None:
        """The first of the properties that is there; all count as read."""
        self.read.update(names)
        return next((self.values[name] for name in names if name in self.values), None)

    def number(self, *names: str, default: float, low: float = -math.inf, high: float = math.inf) -> float:
        """A number in [low, high]; several names are older names of the same property."""
        element = self._get(*names)
        return default if element is None else number_of(element, low, high)

    def positive(self, *names: str, default: float) -> float:
        """A number above 0."""
        value = self.number(*names, default=default)
        if not value > 0.0:
            raise self.refuse_property(next(name for name in names if name in self.values), "must be greater than 0")
        return value

    def integer(self, *names: str, default: int, low: int, high: int) -> int:
        """A whole number in [low, high], however it is written."""
        element = self._get(*names)
        if element is None:
            return default
        value = number_of(element)
        if value != math.floor(value) or not low <= value <= high:
            raise element.refuse_value(f"must be a whole number in [{low}, {high}]")
        return int(value)

    def boolean(self, *names: str, default: bool) -> bool:
        """`true`, `false`, 1 or 0."""
        element = self._get(*names)
        if element is None:
            return default
        text = element.required("value").strip().lower()
        if text not in (*TRUE, *FALSE):
            raise element.refuse_value("must be true or false")
        return text in TRUE

    def text(self, *names: str, default: str | None = None, known: Collection[str] = ()) -> str | None:
        """A text, one of `known` where these are given, in which case it is lower-cased."""
        element = self._get(*names)
        if element is None:
            return default
        value = element.required("value").strip()
        if known:
            value = value.lower()
            if value not in known:
                raise element.refuse_value(suggestion(value, known))
        return value

    def numbers(self, name: str) -> list[float]:
        """A list of numbers, which must be there."""
        element = self._get(name)
        if element is None:
            raise self.refuse(f"the property '{name}' is missing")
        try:
            return [number(word) for word in re.split(r"[,\s]+", element.required("value").strip())[:MAX_NUMBERS]]
        except ValueError:
            raise element.refuse_value("must be finite numbers") from None

    def file(self, *names: str) -> Element:
        """The element that names a file. Raises `SceneError` where it is missing."""
        element = self._get(*names)
        if element is None:
            raise self.refuse(f"the property '{names[0]}' is missing")
        element.required("value")
        return element

    def point(self, name: str, default: Triple | None = None) -> Triple | None:
        """A point or vector: `value`, or x, y and z."""
        element = self._get(name)
        if element is None:
            return default
        if "value" in element.attributes:
            return triple(numbers(element, "value", (3,)))
        return triple(numbers(element, axis, (1,))[0] for axis in "xyz")

    def transform(self, name: str = "to_world") -> Matrix:
        """(4, 4) a transform; the identity where there is none."""
        element = self._get(name)
        if element is None:
            return np.eye(4)
        if element.tag != "transform":
            raise element.refuse(
                "a <transform> is expected: motion is not supported"
                if element.tag == "animation"
                else "a <transform> is expected"
            )
        return matrix(element)

    def spectrum(self, *names: str) -> Element | None:
        """The element of a colour or number, to be read by `colors`."""
        return self._get(*names)

    # ---- nested plugins ----------------------------------------------------------------------------------------------

    def find(self, name: str) -> Plugin | Element | None:
        """The nested plugin or reference of this name."""
        return next((child for child in self.nested if name_of(child) == name), None)

    def take(self, child: Plugin | Element) -> None:
        """Counts a nested plugin or reference as read."""
        self.taken.add(id(child))

    def untaken(self) -> Iterator[Plugin | Element]:
        """Nested plugins and references that nobody has asked for."""
        return (child for child in self.nested if id(child) not in self.taken)

    def unread(self) -> Iterator[tuple[str, Element]]:
        """Properties that nobody has asked for."""
        return ((name, element) for name, element in self.values.items() if name not in self.read)


def name_of(child: Plugin | Element) -> str:
    """What a nested plugin or reference is to the one around it."""
    return child.name if isinstance(child, Plugin) else snake_case(child.attributes.get("name", ""))


def element_of(child: Plugin | Element) -> Element:
    """Where a plugin is nested, or a reference to it stands."""
    return child.element if isinstance(child, Plugin) else child


def number_of(element: Element, low: float = -math.inf, high: float = math.inf) -> float:
    """The number of an element's `value`. Raises `SceneError` unless it lies in [low, high]."""
    try:
        value = number(element.required("value").strip())
    except ValueError:
        raise element.refuse_value("must be a finite number") from None
    if not low <= value <= high:
        limits = f"must lie in [{low:g}, {high:g}]" if math.isfinite(high) else f"must be at least {low:g}"
        raise element.refuse_value(limits)
    return value


def plugin_tree(element: Element, ids: dict[str, Plugin]) -> Plugin:
    """The plugin of an element with all below it; `ids` learns those that have one. Raises `SceneError`."""
    made = Plugin(
        element,
        element.tag,
        "scene" if element.tag == "scene" else element.required("type"),
        element.attributes.get("id", ""),
        snake_case(element.attributes.get("name", "")),
    )
    if made.id:
        if made.id in ids:
            raise element.refuse(f"this id is taken by {ids[made.id].element.where}")
        ids[made.id] = made
    for child in element.children:
        if child.tag in PLUGIN_TAGS or (child.tag == "spectrum" and "type" in child.attributes):
            if child.tag == "scene":
                raise child.refuse("a scene within a scene")
            made.nested.append(plugin_tree(child, ids))
        elif child.tag == "ref":
            child.required("id")
            made.nested.append(child)
        elif child.tag in VALUE_TAGS:
            name = snake_case(child.required("name"))
            if name in made.values:
                raise child.refuse(f"this property is given twice: first in line {made.values[name].line}")
            made.values[name] = child
        elif child.tag == "alias":
            _name_again(child, ids)
        elif child.tag not in DROPPED_TAGS:
            known: Sequence[str] = (*PLUGIN_TAGS[1:], *VALUE_TAGS, "ref", "default", "include")
            raise child.refuse(f"unknown element: {suggestion(child.tag, known)}")
    return made


def _name_again(element: Element, ids: dict[str, Plugin]) -> None:
    """An `alias` element: another id of a plugin that stands before it."""
    known, new = element.required("id"), element.required("as")
    if known not in ids:
        raise element.refuse(f"there is no such id before this line: {suggestion(known, ids)}")
    if new in ids:
        raise element.refuse(f"this id is taken by {ids[new].element.where}")
    ids[new] = ids[known]

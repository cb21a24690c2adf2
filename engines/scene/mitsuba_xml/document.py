"""The XML of a Mitsuba scene as elements with their lines: parameters replaced, included files in place.

Expat reads it with everything switched off that makes XML dangerous: a document type, and with it every entity, is refused.
Bytes, depth, the number of elements and the text that parameters grow into are bounded, over all included files together.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from xml.parsers import expat

from engines.errors import SceneError, suggestion
from engines.input_files import open_regular, unreadable
from engines.scene.files import Place
from engines.schema.yaml_file import MAX_SHOWN, Located, Origin

MAX_BYTES = 16 * 2**20
MAX_DEPTH = 64
MAX_ELEMENTS = 200_000
MAX_INCLUDES = 1000
MAX_NESTED_INCLUDES = 16
MAX_PATHS = 100
NEWEST_OLD = (2, 0)
"""Files of a version below this one are in the format of Mitsuba 0.x."""
OPAQUE = ("hide",)
"""Elements that are left out with all that is in them."""

_PARAMETER = re.compile(r"\$(\w+)")


@dataclass(frozen=True, slots=True)
class Source:
    """A file as messages call it, and the version of the format that it says it has."""

    name: str
    version: tuple[int, ...]

    @property
    def old(self) -> bool:
        """Whether the format is that of Mitsuba 0.x."""
        return self.version < NEWEST_OLD


@dataclass(slots=True, eq=False)
class Element:
    """An element: `line` counts from 1."""

    tag: str
    attributes: dict[str, str]
    line: int
    source: Source
    children: list[Element] = field(default_factory=list)

    @property
    def where(self) -> str:
        """`scene.xml:12 <bsdf type="phong">`."""
        named = "".join(f" {key}={_short(self.attributes[key])}" for key in ("type", "name", "id") if key in self.attributes)
        return f"{self.source.name}:{self.line} <{self.tag[:MAX_SHOWN]}{named}>"

    def refuse(self, wanted: str) -> SceneError:
        """The error to raise about this element."""
        return SceneError(f"{self.where}: {wanted}")

    def refuse_value(self, wanted: str) -> SceneError:
        """The error to raise about the attribute `value`."""
        return SceneError(f"{self.where} = {_short(self.attributes.get('value', ''))}: {wanted}")

    def located(self, value: Any) -> Located:
        """`value` as if it stood in a YAML file at this place, for the readers of such files."""
        path = (self.attributes.get("name", self.tag),)
        return Located(value, Origin(self.source.name, SceneError), path, self.line, self.line)

    def required(self, attribute: str) -> str:
        """The text of an attribute. Raises `SceneError` where it is missing."""
        if attribute not in self.attributes:
            raise self.refuse(f"the attribute '{attribute}' is missing")
        return self.attributes[attribute]


def _short(text: str) -> str:
    return f'"{text[:MAX_SHOWN]}"' if len(text) <= MAX_SHOWN else f'"{text[:MAX_SHOWN]}..."'


@dataclass(slots=True)
class Reader:
    """Reads a file with those that it includes. `parameters` are values of `$name` from outside; they win over `default`.
    `place` learns the folders of `path` elements."""

    place: Place
    parameters: Mapping[str, str]
    used: set[str] = field(default_factory=set)
    defined: dict[str, str] = field(default_factory=dict)
    left: int = MAX_ELEMENTS
    bytes_left: int = MAX_BYTES
    includes: int = 0

    def read(self, file: Path, name: str) -> Element:
        """The `scene` element of a file, complete. Raises `SceneError` with file and line for whatever is wrong."""
        self.defined = dict(self.parameters)
        root = self._file(file, name, (file.resolve(),))
        for parameter in self.parameters:
            if parameter not in self.used:
                known = (self.used | self.defined.keys()) - {parameter}
                raise SceneError(f"{name}: has no parameter ${parameter[:MAX_SHOWN]}: {suggestion(parameter, known)}")
        return root

    def _file(self, file: Path, name: str, within: tuple[Path, ...]) -> Element:
        root = _Parser(self, name).parse(_content(file, name, self))
        if root.tag != "scene":
            raise root.refuse("the root of a Mitsuba scene is <scene>")
        return self._expanded(root, within)

    def _expanded(self, element: Element, within: tuple[Path, ...]) -> Element:
        """The element with parameters replaced and includes in place, in the order of the document."""
        if element.attributes:
            element.attributes = {key: self._replaced(element, text) for key, text in element.attributes.items()}
        children: list[Element] = []
        for child in element.children:
            if child.tag == "default":
                self._define(child)
            elif child.tag == "include":
                children += self._included(child, within)
            elif child.tag == "path":
                self._look_in(child, within[-1].parent)
            elif child.tag not in OPAQUE:
                children.append(self._expanded(child, within))
        element.children = children
        return element

    def _define(self, element: Element) -> None:
        name = element.required("name")
        self.used.add(name)
        if name not in self.parameters:
            self.defined[name] = self._replaced(element, element.required("value"))

    def _look_in(self, element: Element, folder: Path) -> None:
        """A `path` element: files are looked for in its folder, which is relative to the file's, before the others."""
        if len(self.place.first) >= MAX_PATHS:
            raise element.refuse(f"more than {MAX_PATHS} folders to look in")
        self.place = self.place.looking_in(folder / self._replaced(element, element.required("value")))

    def _replaced(self, element: Element, text: str) -> str:
        if "$" not in text:
            return text

        def value(match: re.Match[str]) -> str:
            # the longest known name wins, as in "$name_of_file" with a parameter "name"
            word = match[1]
            for end in range(len(word), 0, -1):
                if word[:end] in self.defined:
                    self.used.add(word[:end])
                    found = self.defined[word[:end]] + word[end:]
                    self.bytes_left -= len(found)
                    if self.bytes_left < 0:
                        raise element.refuse(f"parameters grow beyond {MAX_BYTES // 2**20} MiB of text")
                    return found
            raise element.refuse(f"parameter ${word[:MAX_SHOWN]} has no value: {suggestion(word, self.defined)}")

        return _PARAMETER.sub(value, text)

    def _included(self, element: Element, within: tuple[Path, ...]) -> list[Element]:
        name = self._replaced(element, element.required("filename"))
        self.includes += 1
        if self.includes > MAX_INCLUDES or len(within) > MAX_NESTED_INCLUDES:
            raise element.refuse(f"more than {MAX_INCLUDES} included files, or {MAX_NESTED_INCLUDES} within each other")
        file = self.place.find(element.located(name), name)
        if file in within:
            raise element.refuse(f"{name[:MAX_SHOWN]!r} includes itself")
        if not file.is_file():
            raise element.refuse(f"{name[:MAX_SHOWN]!r} is not a regular file")
        return self._file(file, name, (*within, file)).children


def _content(file: Path, name: str, reader: Reader) -> bytes:
    try:
        with open_regular(file) as stream:
            data = stream.read(reader.bytes_left + 1)
    except (OSError, ValueError) as problem:
        raise SceneError(f"{name}: {unreadable(problem)}") from problem
    reader.bytes_left -= len(data)
    if reader.bytes_left < 0:
        raise SceneError(f"{name}: more than {MAX_BYTES // 2**20} MiB of XML")
    return data


class _Parser:
    """One file as a tree."""

    def __init__(self, reader: Reader, name: str) -> None:
        self._reader, self._name = reader, name
        self._source = Source(name, ())
        self._open: list[Element] = []
        self._root: Element | None = None
        self._expat = expat.ParserCreate()
        self._expat.StartElementHandler = self._start
        self._expat.EndElementHandler = lambda tag: self._open.pop()
        self._expat.StartDoctypeDeclHandler = self._doctype

    def parse(self, data: bytes) -> Element:
        try:
            self._expat.Parse(data, True)
        except (expat.ExpatError, UnicodeError, LookupError, ValueError) as problem:
            line = getattr(problem, "lineno", self._expat.CurrentLineNumber)
            text = expat.ErrorString(problem.code) if isinstance(problem, expat.ExpatError) else problem
            raise SceneError(f"{self._name}:{line}: not well-formed XML: {text}") from problem
        assert self._root is not None
        return self._root

    def _doctype(self, *_: Any) -> None:
        line = self._expat.CurrentLineNumber
        raise SceneError(f"{self._name}:{line}: has a document type, and so may have entities: they are not read")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        line = self._expat.CurrentLineNumber
        if not self._open:
            self._source = Source(self._name, _version(self._name, line, attributes))
        element = Element(tag, attributes, line, self._source)
        self._reader.left -= 1
        if self._reader.left < 0:
            raise element.refuse(f"more than {MAX_ELEMENTS} elements")
        if len(self._open) >= MAX_DEPTH:
            raise element.refuse(f"more than {MAX_DEPTH} elements within each other")
        if self._open:
            self._open[-1].children.append(element)
        else:
            self._root = element
        self._open.append(element)


def _version(name: str, line: int, attributes: Mapping[str, str]) -> tuple[int, ...]:
    """(3, 0, 0) of "3.0.0"; the newest where a file does not say."""
    text = attributes.get("version", "3.0.0")
    if re.fullmatch(r"[0-9]{1,4}(\.[0-9]{1,4}){0,3}", text) is None:
        raise SceneError(f"{name}:{line} <scene> version = {_short(text)}: must look like 3.0.0")
    return tuple(map(int, text.split(".")))

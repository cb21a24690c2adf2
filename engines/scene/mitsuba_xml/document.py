"""The XML of a Mitsuba scene as elements with their lines: parameters replaced, included files in place.

Names mean what they mean in Mitsuba 3.9 (`src/core/parser.cpp`): of a parameter's values those from outside count first,
then the first `default` in document order; a file's includes are looked for beside it, then in its `path` folders, then in
those of the files that include it.

Expat reads it with everything switched off that makes XML dangerous: a document type, and with it every entity, is refused.
Bytes, depth, the number of elements and the text that parameters grow into are bounded, over all included files together.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
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

_PARAMETER = re.compile(r"\\\$|\$(\w*)")
"""A dollar after a backslash, which stands for itself, or the name of a parameter with what follows it."""


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

    def line_within(self, main: str) -> str:
        """What notes call the element of a scene whose `main` file this is."""
        own = self.source.name == main
        return f"line {self.line}" if own else f"{self.source.name}:{self.line}"

    def refuse(self, expected: str) -> SceneError:
        """The error to raise about this element."""
        return SceneError(f"{self.where}: {expected}")

    def refuse_value(self, expected: str) -> SceneError:
        """The error to raise about the attribute `value`."""
        return SceneError(f"{self.where} = {_short(self.attributes.get('value', ''))}: {expected}")

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


@dataclass(frozen=True, slots=True)
class Document:
    """A Mitsuba file that has been read: its `scene` element complete, and where the files are that it names.

    `files` are the XML files, included ones too. `digest` is a hash of their elements as they stand there, and of
    `parameters`, the values from outside.
    """

    file: Path
    root: Element
    place: Place
    parameters: Mapping[str, str]
    files: tuple[Path, ...]
    digest: str


def read_document(file: Path, place: Place, parameters: Mapping[str, str] | None = None) -> Document:
    """The document of a file. `parameters` are values of `$name` from outside. Raises `SceneError` with file and line for
    whatever is wrong."""
    reader = Reader(place, dict(parameters or {}))
    root, folders = reader.read(file, str(file))
    place = replace(place, first=tuple(folders[:-1]))
    return Document(file, root, place, reader.parameters, tuple(reader.files), reader.hashed.hexdigest())


@dataclass(slots=True)
class Reader:
    """Reads a file with those that it includes."""

    place: Place
    parameters: Mapping[str, str]
    used: set[str] = field(default_factory=set)
    defined: dict[str, str] = field(default_factory=dict)
    left: int = MAX_ELEMENTS
    bytes_left: int = MAX_BYTES
    includes: int = 0
    files: list[Path] = field(default_factory=list)
    hashed: Any = field(default_factory=hashlib.sha256)

    def read(self, file: Path, name: str) -> tuple[Element, list[Path]]:
        """The `scene` element of the main file, and the folders in which it looks for others."""
        self.defined = dict(self.parameters)
        self.hashed.update(repr(sorted(self.parameters.items())).encode())
        folders = [self.place.folder]
        root = self._file(file, name, (file.absolute(),), folders)
        if root.tag != "scene":
            raise root.refuse("the root of a Mitsuba scene is <scene>")
        for parameter in self.parameters:
            if parameter not in self.used:
                known = (self.used | self.defined.keys()) - {parameter}
                raise SceneError(f"{name}: has no parameter ${parameter[:MAX_SHOWN]}: {suggestion(parameter, known)}")
        return root, folders

    def _file(self, file: Path, name: str, within: tuple[Path, ...], folders: list[Path]) -> Element:
        self.files.append(within[-1].resolve())
        root = _Parser(self, name).parse(_content(file, name, self))
        return self._expanded(root, within, folders)

    def _expanded(self, element: Element, within: tuple[Path, ...], folders: list[Path]) -> Element:
        """The element with parameters replaced and includes in place, in the order of the document."""
        if element.attributes:
            element.attributes = {key: self._replaced(element, text) for key, text in element.attributes.items()}
        if element.tag == "spectrum" and "filename" in element.attributes:
            name = element.attributes["filename"]
            element.attributes["filename"] = str(self._found(element, name, folders))
        children: list[Element] = []
        for child in element.children:
            if child.tag == "default":
                self._define(child)
            elif child.tag == "include":
                children += self._included(child, within, folders)
            elif child.tag == "path":
                self._look_in(child, within[-1].parent, folders)
            elif child.tag not in OPAQUE:
                children.append(self._expanded(child, within, folders))
        element.children = children
        return element

    def _define(self, element: Element) -> None:
        name = element.required("name")
        self.used.add(name)
        value = self._replaced(element, element.required("value"))
        self.defined.setdefault(name, value)

    def _look_in(self, element: Element, folder: Path, folders: list[Path]) -> None:
        """A `path` element: a folder relative to the file's, in which the file looks before the others."""
        if len(folders) > MAX_PATHS:
            raise element.refuse(f"more than {MAX_PATHS} folders to look in")
        name = self._replaced(element, element.required("value"))
        starts = (start for start in (folder, *folders) if (start / name).is_dir())
        folders.insert(0, next(starts, folder) / name)

    def _found(self, element: Element, name: str, folders: list[Path]) -> Path:
        return replace(self.place, first=tuple(folders)).find(element.located(name), name)

    def _replaced(self, element: Element, text: str) -> str:
        if "$" not in text:
            return text

        def value(match: re.Match[str]) -> str:
            # the longest known name wins, as in "$name_of_file" with a parameter "name"
            word = match[1]
            if word is None:
                return "$"
            for end in range(len(word), 0, -1):
                if word[:end] in self.defined:
                    self.used.add(word[:end])
                    replaced = self.defined[word[:end]] + word[end:]
                    self.bytes_left -= len(replaced)
                    if self.bytes_left < 0:
                        raise element.refuse(f"parameters grow beyond {MAX_BYTES // 2**20} MiB of text")
                    return replaced
            raise element.refuse(f"parameter ${word[:MAX_SHOWN]} has no value: {suggestion(word, self.defined)}")

        return _PARAMETER.sub(value, text)

    def _included(self, element: Element, within: tuple[Path, ...], folders: list[Path]) -> list[Element]:
        """What stands in place of an `include` element: the children of a `scene`, or the plugin that is the root."""
        name = self._replaced(element, element.required("filename"))
        self.includes += 1
        if self.includes > MAX_INCLUDES or len(within) > MAX_NESTED_INCLUDES:
            raise element.refuse(f"more than {MAX_INCLUDES} included files, or {MAX_NESTED_INCLUDES} within each other")
        inner = [within[-1].parent, *folders]
        file = self._found(element, name, inner)
        if file in (outer.resolve() for outer in within):
            raise element.refuse(f"{name[:MAX_SHOWN]!r} includes itself")
        if not file.is_file():
            raise element.refuse(f"{name[:MAX_SHOWN]!r} is not a regular file")
        root = self._file(file, name, (*within, file), inner)
        if root.tag == "scene":
            return root.children
        if "type" not in root.attributes:
            raise root.refuse("the root of an included file is <scene>, or a plugin with a type")
        root.attributes.pop("name", None)
        if "name" in element.attributes:
            root.attributes["name"] = self._replaced(element, element.attributes["name"])
        return [root]


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
        self._reader.hashed.update(repr((len(self._open), tag, sorted(attributes.items()))).encode())
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

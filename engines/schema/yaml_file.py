"""A strict, safe YAML reader that remembers where every value stood; scenes and experiments both use it.

    root = read_yaml("scenes/box.yaml")          # or read_yaml(path, error=ConfigError), or parse_yaml(text, name)
    root.value                                   # dict[str, Located], list[Located], str, int, float, bool or None
    red = root.value["materials"].value["red"]
    red.line, red.key_line, red.path             # 14, 14, ("materials", "red")
    raise red.refuse("must lie in [0, 1]")       # scenes/box.yaml:14 materials.red = 1.4: must lie in [0, 1]
    raise red.unknown_key("kdd", ["kd", "ks"])   # scenes/box.yaml:15 materials.red.kdd: unknown key: ... 'kd' ...
    root.plain()                                 # the same tree as ordinary dicts, lists and scalars
    root.at(("sweep", "engine", 0))              # the nearest Located on that way: for the `loc` of pydantic's errors

`locate(data)` gives plain Python data the same shape (no lines; NumPy arrays stay leaves): one loader serves both.

YAML as in the core schema of 1.2: `1e-3` is a number, `yes` and `on` are text, dates are text. Refused with file and
line: duplicate keys, tags other than !!str, keys that are not text, several documents, recursive aliases, and whatever
passes the limits below. Anchors, aliases and `<<` merges work. PyYAML's C loader is not used: it crashes on deep
nesting; nothing here recurses without a cap. It is imported where text is read: scenes can be had without it.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from os import PathLike, fspath
from typing import Any

import numpy as np

from engines.errors import RaybenchError, SceneError, suggestion
from engines.input_files import open_regular, unreadable

MAX_BYTES = 16 * 2**20
MAX_DEPTH = 64
MAX_ALIASES = 1000
MAX_DIGITS = 1000
"""Of a whole number: Python writes no more than 4300 in decimal, and messages show what was found."""
MAX_SHOWN = 80
"""Characters of a key or value in a message."""
MAX_NODES = 400_000
"""Values in a file, each use of an alias counted in full. PyYAML reads some 20,000 a second."""

KeyPath = tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class Origin:
    """Where a tree came from (a file's name, or empty) and which error its refusals are."""

    name: str
    error: type[RaybenchError]


@dataclass(frozen=True, slots=True, eq=False)
class Located:
    """A value with its place. `line` and `key_line` count from 1 and are 0 where data did not come from a file."""

    value: Any
    origin: Origin
    path: KeyPath = ()
    line: int = 0
    key_line: int = 0

    @property
    def where(self) -> str:
        """`scenes/box.yaml:14 materials.red.kd[1]`; the key path alone for data from Python."""
        return _where(self.origin, self.line, self.path)

    def refuse(self, wanted: str) -> RaybenchError:
        """The error to raise for this value: where, what was found (scalars only), what is expected."""
        return self.origin.error(f"{self.where}{_found(self.value)}: {wanted}")

    def refuse_key(self, key: str, wanted: str) -> RaybenchError:
        """The error to raise about a key of this mapping, at the key's own line and origin."""
        child = self.value.get(key) if isinstance(self.value, dict) else None
        line, origin = (child.key_line, child.origin) if isinstance(child, Located) else (self.line, self.origin)
        return origin.error(f"{_where(origin, line, (*self.path, key))}: {wanted}")

    def unknown_key(self, key: str, known: Iterable[str]) -> RaybenchError:
        """The error to raise for a key of this mapping that does not exist, with the nearest known one."""
        return self.refuse_key(key, f"unknown key: {suggestion(key, known)}")

    def at(self, path: Sequence[str | int]) -> Located:
        """The value at a path of keys and indices, or the last one on the way that exists."""
        node = self
        for step in path:
            children: dict[Any, Located] = node.value if isinstance(node.value, dict) else {}
            if isinstance(node.value, list):
                children = dict(enumerate(node.value))
            if step not in children:
                break
            node = children[step]
        return node

    def plain(self) -> Any:
        """The tree as dicts, lists and scalars."""
        if isinstance(self.value, dict):
            return {key: child.plain() for key, child in self.value.items()}
        if isinstance(self.value, list):
            return [child.plain() for child in self.value]
        return self.value


def read_yaml(path: str | PathLike[str], error: type[RaybenchError] = SceneError, name: str = "") -> Located:
    """The tree of a YAML file, which messages call `name` or by its path.

    Raises `error` for files that are missing, no regular files, unreadable, empty, too large, not text or not strict
    YAML.
    """
    name = name or fspath(path)
    try:
        with open_regular(path) as stream:
            data = stream.read(MAX_BYTES + 1)
    except (OSError, ValueError) as problem:
        raise error(f"{name}: {unreadable(problem)}") from problem
    if len(data) > MAX_BYTES:
        raise error(f"{name}: larger than {MAX_BYTES // 2**20} MiB: put meshes into files of their own")
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as problem:
        line = data[: problem.start].count(b"\n") + 1
        raise error(f"{name}:{line}: not UTF-8 text: byte 0x{data[problem.start]:02x}") from problem
    return parse_yaml(text, name, error)


def parse_yaml(text: str, name: str = "", error: type[RaybenchError] = SceneError) -> Located:
    """The tree of YAML text; `name` stands before the line in messages."""
    import yaml

    origin = Origin(name, error)
    try:
        root = _Composer(origin).compose(text)
    except yaml.MarkedYAMLError as problem:
        mark = problem.problem_mark or problem.context_mark
        line = mark.line + 1 if mark else 0
        raise error(f"{_where(origin, line, ())}: not YAML: {problem.problem or problem.context}") from problem
    except yaml.reader.ReaderError as problem:
        line = text[: problem.position].count("\n") + 1
        raise error(f"{_where(origin, line, ())}: not text: character #x{_code(problem.character):04x}") from problem
    except (ValueError, RecursionError, OverflowError) as problem:
        raise error(f"{_where(origin, 0, ())}: not YAML: {problem}") from problem
    return _locate_node(root, origin, (), 0)


def locate(data: Any, name: str = "", error: type[RaybenchError] = SceneError) -> Located:
    """Plain Python data as a tree without lines: tuples become lists, NumPy scalars numbers; arrays stay leaves."""
    return _locate_plain(data, Origin(name, error), ())


def _where(origin: Origin, line: int, path: KeyPath) -> str:
    text = "".join(f"[{step}]" if isinstance(step, int) else f".{step[:MAX_SHOWN]}" for step in path).lstrip(".")
    place = f"{origin.name}:{line}" if origin.name and line else origin.name
    return " ".join(part for part in (place, text) if part) or "top level"


def _found(value: Any) -> str:
    if isinstance(value, (dict, list, np.ndarray)):
        return ""
    shown = "null" if value is None else repr(value)
    return f" = {shown if len(shown) <= MAX_SHOWN else shown[: MAX_SHOWN - 3] + '...'}"


def _code(character: str | int) -> int:
    return ord(character) if isinstance(character, str) else character


# --- from events to nodes -------------------------------------------------------------------------------------------


@dataclass(slots=True, eq=False)
class _Node:
    """A scalar, or the children of a list, or those of a mapping with the lines of their keys.

    `size` counts the values below, and `height` the levels, with every alias in full.
    """

    value: Any
    line: int
    key_lines: dict[str, int] = field(default_factory=dict)
    merges: list[_Node] = field(default_factory=list)
    pending_key: str | None = None
    size: int = 1
    height: int = 1


class _Composer:
    """Builds nodes from PyYAML's events on its own stack, so that depth is a number and not Python's recursion."""

    def __init__(self, origin: Origin) -> None:
        self.origin = origin
        self.anchors: dict[str, _Node] = {}
        self.open: list[tuple[_Node, str | None]] = []
        self.root: _Node | None = None
        self.aliases = self.nodes = 0

    def compose(self, text: str) -> _Node:
        import yaml

        documents = 0
        for event in yaml.parse(text, Loader=yaml.SafeLoader):
            line = event.start_mark.line + 1
            if isinstance(event, yaml.DocumentStartEvent):
                documents += 1
                if documents > 1:
                    raise self._error(line, "a second document begins: one is expected")
            elif isinstance(event, yaml.AliasEvent):
                self._add(self._alias(event, line), line)
            elif isinstance(event, yaml.ScalarEvent):
                self._scalar(event, line)
            elif isinstance(event, yaml.MappingStartEvent):
                self._start(event, line, {})
            elif isinstance(event, yaml.SequenceStartEvent):
                self._start(event, line, [])
            elif isinstance(event, (yaml.MappingEndEvent, yaml.SequenceEndEvent)):
                self._end()
        if self.root is None or (self.root.value is None and not text.strip()):
            raise self._error(1, "empty: a mapping is expected")
        return self.root

    def _error(self, line: int, wanted: str, path: KeyPath = ()) -> RaybenchError:
        return self.origin.error(f"{_where(self.origin, line, path)}: {wanted}")

    def _count(self, line: int) -> None:
        self.nodes += 1
        if self.nodes > MAX_NODES:
            raise self._error(line, f"more than {MAX_NODES} values: put meshes into files of their own")

    def _start(self, event: Any, line: int, empty: Any) -> None:
        self._count(line)
        if event.tag is not None and event.tag != "!":
            raise self._error(line, f"tag {event.tag!r}: tags are not allowed")
        if len(self.open) >= MAX_DEPTH:
            raise self._error(line, f"nested deeper than {MAX_DEPTH} levels")
        if self.open:
            self._refuse_as_key(line)
        self.open.append((_Node(empty, line), event.anchor))

    def _end(self) -> None:
        node, anchor = self.open.pop()
        if node.merges:
            _merge(node)
        if anchor is not None:
            self.anchors[anchor] = node
        self._add(node, node.line)

    def _scalar(self, event: Any, line: int) -> None:
        self._count(line)
        if event.tag not in (None, "!", "tag:yaml.org,2002:str"):
            raise self._error(line, f"tag {event.tag!r}: tags are not allowed")
        plain = event.implicit[0] and event.tag is None
        try:
            value = _scalar_value(event.value) if plain else event.value
        except ValueError as problem:
            raise self._error(line, "a number with too many digits") from problem
        node = _Node(value, line)
        if self.open and isinstance(self.open[-1][0].value, dict) and self.open[-1][0].pending_key is None:
            self._key(self.open[-1][0], value, event.value, line)
            return
        if event.anchor is not None:
            self.anchors[event.anchor] = node
        self._add(node, line)

    def _key(self, parent: _Node, key: Any, text: str, line: int) -> None:
        key = text if text == "null" else key
        if not isinstance(key, str):
            raise self._error(line, f"key {key!r}: keys are text, write it in quotes")
        if key in parent.key_lines:
            first = parent.key_lines[key]
            raise self._error(line, f"{key!r} is there twice: first in line {first}, again in line {line}")
        parent.key_lines[key] = line
        parent.pending_key = key

    def _alias(self, event: Any, line: int) -> _Node:
        self.aliases += 1
        if self.aliases > MAX_ALIASES:
            raise self._error(line, f"more than {MAX_ALIASES} aliases")
        if event.anchor not in self.anchors:
            raise self._error(line, f"alias {event.anchor!r}: no finished anchor of that name stands before it")
        node = self.anchors[event.anchor]
        if self.open:
            self._refuse_as_key(line)
        if len(self.open) + node.height > MAX_DEPTH:
            raise self._error(line, f"nested deeper than {MAX_DEPTH} levels")
        return node

    def _refuse_as_key(self, line: int) -> None:
        parent = self.open[-1][0]
        if isinstance(parent.value, dict) and parent.pending_key is None:
            raise self._error(line, "keys are text")

    def _add(self, node: _Node, line: int) -> None:
        if not self.open:
            self.root = node
            return
        parent = self.open[-1][0]
        parent.size += node.size
        parent.height = max(parent.height, node.height + 1)
        if parent.size > MAX_NODES:
            raise self._error(line, f"more than {MAX_NODES} values, aliases counted in full")
        if isinstance(parent.value, list):
            parent.value.append(node)
            return
        key, parent.pending_key = parent.pending_key, None
        assert key is not None
        if key != "<<":
            parent.value[key] = node
            return
        sources = node.value if isinstance(node.value, list) else [node]
        if not all(isinstance(source.value, dict) for source in sources):
            raise self._error(line, "a merge wants a mapping or a list of mappings", ("<<",))
        parent.merges = sources


def _merge(node: _Node) -> None:
    """Adds the keys of `<<` sources that are not there: earlier sources win, the mapping's own keys before all."""
    for source in node.merges:
        for key, child in source.value.items():
            if key not in node.value:
                node.value[key] = child
                node.key_lines[key] = source.key_lines[key]


_INTEGER = re.compile(r"[-+]?[0-9]+|0x[0-9a-fA-F]+|0o[0-7]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_WORDS: dict[str, Any] = {"": None, "~": None}
_WORDS |= {form: None for form in ("null", "Null", "NULL")}
_WORDS |= {form: True for form in ("true", "True", "TRUE")} | {form: False for form in ("false", "False", "FALSE")}
_WORDS |= {sign + form: float(sign + "inf") for sign in ("", "+", "-") for form in (".inf", ".Inf", ".INF")}
_WORDS |= {form: float("nan") for form in (".nan", ".NaN", ".NAN")}


def _scalar_value(text: str) -> Any:
    """What a plain scalar means in YAML 1.2's core schema."""
    if text in _WORDS:
        return _WORDS[text]
    if _INTEGER.fullmatch(text):
        if len(text) > MAX_DIGITS:
            raise ValueError
        return int(text, 0 if text[:2] in ("0x", "0o") else 10)
    return float(text) if _FLOAT.fullmatch(text) else text


# --- from nodes and plain data to Located ---------------------------------------------------------------------------


def _locate_node(node: _Node, origin: Origin, path: KeyPath, key_line: int) -> Located:
    value = node.value
    if isinstance(value, dict):
        value = {key: _locate_node(child, origin, (*path, key), node.key_lines[key]) for key, child in value.items()}
    elif isinstance(value, list):
        value = [_locate_node(child, origin, (*path, index), child.line) for index, child in enumerate(value)]
    return Located(value, origin, path, node.line, key_line or node.line)


def _locate_plain(data: Any, origin: Origin, path: KeyPath) -> Located:
    if len(path) > MAX_DEPTH:
        raise origin.error(f"{_where(origin, 0, path[:4])}: nested deeper than {MAX_DEPTH} levels")
    if isinstance(data, Mapping):
        wrong = [key for key in data if not isinstance(key, str)]
        if wrong:
            raise origin.error(f"{_where(origin, 0, path)}: key {wrong[0]!r}: keys are text")
        data = {str(key): _locate_plain(child, origin, (*path, str(key))) for key, child in data.items()}
    elif isinstance(data, (list, tuple)):
        data = [_locate_plain(child, origin, (*path, index)) for index, child in enumerate(data)]
    elif isinstance(data, np.generic):
        data = data.item()
    return Located(data, origin, path)

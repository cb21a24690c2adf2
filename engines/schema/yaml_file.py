"""A strict, safe YAML reader that remembers where every value stood; scenes and experiments both use it.

    root = read_yaml("scenes/box.yaml")          # or read_yaml(path, error=ConfigError), or parse_yaml(text, name)
    root.value                                   # dict[str, Located], list[Located], str, int, float, bool or None
    red = root.value["materials"].value["red"]
    red.line, red.key_line, red.path             # 14, 14, ("materials", "red")
    raise red.refuse("must lie in [0, 1]")       # scenes/box.yaml:14 materials.red = 1.4: must lie in [0, 1]
    raise red.unknown_key("kdd", ["kd", "ks"])   # scenes/box.yaml:15 materials.red.kdd: unknown key: ... 'kd' ...
    root.plain()                                 # the same tree as ordinary dicts, lists and scalars
    root.at(("sweep", "engine", 0))              # the value at that path, or the last one on the way that exists
    yaml_text(root.plain())                      # text that reads as the same tree

`locate(data)` gives plain Python data the same shape (no lines; NumPy arrays stay leaves): one loader serves both.

YAML as in the core schema of 1.2: `1e-3` is a number, `yes` and `on` are text, dates are text. Refused with file and
line: duplicate keys, tags other than !!str, keys that are not text, several documents, recursive aliases, and whatever
passes the limits below. Anchors, aliases and `<<` merges work. Nothing here recurses without a cap. PyYAML is imported
where text is read: scenes can be had without it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike, fspath
from typing import TYPE_CHECKING, Any

import numpy as np

from engines.errors import ConfigError, RaybenchError, SceneError, suggestion
from engines.input_files import open_regular, unreadable

if TYPE_CHECKING:
    from yaml.nodes import Node

MAX_BYTES = 16 * 2**20
MAX_DEPTH = 64
WIDTH = 120
"""Characters of a line that is written, as far as it can be broken."""
MAX_SHOWN = 80
"""Characters of a key or value in a message."""

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

    def refuse(self, expected: str) -> RaybenchError:
        """The error to raise for this value: where, what was found (scalars only), what is expected."""
        return self.origin.error(f"{self.where}{_found(self.value)}: {expected}")

    def refuse_key(self, key: str, expected: str) -> RaybenchError:
        """The error to raise about a key of this mapping, at the key's own line and origin."""
        child = self.value.get(key) if isinstance(self.value, dict) else None
        line, origin = (child.key_line, child.origin) if isinstance(child, Located) else (self.line, self.origin)
        return origin.error(f"{_where(origin, line, (*self.path, key))}: {expected}")

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

    from engines.schema.strict_yaml import Refused, StrictComposer

    origin = Origin(name, error)
    try:
        root = StrictComposer(text, MAX_DEPTH).root()
    except yaml.MarkedYAMLError as problem:
        mark = problem.problem_mark or problem.context_mark
        line = mark.line + 1 if mark else 0
        prefix = "" if isinstance(problem, Refused) else "not YAML: "
        raise error(f"{_where(origin, line, ())}: {prefix}{problem.problem or problem.context}") from problem
    except yaml.reader.ReaderError as problem:  # its position counts bytes
        line = text.encode()[: problem.position].count(b"\n") + 1
        raise error(f"{_where(origin, line, ())}: not text: character #x{_code(problem.character):04x}") from problem
    except UnicodeEncodeError as problem:
        line = text[: problem.start].count("\n") + 1
        raise error(f"{_where(origin, line, ())}: not text: character #x{ord(text[problem.start]):04x}") from problem
    except (ValueError, RecursionError, OverflowError) as problem:
        raise error(f"{_where(origin, 0, ())}: not YAML: {problem}") from problem
    if root is None:
        raise error(f"{_where(origin, 1, ())}: empty: a mapping is expected")
    return _locate_node(root, origin, (), 0)


def yaml_text(data: Any, name: str = "") -> str:
    """Text that `parse_yaml` reads as the same data: mappings with keys of text, lists, tuples and scalars. Raises
    `ConfigError` for more values than `parse_yaml` reads; its message calls the file `name`."""
    import yaml

    from engines.schema.strict_yaml import MAX_NODES, Writer

    if (values := _values(data)) > MAX_NODES:
        raise ConfigError(f"{name or 'YAML'}: {values:,} values and keys, of at most {MAX_NODES:,} that are read of a file")
    return yaml.dump(data, Dumper=Writer, sort_keys=False, default_flow_style=None, allow_unicode=True, width=WIDTH)


def _values(data: Any) -> int:
    """How many values and keys the reader counts."""
    if isinstance(data, Mapping):
        return 1 + len(data) + sum(map(_values, data.values()))
    return 1 + sum(map(_values, data)) if isinstance(data, (list, tuple)) else 1


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


# --- from nodes and plain data to Located ---------------------------------------------------------------------------


def _locate_node(node: Node, origin: Origin, path: KeyPath, key_line: int) -> Located:
    line, value = node.start_mark.line + 1, node.value
    if isinstance(value, dict):
        value = {
            name: _locate_node(child, origin, (*path, name), key.start_mark.line + 1) for name, (key, child) in value.items()
        }
    elif isinstance(value, list):
        value = [_locate_node(child, origin, (*path, index), 0) for index, child in enumerate(value)]
    return Located(value, origin, path, line, key_line or line)


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

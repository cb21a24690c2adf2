"""PyYAML made strict: nodes with lines, plain scalars as in the core schema of YAML 1.2, and limits; and its inverse, `Writer`.

Events come from libyaml, which is ten times as fast as PyYAML's own parser. Its loader composes nodes by recursion in C, which
crashes on deep nesting, so nodes are composed here.

It is a module of its own because it needs PyYAML, which only programs that read text load.
"""

from __future__ import annotations

import re
from typing import Any

from yaml.composer import Composer
from yaml.cyaml import CParser  # pyright: ignore[reportAttributeAccessIssue]: of the compiled module
from yaml.dumper import SafeDumper
from yaml.error import Mark, MarkedYAMLError
from yaml.events import AliasEvent, CollectionStartEvent, Event, ScalarEvent, SequenceStartEvent, StreamEndEvent
from yaml.nodes import MappingNode, Node, ScalarNode
from yaml.resolver import BaseResolver

MAX_ALIASES = 1000
MAX_DIGITS = 1000
"""Of a whole number: Python writes no more than 4300 in decimal, and messages show what was found."""
MAX_NODES = 400_000
"""Values in a file, each use of an alias counted in full. Some 150,000 are read in a second."""
NO_ANCHOR: Any = None
STR = "tag:yaml.org,2002:str"


class Refused(MarkedYAMLError):
    """YAML that PyYAML would take and this reader does not; `problem` is the message."""

    def __init__(self, problem: str, mark: Mark) -> None:
        super().__init__(problem=problem, problem_mark=mark)


class StrictComposer(Composer, CParser, BaseResolver):
    """`root()` is the node of a text's one document, or None where it has none.

    `value` of a node is a scalar, a list of nodes, or a dict of (key's node, node) by key, in which the sources of `<<` are
    merged. The work is linear in the text: an alias is the node of its anchor, and counts in full towards the limits.
    """

    def __init__(self, text: str, max_depth: int) -> None:
        CParser.__init__(self, text)
        Composer.__init__(self)
        BaseResolver.__init__(self)
        self.max_depth = max_depth
        self.nodes = self.values = self.aliases = 0
        self.depth = self.deepest = 0
        self.extents: dict[str, tuple[int, int]] = {}
        """By anchor, the values of its node, and the levels of lists and mappings; aliases in full."""

    def root(self) -> Node | None:
        """Raises `yaml.MarkedYAMLError` for text that is not YAML, `Refused` for what is not allowed here."""
        self.get_event()
        node = None if self.check_event(StreamEndEvent) else self.compose_document()
        if not self.check_event(StreamEndEvent):
            raise Refused("a second document begins: expected one", self.peek_event().start_mark)
        return node

    def compose_node(self, parent: Node | None, index: Any) -> Node:
        """The node of the next event. PyYAML asks for a mapping's keys with no index."""
        event = self.peek_event()
        if isinstance(parent, MappingNode) and index is None:
            return self._key(event)
        if isinstance(event, AliasEvent):
            return self._alias(event)
        self._count(event, 1)
        values, deepest, self.deepest = self.values, self.deepest, self.depth
        node = self._scalar(event) if isinstance(event, ScalarEvent) else self._collection(event)
        if event.anchor is not None:  # here, not before its children: so no alias is recursive
            self.anchors[event.anchor] = node
            self.extents[event.anchor] = self.values - values + 1, self.deepest - self.depth
        self.deepest = max(deepest, self.deepest)
        return node

    def _count(self, event: Event, values: int) -> None:
        """Counts an event, and the values that it stands for."""
        self.nodes += 1
        self.values += values
        if self.nodes > MAX_NODES:
            raise Refused(f"more than {MAX_NODES} values: put meshes into files of their own", event.start_mark)
        if self.values > MAX_NODES:
            raise Refused(f"more than {MAX_NODES} values, aliases counted in full", event.start_mark)

    def _alias(self, event: AliasEvent) -> Node:
        self.aliases += 1
        if self.aliases > MAX_ALIASES:
            raise Refused(f"more than {MAX_ALIASES} aliases", event.start_mark)
        if event.anchor not in self.anchors:
            raise Refused(f"alias {event.anchor!r}: no finished anchor of that name stands before it", event.start_mark)
        values, levels = self.extents[event.anchor]
        self._descend(event, levels)
        self.depth -= levels
        self._count(event, values)
        self.get_event()
        return self.anchors[event.anchor]

    def _descend(self, event: Event, levels: int) -> None:
        self.depth += levels
        self.deepest = max(self.deepest, self.depth)
        if self.depth > self.max_depth:
            raise Refused(f"nested deeper than {self.max_depth} levels", event.start_mark)

    def _collection(self, event: CollectionStartEvent) -> Node:
        if event.tag not in (None, "!"):
            raise Refused(f"tag {event.tag!r}: tags are not allowed", event.start_mark)
        self._descend(event, 1)
        is_list = self.check_event(SequenceStartEvent)
        node = self.compose_sequence_node(NO_ANCHOR) if is_list else self.compose_mapping_node(NO_ANCHOR)
        self.depth -= 1
        return node

    def _scalar(self, event: ScalarEvent) -> Node:
        if event.tag not in (None, "!", STR):
            raise Refused(f"tag {event.tag!r}: tags are not allowed", event.start_mark)
        node = self.compose_scalar_node(NO_ANCHOR)
        if event.implicit[0] and event.tag is None:
            try:
                node.value = plain_scalar(event.value)
            except ValueError as problem:
                raise Refused("a number with too many digits", event.start_mark) from problem
        return node

    def _key(self, event: Event) -> Node:
        if not isinstance(event, ScalarEvent):
            raise Refused("keys are text", event.start_mark)
        self._count(event, 0)
        node = self._scalar(event)
        if event.value == "null":
            node.value = event.value
        if not isinstance(node.value, str):
            raise Refused(f"key {node.value!r}: keys are text, write it in quotes", event.start_mark)
        return node

    def compose_mapping_node(self, anchor: Any) -> MappingNode:
        """A mapping without duplicate keys. Of `<<` earlier sources win, and its own keys before all."""
        node = super().compose_mapping_node(anchor)
        children: dict[str, tuple[ScalarNode, Node]] = {}
        for key, child in node.value:
            first = children.setdefault(key.value, (key, child))[0]
            if first is not key:
                lines = f"first in line {line_of(first)}, again in line {line_of(key)}"
                raise Refused(f"{key.value!r} is there twice: {lines}", key.start_mark)
        if "<<" in children and not children["<<"][0].style:  # in quotes it is a key as others are
            key, merged = children.pop("<<")
            for source in merged.value if isinstance(merged.value, list) else [merged]:
                if not isinstance(source.value, dict):
                    raise Refused("<<: expected a mapping or a list of mappings", key.start_mark)
                for name, pair in source.value.items():
                    children.setdefault(name, pair)
        node.value = children
        return node


def line_of(node: Node) -> int:
    """The line where a node begins, counted from 1."""
    return node.start_mark.line + 1


_INTEGER = re.compile(r"[-+]?[0-9]+|0x[0-9a-fA-F]+|0o[0-7]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_WORDS: dict[str, Any] = {"": None, "~": None}
_WORDS |= {form: None for form in ("null", "Null", "NULL")}
_WORDS |= {form: True for form in ("true", "True", "TRUE")} | {form: False for form in ("false", "False", "FALSE")}
_WORDS |= {sign + form: float(sign + "inf") for sign in ("", "+", "-") for form in (".inf", ".Inf", ".INF")}
_WORDS |= {form: float("nan") for form in (".nan", ".NaN", ".NAN")}


def plain_scalar(text: str) -> Any:
    """What a plain scalar means in YAML 1.2's core schema."""
    if text in _WORDS:
        return _WORDS[text]
    if _INTEGER.fullmatch(text):
        if len(text) > MAX_DIGITS:
            raise ValueError
        return int(text, 0 if text[:2] in ("0x", "0o") else 10)
    return float(text) if _FLOAT.fullmatch(text) else text


_TAGS = {type(None): "null", bool: "bool", int: "int", float: "float"}
"""Last words of the tags of PyYAML, by the type of a plain scalar that is not text."""


class Writer(SafeDumper):
    """PyYAML's dumper made the inverse of the reader: text that it would read as something else stands in quotes. So does what
    YAML 1.1 takes for something else, such as `yes`, for other readers.

    What stands twice in the data is written twice, without aliases.
    """

    def resolve(self, kind: type[Node], value: Any, implicit: Any) -> str:
        """The tag that a plain scalar has for the reader."""
        if kind is ScalarNode and implicit[0]:
            try:
                found = type(plain_scalar(value))
            except ValueError:  # too many digits
                found = int
            if found in _TAGS:
                return f"tag:yaml.org,2002:{_TAGS[found]}"
        return super().resolve(kind, value, implicit)

    def ignore_aliases(self, data: Any) -> bool:
        return True

    def represent_str(self, data: str) -> ScalarNode:
        """In double quotes where it has line breaks, which PyYAML would fold, and some of them lose."""
        style = None if data.splitlines() in ([], [data]) else '"'
        return self.represent_scalar("tag:yaml.org,2002:str", data, style)


Writer.add_representer(str, Writer.represent_str)

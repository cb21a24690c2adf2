"""Damage to files, drawn from a seeded `random.Random`: to trees of plain data, to bytes and to lines of text."""

from __future__ import annotations

import copy
import math
import re
import struct
from collections.abc import Callable, Sequence
from random import Random
from typing import Any

COUNTS = (1, 1, 1, 2, 3)
"""Damages to a file."""
HEAD = 300
"""Bytes in which formats keep their counts and sizes: half of the damage goes there."""
NEVER_RIGHT: list[Any] = [math.nan, math.inf, -math.inf, {"x": {"y": 1}}, [[[]]], "\0text", 10**400, [1, 2, 3, 4]]
"""Values that no key of a scene takes."""
WRONG: list[Any] = [
    *NEVER_RIGHT,
    -1,
    0,
    1.5,
    1e308,
    -5e-324,
    2**31,
    2**70,
    True,
    None,
    "",
    "x",
    "9" * 400,
    "numba",
    "../../etc/passwd",
    "/dev/zero",
    "a:b",
    "\x07",
    "two\nlines",
    "\x1b[31m",
    "ö\u2028",
    [],
    [[]],
    {},
    [1, [2, {"a": 3}]],
    {"name": "grid", "name2": 1},
    "1e400s",
    "*.yaml",
]
"""Values that are wrong in many places."""
NUMBERS = [
    "nan",
    "inf",
    "-inf",
    "1e999",
    "1e308",
    "-1e-320",
    "-1",
    "0",
    "1",
    "2",
    "0.5",
    "4294967296",
    "9" * 400,
    "0x10",
    "1_0",
    "",
]
SYNTAX = [
    "\\",
    "#",
    "x",
    "\t",
    "\0",
    "é",
    "/",
    "//",
    "1//",
    "../../etc/passwd",
    "*a",
    "&a",
    "<<:",
    "{",
    "[",
    "---",
    "? ",
    "| ",
    "!!python/object/apply:os.system",
    "'",
    '"',
    "%YAML 1.1",
    "\u2028",
    "\r",
]
"""Words that stand somewhere wrong, or anywhere."""
_WORD = re.compile(r"[^\s,:\[\]{}/]+")
EXTREMES = (0, 1, 255, 256, 65_535, 2**31 - 1, 2**31, 2**32 - 1)


def places(data: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The paths of all values in a tree of dicts and lists."""
    children = data.items() if isinstance(data, dict) else enumerate(data) if isinstance(data, list) else ()
    found = [path] if path else []
    return found + [place for key, child in children for place in places(child, (*path, key))]


def parent_of(data: Any, path: Sequence[Any]) -> Any:
    """The dict or list that holds the value at `path`."""
    for step in path[:-1]:
        data = data[step]
    return data


def mutated_tree(random: Random, tree: Any) -> Any:
    """A copy with one to three values replaced, removed, renamed, scaled or taken from elsewhere in it."""
    tree = copy.deepcopy(tree)
    for _ in range(random.choice(COUNTS)):
        found = places(tree)
        if not found:
            break
        path = random.choice(found)
        parent, value = parent_of(tree, path), parent_of(tree, path)[path[-1]]
        way = random.randrange(6)
        if way == 0:
            del parent[path[-1]]
        elif way == 1 and isinstance(parent, dict):
            parent[f"{path[-1]}x"] = parent.pop(path[-1])
        elif way == 2:
            other = random.choice(found)
            parent[path[-1]] = copy.deepcopy(parent_of(tree, other)[other[-1]])
        elif way == 3 and isinstance(value, (int, float)) and abs(value) < 1e300:
            parent[path[-1]] = value * random.choice((-1, 0.5, 2, 1e3, 1e12, 1e-12))
        else:
            parent[path[-1]] = random.choice(WRONG)
    return tree


def scaled_tree(random: Random, tree: Any) -> Any:
    """A copy with one to five numbers made larger or smaller, now and then to the ends of what a double holds."""
    tree = copy.deepcopy(tree)
    found = [path for path in places(tree) if isinstance(parent_of(tree, path)[path[-1]], float)]
    for path in random.sample(found, min(len(found), random.randint(1, 5))):
        factor = 10.0 ** random.choice((random.uniform(-3, 3), random.uniform(-320, 308)))
        parent_of(tree, path)[path[-1]] *= factor * random.choice((1, 1, -1))
    return tree


def mutated_bytes(random: Random, content: bytes) -> bytes:
    """`content` with one to three places damaged."""
    damaged = bytearray(content)
    for _ in range(random.choice(COUNTS)):
        if damaged:
            random.choice(_BYTE_DAMAGE)(random, damaged)
    return bytes(damaged)


def mutated_text(random: Random, text: str) -> str:
    """`text` with one to three words or lines damaged."""
    lines = text.split("\n")
    for _ in range(random.choice(COUNTS)):
        at = random.randrange(len(lines))
        way = random.randrange(6)
        if way == 0 and len(lines) > 1:
            del lines[at]
        elif way == 1:
            lines.insert(random.randrange(len(lines)), lines[at])
        elif way == 2:
            lines[at] += random.choice(SYNTAX)
        else:
            lines[at] = _with_another_word(random, lines[at], text)
    return "\n".join(lines)


def _with_another_word(random: Random, line: str, text: str) -> str:
    """`line` with one word replaced by a number, by what is syntax somewhere, or by another word of `text`."""
    words = list(_WORD.finditer(line))
    start, end = random.choice(words).span() if words else (0, 0)
    other = random.choice((NUMBERS, NUMBERS, SYNTAX, _WORD.findall(text) or [""]))
    return line[:start] + random.choice(other) + line[end:]


def _place(random: Random, damaged: bytearray) -> int:
    return random.randrange(random.choice((min(HEAD, len(damaged)), len(damaged))))


def _flip(random: Random, damaged: bytearray) -> None:
    damaged[_place(random, damaged)] ^= 1 << random.randrange(8)


def _number(random: Random, damaged: bytearray) -> None:
    at = _place(random, damaged)
    size, value = random.choice((2, 4)), random.choice(EXTREMES)
    form = random.choice("<>") + ("H" if size == 2 else "I")
    damaged[at : at + size] = struct.pack(form, value % 256**size)


def _cut(random: Random, damaged: bytearray) -> None:
    del damaged[_place(random, damaged) :]


def _remove(random: Random, damaged: bytearray) -> None:
    at = _place(random, damaged)
    del damaged[at : at + random.choice((1, 4, 100))]


def _repeat(random: Random, damaged: bytearray) -> None:
    at = _place(random, damaged)
    damaged[at:at] = damaged[at : at + random.choice((1, 16, 1000))]


def _insert(random: Random, damaged: bytearray) -> None:
    at = _place(random, damaged)
    damaged[at:at] = random.choice(NUMBERS + SYNTAX).encode() or random.randbytes(8)


_BYTE_DAMAGE: tuple[Callable[[Random, bytearray], None], ...] = (
    _flip,
    _flip,
    _flip,
    _number,
    _number,
    _cut,
    _remove,
    _repeat,
    _insert,
)

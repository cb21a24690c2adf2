"""What tests read of a pbrt file: there is no pbrt here, so its text is held to pbrt's grammar."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import numpy as np

KINDS = {"float", "integer", "string", "rgb", "point2", "point3", "bool", "texture"}
"""Of the parameters that are written."""
MADE = {"MakeNamedMaterial": "material", "MakeNamedMedium": "medium", "Texture": "texture"}


def directives(text: str) -> Iterator[tuple[str, list[str]]]:
    """(word, arguments) of every directive of a pbrt file, a directive a line."""
    for line in text.splitlines():
        words = shlex.split(line.replace("[", " [ ").replace("]", " ] "))
        yield words[0], words[1:]


def parameters(line: str) -> dict[str, list[str]]:
    """The values of a directive's parameters by name, with their kinds before the names."""
    return {found[0]: shlex.split(found[1]) for found in re.findall(r'"(\w+ \w+)" \[ (.+?) \]', line)}


def check(file: Path) -> str:
    """The text of a file of which every name is made before it is used, every file exists, and every number is finite."""
    text = file.read_text()
    found = list(directives(text))
    words = [word for word, _ in found]
    assert words.count("WorldBegin") == 1
    assert words.count("AttributeBegin") == words.count("AttributeEnd") == words.count("Shape")
    made: dict[str, set[str]] = {kind: set() for kind in MADE.values()}
    for word, arguments in found:
        if word in MADE:
            assert arguments[0] not in made[MADE[word]]
            made[MADE[word]].add(arguments[0])
        elif word == "NamedMaterial":
            assert arguments[0] in made["material"]
        elif word == "MediumInterface":
            assert len(arguments) == 2 and set(arguments) <= made["medium"] | {""}
    for line in text.splitlines():
        for typed, values in parameters(line).items():
            kind, name = typed.split()
            assert kind in KINDS
            if kind in ("float", "rgb", "point2", "point3"):
                assert np.isfinite([float(value) for value in values]).all()
            if kind in ("rgb", "point3"):
                assert len(values) % 3 == 0
            if kind == "texture":
                assert values[0] in made["texture"]
            if name == "filename" and not line.startswith("Film"):
                assert (file.parent / values[0]).is_file()
    return text

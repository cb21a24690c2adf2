"""Wavefront OBJ text: vertices, polygons cut into fans, vertex normals, and which material each face has.

Negative indices count back from the vertices read so far. Texture coordinates, lines, points, groups and curves are
left aside. A fan is right for convex polygons; a concave one must be triangulated before.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from engines.errors import SceneError
from engines.scene.geometry import fans

AtLine = Callable[[int, str], SceneError]
"""Makes the error for a line, counted from 1."""


@dataclass(frozen=True, slots=True)
class Polygons:
    """`vertices` (n, 3); `faces` (m, 3) and, where every corner has one, `face_normals` (m, 3) into `normals`;
    `face_materials` (m,) into `material_names`, where "" stands for faces before the first usemtl."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    normals: NDArray[np.float64]
    face_normals: NDArray[np.int32] | None
    face_materials: NDArray[np.int32]
    material_names: list[str]
    libraries: list[str]


@dataclass(slots=True)
class _Statements:
    """The arguments of every statement of a kind, and their lines."""

    text: list[str] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)


def parse_obj(text: str, at_line: AtLine) -> Polygons:
    """Raises what `at_line` makes for numbers that are none, indices out of range, and files without faces."""
    kinds = {"v": _Statements(), "vn": _Statements(), "f": _Statements(), "usemtl": _Statements()}
    libraries: dict[str, None] = {}
    for number, line in _whole_lines(text.replace("\r\n", "\n").replace("\r", "\n")):
        parts = line.split(None, 1)
        if len(parts) == 2:
            if parts[0] in kinds:
                statements = kinds[parts[0]]
                statements.text.append(parts[1])
                statements.lines.append(number)
            elif parts[0] == "mtllib":
                libraries[parts[1].strip()] = None
    if not kinds["f"].text:
        raise at_line(1, "not an OBJ file with faces")
    vertices, normals = _rows(kinds["v"], at_line), _rows(kinds["vn"], at_line)
    finite = np.isfinite(vertices).all(axis=1)
    if not finite.all():
        wrong = int(np.argmin(finite))
        raise at_line(kinds["v"].lines[wrong], f"{_shown(kinds['v'].text[wrong])}: finite numbers are wanted")
    corners, corner_normals, counts = _corners(kinds["f"], at_line)
    lines = np.repeat(np.array(kinds["f"].lines), counts)
    corners = _absolute(corners, lines, kinds["v"].lines, "vertex", at_line)
    fan, face_of_triangle = fans(counts)
    face_normals = None
    if corner_normals is not None:
        face_normals = _absolute(corner_normals, lines, kinds["vn"].lines, "normal", at_line)[fan]
    materials, names = _materials(kinds["usemtl"], kinds["f"].lines)
    return Polygons(
        vertices, corners[fan], normals, face_normals, materials[face_of_triangle], names, list(libraries)
    )  # fmt: skip


def _whole_lines(text: str) -> Iterator[tuple[int, str]]:
    """Lines, each with the number of its first, where a backslash at the end has the next one continue it."""
    lines = text.split("\n")
    if "\\\n" not in text:
        yield from enumerate(lines, 1)
        return
    parts: list[str] = []
    for number, line in enumerate(lines, 1):
        continued = line.endswith("\\") and number < len(lines)
        parts.append(line[:-1] if continued else line)
        if not continued:
            yield number - len(parts) + 1, " ".join(parts)
            parts = []


def _rows(statements: _Statements, at_line: AtLine) -> NDArray[np.float64]:
    """(n, 3): the first three numbers of each statement; a weight or a colour may follow."""
    lines = _without_comments(statements.text)
    counts = {len(line.split()) for line in lines}
    try:
        if counts and min(counts) < 3:
            raise ValueError
        if len(counts) == 1:  # without a list for each line: three times as fast for large files
            return np.array(list(map(float, " ".join(lines).split()))).reshape(len(lines), -1)[:, :3]
        return np.array([list(map(float, line.split()[:3])) for line in lines], np.float64).reshape(-1, 3)
    except ValueError:
        wrong = next(i for i, line in enumerate(lines) if len(line.split()) < 3 or not _are_numbers(line.split()))
        raise at_line(statements.lines[wrong], f"{_shown(statements.text[wrong])}: three numbers are wanted") from None


def _shown(text: str) -> str:
    return repr(text.strip()[:80])


def _without_comments(lines: list[str]) -> list[str]:
    return [line.split("#", 1)[0] if "#" in line else line for line in lines]


def _are_numbers(tokens: list[str]) -> bool:
    try:
        return all(float(token) is not None for token in tokens)
    except ValueError:
        return False


def _corners(
    faces: _Statements, at_line: AtLine
) -> tuple[NDArray[np.int64], NDArray[np.int64] | None, NDArray[np.int64]]:
    """Indices of vertices and (where all corners have them) of normals as written, and the corners of each face."""
    lines = _without_comments(faces.text)
    counts = np.array([len(line.split()) for line in lines], np.int64)
    if (counts < 3).any():
        raise at_line(faces.lines[int(np.argmax(counts < 3))], "a face wants at least three corners")
    joined = " ".join(lines)
    try:
        vertices, normals = _corner_numbers(joined)
    except (ValueError, OverflowError):
        wrong = next(i for i, line in enumerate(lines) if not all(map(_is_corner, line.split())))
        raise at_line(faces.lines[wrong], f"{_shown(faces.text[wrong])}: not a list of corners") from None
    return vertices, normals, counts


def _corner_numbers(text: str) -> tuple[NDArray[np.int64], NDArray[np.int64] | None]:
    """The vertex and, where all have one, the normal of corners written `v`, `v/t`, `v//n` or `v/t/n`."""
    if "/" not in text:
        return np.array(list(map(int, text.split())), np.int64), None
    corners = text.replace("//", "/0/").split()
    slashes = {corner.count("/") for corner in corners}
    if max(slashes) > 2:
        raise ValueError
    if slashes <= {2} and not any(corner.endswith("/") for corner in corners):
        table = np.array(list(map(int, " ".join(corners).replace("/", " ").split())), np.int64).reshape(len(corners), 3)
        return table[:, 0], table[:, 2] if table[:, 2].all() else None
    parts = [corner.split("/") for corner in corners]
    vertices = np.array([int(part[0]) for part in parts], np.int64)
    normals = np.array([int(part[2]) if len(part) == 3 and part[2] else 0 for part in parts], np.int64)
    return vertices, normals if normals.all() else None


def _is_corner(token: str) -> bool:
    try:
        parts = token.split("/")
        return len(parts) <= 3 and parts[0] != "" and all(abs(int(part)) < 2**62 for part in parts if part)
    except ValueError:
        return False


def _absolute(
    indices: NDArray[np.int64], lines: NDArray[np.int64], defined: list[int], what: str, at_line: AtLine
) -> NDArray[np.int32]:
    """Indices from 0. `lines` says where each is used, `defined` where the things it counts stand."""
    before = np.searchsorted(np.array(defined, np.int64), lines) if (indices < 0).any() else 0
    found = np.where(indices < 0, indices + before, indices - 1)
    wrong = (found < 0) | (found >= len(defined)) | (indices == 0)
    if wrong.any():
        at = int(np.argmax(wrong))
        raise at_line(int(lines[at]), f"{what} {indices[at]}: there are {len(defined)}, counted from 1")
    return found.astype(np.int32)


def _materials(uses: _Statements, face_lines: list[int]) -> tuple[NDArray[np.int32], list[str]]:
    """The material of each face as an index into the names, in the order of first use; only used names count."""
    names: dict[str, int] = {}
    found = np.zeros(len(face_lines), np.int32)
    starts = [0, *(bisect_left(face_lines, line) for line in uses.lines), len(face_lines)]
    for name, start, end in zip(["", *(text.strip() for text in uses.text)], starts[:-1], starts[1:], strict=True):
        if start < end:
            found[start:end] = names.setdefault(name, len(names))
    return found, list(names)

"""Wavefront OBJ text: vertices, polygons cut into fans, vertex normals, and which material each face has.

Negative indices count back from the vertices read so far. Texture coordinates are read where they are asked for. Lines,
points, groups and curves are left aside. A fan is right for convex polygons; a concave one must be triangulated before.
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
    """`vertices` (n, 3); `faces` (m, 3) and, where any corner has one, `face_normals` (m, 3) into `normals`, whose last row is
    zeros, for the corners without;
    `face_materials` (m,) into `material_names`, where "" stands for faces before the first usemtl."""

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    normals: NDArray[np.float64]
    face_normals: NDArray[np.int32] | None
    face_materials: NDArray[np.int32]
    material_names: list[str]
    libraries: list[str]
    texture: TextureCorners | None


@dataclass(slots=True)
class _Statements:
    """The arguments of every statement of a kind, and their lines."""

    text: list[str] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)


@dataclass(frozen=True, slots=True)
class TextureCorners:
    """The texture coordinates of an OBJ file as they stand there: `corners` (k,) indices of the corners of its faces, 0 where
    a corner has none, `lines` (k,) theirs, and `fan` (m, 3) the corners of each triangle."""

    statements: _Statements
    corners: NDArray[np.int64]
    lines: NDArray[np.int64]
    fan: NDArray[np.int64]

    def read(self, at_line: AtLine) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """(n, 2) coordinates and (m, 3) indices of them; the last is (0, 0), for corners without. Raises as `parse_obj`."""
        coordinates = _rows(self.statements, at_line, 1, 2)
        places = _where_given(self.corners, self.lines, self.statements.lines, "texture coordinate", at_line)
        return np.concatenate([coordinates, np.zeros((1, 2))]), places[self.fan]


def parse_obj(text: str, at_line: AtLine) -> Polygons:
    """Raises what `at_line` makes for numbers that are none, indices out of range, and files without faces."""
    kinds = {"v": _Statements(), "vn": _Statements(), "vt": _Statements(), "f": _Statements(), "usemtl": _Statements()}
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
    vertices = _rows(kinds["v"], at_line)
    normals = np.concatenate([_rows(kinds["vn"], at_line), np.zeros((1, 3))])
    finite = np.isfinite(vertices).all(axis=1)
    if not finite.all():
        wrong = int(np.argmin(finite))
        raise at_line(kinds["v"].lines[wrong], f"{_shown(kinds['v'].text[wrong])}: finite numbers are expected")
    corners, corner_uvs, corner_normals, counts = _corners(kinds["f"], at_line)
    lines = np.repeat(np.array(kinds["f"].lines), counts)
    corners = _absolute(corners, lines, kinds["v"].lines, "vertex", at_line)
    fan, face_of_triangle = fans(counts)
    face_normals = None
    if corner_normals is not None:
        face_normals = _where_given(corner_normals, lines, kinds["vn"].lines, "normal", at_line)[fan]
    materials, names = _materials(kinds["usemtl"], kinds["f"].lines)
    texture = None if corner_uvs is None else TextureCorners(kinds["vt"], corner_uvs, lines, fan)
    return Polygons(vertices, corners[fan], normals, face_normals, materials[face_of_triangle], names, list(libraries), texture)


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


def _rows(statements: _Statements, at_line: AtLine, least: int = 3, most: int = 3) -> NDArray[np.float64]:
    """(n, most): the first numbers of each statement, at least `least`, the others 0; a weight or a colour may follow."""
    lines = _without_comments(statements.text)
    counts = {len(line.split()) for line in lines}
    try:
        if counts and min(counts) < least:
            raise ValueError
        if len(counts) == 1 and min(counts) >= most:  # without a list for each line: three times as fast for large files
            return np.array(list(map(float, " ".join(lines).split()))).reshape(len(lines), -1)[:, :most]
        rows = (line.split()[:most] for line in lines)
        return np.array([list(map(float, row)) + [0.0] * (most - len(row)) for row in rows], np.float64).reshape(-1, most)
    except ValueError:
        wrong = next(i for i, line in enumerate(lines) if len(line.split()) < least or not _are_numbers(line.split()))
        expected = "three numbers are expected" if most == 3 else "numbers are expected"
        raise at_line(statements.lines[wrong], f"{_shown(statements.text[wrong])}: {expected}") from None


def _shown(text: str) -> str:
    return repr(text.strip()[:80])


def _without_comments(lines: list[str]) -> list[str]:
    return [line.split("#", 1)[0] if "#" in line else line for line in lines]


def _are_numbers(tokens: list[str]) -> bool:
    try:
        return all(float(token) is not None for token in tokens)
    except ValueError:
        return False


Numbers = NDArray[np.int64]


def _corners(faces: _Statements, at_line: AtLine) -> tuple[Numbers, Numbers | None, Numbers | None, Numbers]:
    """Indices of vertices, of texture coordinates and of normals as written, 0 where a corner has none and None where none
    has one, and the corners of each face."""
    lines = _without_comments(faces.text)
    counts = np.array([len(line.split()) for line in lines], np.int64)
    if (counts < 3).any():
        raise at_line(faces.lines[int(np.argmax(counts < 3))], "a face wants at least three corners")
    joined = " ".join(lines)
    try:
        vertices, uvs, normals = _corner_numbers(joined)
    except (ValueError, OverflowError):
        wrong = next(i for i, line in enumerate(lines) if not all(map(_is_corner, line.split())))
        raise at_line(faces.lines[wrong], f"{_shown(faces.text[wrong])}: not a list of corners") from None
    return vertices, uvs, normals, counts


def _corner_numbers(text: str) -> tuple[Numbers, Numbers | None, Numbers | None]:
    """The vertex, and where any has one the texture coordinate and the normal, of corners written `v`, `v/t`, `v//n` or
    `v/t/n`."""
    if "/" not in text:
        return np.array(list(map(int, text.split())), np.int64), None, None
    corners = text.replace("//", "/0/").split()
    slashes = {corner.count("/") for corner in corners}
    if max(slashes) > 2:
        raise ValueError
    if len(slashes) == 1 and not any(corner.endswith("/") for corner in corners):
        table = np.array(list(map(int, " ".join(corners).replace("/", " ").split())), np.int64)
        table = table.reshape(len(corners), slashes.pop() + 1)
    else:
        parts = [(*corner.split("/"), "", "")[:3] for corner in corners]
        table = np.array([[int(part[0]), int(part[1] or 0), int(part[2] or 0)] for part in parts], np.int64)
    normals = table[:, 2] if table.shape[1] == 3 else np.zeros(1, np.int64)
    return table[:, 0], table[:, 1] if table[:, 1].any() else None, normals if normals.any() else None


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
    absolute = np.where(indices < 0, indices + before, indices - 1)
    wrong = (absolute < 0) | (absolute >= len(defined)) | (indices == 0)
    if wrong.any():
        at = int(np.argmax(wrong))
        raise at_line(int(lines[at]), f"{what} {indices[at]}: there are {len(defined)}, counted from 1")
    return absolute.astype(np.int32)


def _where_given(
    indices: NDArray[np.int64], lines: NDArray[np.int64], defined: list[int], what: str, at_line: AtLine
) -> NDArray[np.int32]:
    """Indices from 0, and the number of things where a corner has none."""
    absolute = np.full(len(indices), len(defined), np.int32)
    given = indices != 0
    absolute[given] = _absolute(indices[given], lines[given], defined, what, at_line)
    return absolute


def _materials(uses: _Statements, face_lines: list[int]) -> tuple[NDArray[np.int32], list[str]]:
    """The material of each face as an index into the names, in the order of first use; only used names count."""
    names: dict[str, int] = {}
    materials = np.zeros(len(face_lines), np.int32)
    starts = [0, *(bisect_left(face_lines, line) for line in uses.lines), len(face_lines)]
    for name, start, end in zip(["", *(text.strip() for text in uses.text)], starts[:-1], starts[1:], strict=True):
        if start < end:
            materials[start:end] = names.setdefault(name, len(names))
    return materials, list(names)

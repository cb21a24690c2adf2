"""Meshes as PLY: text and binary files are read, with polygons of any length; binary files of triangles are written.

The format is that of Turk 1994, *The PLY polygon file format*: a header that lists elements with their properties, then the
rows of each element. Properties that are no part of a mesh are read over.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.scene.attributes import FACE, VERTEX, Attributes
from engines.scene.formats import FileMesh
from engines.scene.geometry import fans

UNIT_NORMALS = b"comment raybench: normals are of length 1"
"""A file with this line was written here: its normals are kept to the last bit."""
TYPES = {
    **{"char": "i1", "uchar": "u1", "short": "i2", "ushort": "u2", "int": "i4", "uint": "u4", "float": "f4", "double": "f8"},
    **{"int8": "i1", "uint8": "u1", "int16": "i2", "uint16": "u2", "int32": "i4", "uint32": "u4"},
    **{"int64": "i8", "uint64": "u8", "float16": "f2", "float32": "f4", "float64": "f8"},
}
BYTE_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
MOST_LINES = 10_000
"""Of a header."""
CORNERS = ("vertex_index", "vertex_indices")
UVS = (("u", "v"), ("s", "t"), ("texture_u", "texture_v"), ("texture_s", "texture_t"))
COLORS = (("r", "g", "b", "a"), ("red", "green", "blue", "alpha"))
SUFFIXES = {("x", "y", "z", "w"): "", ("r", "g", "b", "a"): "_color", ("0", "1", "2", "3"): "", ("1", "2", "3", "4"): ""}
"""Last parts of the names of an attribute's properties, and what its own name ends with."""
CUT_SHORT = "it is cut short"


class Property(NamedTuple):
    """A number of each row or, with a `count_type`, a list of numbers after their count. Types are NumPy's, such as `f4`."""

    name: str
    type: str
    count_type: str = ""


class Element(NamedTuple):
    """A table of `rows` rows."""

    name: str
    rows: int
    properties: list[Property]


class Column(NamedTuple):
    """A property of all rows: a number of each or, with their lengths `counts`, the numbers of all lists in a row."""

    property: Property
    values: NDArray[Any]
    counts: NDArray[np.int64] | None = None

    def read(self) -> NDArray[Any]:
        """The numbers, as of the type that the header says: a text may hold any."""
        with np.errstate(invalid="ignore", over="ignore"):
            numbers = self.values.astype(self.property.type)
        if numbers.dtype.kind in "iu" and (numbers != self.values).any():
            raise ValueError(f"property {self.property.name!r} holds a number that its type does not have")
        return numbers


Columns = dict[str, Column]


def parse_ply(data: bytes) -> FileMesh:
    """The mesh of a PLY file, polygons cut into fans. Raises `ValueError` for what is none, or is longer or shorter than its
    header says."""
    elements, order, start = _header(data)
    body = memoryview(data)[start:] if order else parse_numbers(data[start:]).view(np.uint8).data
    tables: dict[str, Columns] = {}
    place = 0
    for element in elements:
        tables[element.name], place = _table(element, body, place, order)
    if place != len(body):
        raise ValueError("more data follow than its header says")
    return _mesh(tables, UNIT_NORMALS in data[:start])


def _header(data: bytes) -> tuple[list[Element], str, int]:
    """The elements, the order of bytes (none for a text), and where the header ends."""
    if data[:3].lower() != b"ply":
        raise ValueError("it does not begin with 'ply'")
    elements: list[Element] = []
    order, place, line = None, data.find(b"\n") + 1, []
    for _ in range(MOST_LINES):
        end = data.find(b"\n", place)
        line, place = data[place : max(end, place)].decode("latin-1").split(), end + 1
        if end < 0 or line == ["end_header"]:
            break
        match line:
            case [] | ["comment" | "obj_info", *_]:
                pass
            case ["format", name, _] if name in BYTE_ORDERS:
                order = BYTE_ORDERS[name]
            case ["element", name, rows] if rows.isdecimal() and len(rows) < 19 and all(each.name != name for each in elements):
                elements.append(Element(name, int(rows), []))
            case ["property", *_, name] if elements and any(each.name == name for each in elements[-1].properties):
                raise ValueError(f"its header has the property {name[:80]!r} of {elements[-1].name} twice")
            case ["property", type_, name] if elements and type_ in TYPES:
                elements[-1].properties.append(Property(name, TYPES[type_]))
            case ["property", "list", count, type_, name] if elements and count in TYPES and type_ in TYPES:
                elements[-1].properties.append(Property(name, TYPES[type_], TYPES[count]))
            case _:
                raise ValueError(f"its header has the line {' '.join(line)[:80]!r}")
    if place == 0 or line != ["end_header"] or order is None:
        raise ValueError("its header lacks 'format' or 'end_header'")
    return elements, order, place


def parse_numbers(text: bytes) -> NDArray[np.float64]:
    """All numbers of a text, between blanks. Raises `ValueError` where it holds anything else."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)
        try:
            return np.fromstring(text, np.float64, sep=" ")
        except (DeprecationWarning, ValueError) as problem:
            raise ValueError("it holds what is no number") from problem


def _table(element: Element, body: memoryview, place: int, order: str) -> tuple[Columns, int]:
    """The columns of an element whose rows begin at `place`, and where they end. The numbers of a text are all float64."""
    properties = element.properties
    types = [np.dtype(order + each.type if order else "f8") for each in properties]
    counts = [np.dtype(order + each.count_type if order else "f8") if each.count_type else None for each in properties]
    if element.rows == 0 or not types:
        return {each.name: Column(each, np.zeros(0, each.type), np.zeros(0, np.int64)) for each in properties}, place
    row: list[Any] = []  # as the first one is: in most files all lists are of one length
    lengths, end = [], place
    for index, (dtype, count) in enumerate(zip(types, counts, strict=True)):
        lengths.append(1 if count is None else _length(body, end, count))
        row += [(f"count{index}", count or "V0"), (f"values{index}", dtype, (lengths[-1],))]
        end += (count.itemsize if count else 0) + lengths[-1] * dtype.itemsize
        if end > len(body):
            raise ValueError(CUT_SHORT)
    end = place + element.rows * (end - place)
    if end <= len(body):
        table = np.frombuffer(body, row, element.rows, place)
        if all(count is None or (table[f"count{i}"] == lengths[i]).all() for i, count in enumerate(counts)):
            columns = [
                Column(each, table[f"values{i}"].reshape(-1), np.full(element.rows, lengths[i]) if each.count_type else None)
                for i, each in enumerate(properties)
            ]
            return {column.property.name: column for column in columns}, end
    return _table_of_uneven_rows(element, body, place, types, counts)


def _table_of_uneven_rows(
    element: Element, body: memoryview, place: int, types: Sequence[np.dtype], counts: Sequence[np.dtype | None]
) -> tuple[Columns, int]:
    """As `_table`, row by row."""
    parts: list[list[memoryview]] = [[] for _ in types]
    lengths: list[list[int]] = [[] for _ in types]
    for _ in range(element.rows):
        for index, (dtype, count) in enumerate(zip(types, counts, strict=True)):
            length = 1 if count is None else _length(body, place, count)
            start = place + (count.itemsize if count else 0)
            place = start + length * dtype.itemsize
            if place > len(body):
                raise ValueError(CUT_SHORT)
            parts[index].append(body[start:place])
            lengths[index].append(length)
    return {
        each.name: Column(
            each, np.frombuffer(b"".join(parts[i]), types[i]), np.array(lengths[i], np.int64) if each.count_type else None
        )
        for i, each in enumerate(element.properties)
    }, place


def _length(body: memoryview, place: int, dtype: np.dtype) -> int:
    """The length of a list, which stands before it."""
    if place + dtype.itemsize > len(body):
        raise ValueError(CUT_SHORT)
    length = np.frombuffer(body, dtype, 1, place)[0]
    if not (length >= 0 and length == np.floor(length) and length < 2**62):
        raise ValueError(f"it has a list of length {length}")
    return int(length)


def _mesh(tables: Mapping[str, Columns], exact: bool) -> FileMesh:
    vertex, face = tables.get("vertex", {}), tables.get("face", {})
    vertices = _columns(vertex, ("x", "y", "z"))
    if vertices is None:
        raise ValueError("its vertices have no x, y and z")
    lists = {name: column for name, column in face.items() if column.property.count_type}
    names = [name for name in (*CORNERS, *lists) if name in lists]
    faces, polygon = _triangles(lists[names[0]]) if names else (np.zeros((0, 3), np.int64), slice(None))
    uvs = next((columns for pair in UVS if (columns := _columns(vertex, pair)) is not None), None)
    materials = face["material"].read().astype(np.int32)[polygon] if "material" in face and "material" not in lists else None
    of_faces = {name: found if isinstance(found, str) else found[polygon] for name, found in _attributes("face", face).items()}
    attributes = _attributes("vertex", vertex) | of_faces
    return FileMesh(vertices, faces, _columns(vertex, ("nx", "ny", "nz")), uvs, materials, exact, attributes)


def _attributes(of: str, columns: Columns) -> dict[str, NDArray[np.float32] | str]:
    """The attributes of vertices or faces, named as Mitsuba names them: `r, g, b` is vertex_color, `foo_r, foo_g, foo_b`
    vertex_foo_color, `foo_x, foo_y, foo_z` or `foo_0` vertex_foo. Of those that cannot be used, why."""
    found: dict[str, NDArray[np.float32] | str] = {}
    names = [name for name, column in columns.items() if not column.property.count_type]
    color = next((each for each in COLORS if {*each[:3]} <= {*names}), ())
    if color:
        found[f"{of}_color"] = _attribute([columns[name] for name in color if name in columns])
    met = {""}
    for stem, group in groupby(names, lambda name: name.rpartition("_")[0]):
        own = [*group]
        last = tuple(name.rpartition("_")[2] for name in own)
        ending = next((ending for sequence, ending in SUFFIXES.items() if sequence[: len(last)] == last), None)
        if stem not in met and ending is not None:
            found.setdefault(f"{of}_{stem}{ending}", _attribute([columns[name] for name in own]))
        met.add(stem)
    return found


def _attribute(columns: Sequence[Column]) -> NDArray[np.float32] | str:
    if len(columns) not in (1, 3):
        return f"has {len(columns)} numbers, where 1 or 3 are expected"
    if any(np.dtype(column.property.type).kind != "f" for column in columns):
        return "has integers, where floats in [0, 1] are expected"
    with np.errstate(over="ignore"):
        return np.stack([column.read() for column in columns], axis=1).astype(np.float32)


def _columns(columns: Columns, names: Sequence[str]) -> NDArray[np.float64] | None:
    """(n, k) the numbers of these properties, or None where one is missing."""
    if any(name not in columns or columns[name].property.count_type for name in names):
        return None
    return np.stack([columns[name].read() for name in names], axis=1, dtype=np.float64)


def _triangles(corners: Column) -> tuple[NDArray[Any], Any]:
    """(m, 3) the indices of the corners, and which polygon each triangle is of, as an index."""
    indices, counts = corners.read(), corners.counts
    if counts is None or len(counts) == 0:
        return np.zeros((0, 3), np.int64), slice(None)
    if counts.max() < 3 or indices.dtype.kind not in "iu":
        raise ValueError("its faces are no polygons")
    if counts.min() == counts.max() == 3:
        return indices.reshape(-1, 3), slice(None)
    places, polygon = fans(counts)
    return indices[places], polygon


def write_ply(
    path: Path,
    vertices: NDArray[np.floating],
    faces: NDArray[np.integer],
    normals: NDArray[np.floating] | None = None,
    uvs: NDArray[np.floating] | None = None,
    face_materials: NDArray[np.int32] | None = None,
    exact: bool = False,
    attributes: Attributes | None = None,
) -> None:
    """Writes a file of triangles: `vertices` (n, 3), `normals` (n, 3) and texture coordinates (n, 2), of each of the `faces`
    (m, 3) its vertices and, where given, its material; and attributes of both.

    Numbers are float32, the precision in which other renderers read them; float64 with `exact`, whose normals raybench then
    reads to the last bit. Raises `OSError`.
    """
    columns = [vertices, *([] if normals is None else [normals]), *([] if uvs is None else [uvs])]
    names = ["x", "y", "z", *([] if normals is None else ["nx", "ny", "nz"]), *([] if uvs is None else ["u", "v"])]
    kind, real = ("double", "<f8") if exact else ("float", "<f4")
    attributes = attributes or {}
    of_vertices = {name: values for name, values in attributes.items() if name.startswith(VERTEX)}
    of_faces = {name: values for name, values in attributes.items() if name.startswith(FACE)}
    columns += of_vertices.values()
    names += [each for name, values in of_vertices.items() for each in _properties(name[len(VERTEX) :], values.shape[1])]
    lines = [b"ply", b"format binary_little_endian 1.0", *([UNIT_NORMALS] if exact else [])]
    lines += [f"element vertex {len(vertices)}".encode(), *(f"property {kind} {name}".encode() for name in names)]
    lines += [f"element face {len(faces)}".encode(), b"property list uchar int vertex_indices"]
    row = [("count", "u1"), ("corners", "<i4", 3)]
    if face_materials is not None:
        lines += [b"property int material"]
        row += [("material", "<i4")]
    for index, (name, values) in enumerate(of_faces.items()):
        lines += [f"property float {each}".encode() for each in _properties(name[len(FACE) :], values.shape[1])]
        row += [(f"attribute{index}", "<f4", values.shape[1:])]
    table = np.zeros(len(faces), row)
    for index, values in enumerate(of_faces.values()):
        table[f"attribute{index}"] = values
    table["count"], table["corners"] = 3, faces
    if face_materials is not None:
        table["material"] = face_materials
    with path.open("wb") as file:
        file.write(b"\n".join([*lines, b"end_header", b""]))
        file.write(np.concatenate(columns, axis=1).astype(real).tobytes())
        file.write(table.tobytes())


def _properties(name: str, count: int) -> list[str]:
    """The properties that are read as an attribute with this name, less what it begins with."""
    return [*COLORS[0][:3]] if (name, count) == ("color", 3) else [f"{name}_{number}" for number in range(count)]

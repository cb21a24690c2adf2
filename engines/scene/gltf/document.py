"""A glTF file as JSON values with their places, and the bytes and numbers of its buffers.

A reader of our own: pygltflib takes 7 s for a megabyte of JSON, makes numbers of texts and integers of fractions, sets
attributes that a file names, and says of no mistake where it is; trimesh leaves most material extensions and all lights out.
However often an item is named, it is read once: time and memory stay in proportion to the bytes of the files, and to fixed
numbers beyond them.
"""

from __future__ import annotations

import binascii
import json
import math
import os
import re
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from engines.errors import RaybenchError, SceneError
from engines.input_files import open_regular, unreadable
from engines.memory import lacking_memory
from engines.scene.files import Place
from engines.schema import fields
from engines.schema.yaml_file import Located, Origin

DECOMPRESS = "decompress it, such as with gltf-transform's copy command"
TO_PNG = "convert its images to PNG, such as with gltf-transform's ktxdecompress"
"""What helps with files that hold Draco or KTX2."""
MAX_JSON = 16 * 2**20
"""Bytes of JSON without the data URIs in it."""
MAX_GLTF = 256 * 2**20
"""Bytes of a `.gltf` with its data URIs."""
FREE_NUMBERS = 1 << 24
"""Numbers that accessors may have beyond one for each byte of the buffers: they may overlap, or have no bytes at all."""
BYTES_PER_BYTE = 12
"""Memory at the height of reading, for each byte of a buffer."""
COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_DATA_URI = re.compile(rb'"data:(?:[^"\\]|\\.)*+"', re.DOTALL)
_JSON, _BIN = 0x4E4F534A, 0x004E4942


@dataclass(slots=True)
class Document:
    """The JSON of a file, and what of its buffers has been read. `read` counts numbers of accessors, `held` bytes of files, of
    data URIs and of the binary chunk."""

    file: Path
    place: Place
    root: Located
    binary: memoryview | None
    held: int = 0
    read: int = 0
    files: dict[Path, memoryview] = field(default_factory=dict)
    buffers: dict[int, memoryview] = field(default_factory=dict)
    arrays: dict[tuple[int, bool], NDArray[Any]] = field(default_factory=dict)

    def item(self, kind: str, index: Located, parent: Located | None = None) -> Located:
        """The item that a value of the file names, such as `accessors[3]`."""
        every = a_list(parent or self.root, kind)
        number = fields.integer(index, 0, 2**53)
        if number >= len(every.value):
            raise index.refuse(f"there are {len(every.value)} {kind}, counted from 0")
        return mapping(child(every, every.value[number], number))

    def bytes_of(self, node: Located) -> memoryview | None:
        """Of a `uri`, the bytes of the data URI or of the file; None where there is none. Raises `SceneError`."""
        uri = optional(node, "uri")
        if uri is None:
            return None
        text = fields.text(uri)
        if text.startswith("data:"):
            data = _decoded(uri, text)
        else:
            path = self.place.find(uri, unquote(text), self.file.parent)
            if path in self.files:
                return self.files[path]
            data = self.files[path] = memoryview(_contents(path, uri.refuse))
        self.held += len(data)
        return data

    def view(self, node: Located) -> tuple[memoryview, int]:
        """The bytes of the buffer view that is named at `node`, and its stride, 0 where it has none. Raises `SceneError`."""
        view = self.item("bufferViews", node)
        whole = self._buffer(required(view, "buffer"))
        start, length = integer(view, "byteOffset", 0), integer(view, "byteLength")
        if start + length > len(whole):
            raise view.refuse(f"ends at byte {start + length} of a buffer of {len(whole)}")
        return whole[start : start + length], integer(view, "byteStride", 0, most=252)

    def _buffer(self, named: Located) -> memoryview:
        buffer, index = self.item("buffers", named), int(named.value)
        if index not in self.buffers:
            length = integer(buffer, "byteLength")
            data = self.bytes_of(buffer)
            if data is None:
                if index != 0 or self.binary is None:
                    raise buffer.refuse("has no uri, and the file no binary chunk for it")
                data = self.binary
            if length > len(data):
                raise buffer.refuse(f"byteLength is {length}, and there are {len(data)} bytes")
            self.buffers[index] = data[:length]
        return self.buffers[index]

    def array(self, node: Located, types: tuple[str, ...], whole: bool = False) -> NDArray[Any]:
        """(n, k) float64 numbers of the accessor that is named at `node`, or with `whole` unsigned integers as they are.

        Raises `SceneError` where it is of none of the `types`, or its buffer is too short."""
        accessor = self.item("accessors", node)
        kind = fields.one_of(required(accessor, "type"), SIZES, "type of accessor")
        if kind not in types:
            raise node.refuse(f"accessor {node.value} is of type {kind}: {' or '.join(types)} is expected")
        key = (node.value, whole)
        if key not in self.arrays:
            self.arrays[key] = self._array(accessor, SIZES[kind], whole)
        return self.arrays[key]

    def _array(self, accessor: Located, width: int, whole: bool) -> NDArray[Any]:
        count = integer(accessor, "count", least=1, most=2**31 - 1)
        dtype, normalized = component(accessor, "u" if whole else "iuf"), boolean(accessor, "normalized")
        view, sparse = optional(accessor, "bufferView"), optional(accessor, "sparse")
        found = None if view is None else self._numbers(accessor, view, dtype, count, width)
        self.read += count * width
        if self.read > FREE_NUMBERS + self.held:
            raise accessor.refuse("with those before it has more numbers than the buffers hold")
        if found is None:
            if sparse is None:
                raise accessor.refuse("has no bufferView, and so no numbers")
            found = np.zeros((count, width), dtype)
        if sparse is not None:
            found = self._sparse(sparse, found)
        if whole:
            return found
        values = found.astype(np.float64)
        return np.maximum(values / np.iinfo(dtype).max, -1.0) if normalized and dtype.kind != "f" else values

    def _numbers(self, place: Located, view: Located, dtype: np.dtype[Any], count: int, width: int) -> NDArray[Any]:
        data, stride = self.view(view)
        start, size = integer(place, "byteOffset", 0), width * dtype.itemsize
        stride = stride or size
        if stride < size:
            raise place.refuse(f"its elements have {size} bytes, and its buffer view a stride of {stride}")
        needed = start + stride * (count - 1) + size
        if needed > len(data):
            raise place.refuse(f"{count} elements end at byte {needed} of a buffer view of {len(data)}")
        return np.ndarray((count, width), dtype, data, start, (stride, dtype.itemsize))

    def _sparse(self, node: Located, base: NDArray[Any]) -> NDArray[Any]:
        """A copy with some elements replaced."""
        count = integer(node, "count", least=1, most=len(base))
        indices, values = mapping(required(node, "indices")), mapping(required(node, "values"))
        where = self._numbers(indices, required(indices, "bufferView"), component(indices, "u"), count, 1)[:, 0]
        if where.max() >= len(base):
            raise indices.refuse(f"element {where.max()} of {len(base)}")
        changed = base.copy()
        changed[where] = self._numbers(values, required(values, "bufferView"), base.dtype, count, base.shape[1])
        return changed


def read_document(file: Path, place: Place) -> Document:
    """The document of a file. Raises `SceneError` for one that is missing, damaged, too large or of another version."""

    def refuse(text: str) -> SceneError:
        return SceneError(f"{file}: {text}")

    most = MAX_GLTF if file.suffix.lower() == ".gltf" else math.inf
    data = _contents(file, refuse, most)
    text, chunk = _chunks(data, refuse) if data[:4] == b"glTF" else (data, None)
    if len(text) - sum(len(found[0]) for found in _DATA_URI.finditer(text)) > MAX_JSON:
        raise refuse(f"has more than {MAX_JSON // 2**20} MiB of JSON beside its data URIs")
    try:
        tree = json.loads(text.decode("utf-8-sig"))
    except (ValueError, RecursionError) as problem:
        said = "nested too deeply" if isinstance(problem, RecursionError) else str(problem)
        raise refuse(f"is not a glTF file: {said[:200]}") from problem
    root = mapping(Located(tree, Origin(str(file), SceneError)))
    version = fields.text(required(mapping(required(root, "asset")), "version"))
    if version.split(".")[0] != "2":
        raise refuse(f"is glTF {version[:20]!r}: version 2.0 is read; save it as that")
    return Document(file, place, root, chunk, 0 if chunk is None else len(chunk))


def _contents(file: Path, refuse: Callable[[str], RaybenchError], most: float = math.inf) -> bytes:
    """The bytes of a regular file, of at most so many."""
    try:
        with open_regular(file) as stream:
            size = os.fstat(stream.fileno()).st_size
            if size > most:
                raise refuse(f"larger than {MAX_GLTF // 2**20} MiB: put its buffers into files, or write a .glb")
            if lacks := lacking_memory(size * BYTES_PER_BYTE):
                raise refuse(f"reading it {lacks}")
            return stream.read(size)
    except (OSError, ValueError) as problem:
        raise refuse(unreadable(problem)) from problem


def _chunks(data: bytes, refuse: Callable[[str], SceneError]) -> tuple[bytes, memoryview | None]:
    """The JSON and the binary chunk of a `.glb`."""
    if len(data) < 20:
        raise refuse("is cut short: a .glb has a header of 20 bytes")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise refuse(f"is a .glb of version {version}: version 2 is read; save it as that")
    if length > len(data):
        raise refuse(f"is cut short: its header says {length} bytes, and it has {len(data)}")
    found: dict[int, memoryview] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        if at + 8 + size > length:
            raise refuse(f"a chunk at byte {at} says {size} bytes: {length - at - 8} are left")
        if not found and kind != _JSON:
            raise refuse("the first chunk of a .glb must be JSON")
        found.setdefault(kind, memoryview(data)[at + 8 : at + 8 + size])
        at += 8 + size
    return bytes(found.get(_JSON, b"")), found.get(_BIN)


def _decoded(uri: Located, text: str) -> memoryview:
    kind, _, encoded = text.partition(",")
    try:
        if not kind.endswith(";base64"):
            raise ValueError("not base64")
        # the characters of base64 that a URI may escape; urllib's unquote takes 75 bytes for each of them
        plain = re.sub("(?i)%(2b|2f|3d)", lambda found: chr(int(found[1], 16)), encoded)
        return memoryview(binascii.a2b_base64(plain, strict_mode=True))
    except ValueError:
        raise SceneError(f"{uri.where}: is not a data URI in base64") from None


# ---- values ----------------------------------------------------------------------------------------------------------


def child(node: Located, value: Any, *steps: str | int) -> Located:
    """A value within another one, with its place."""
    return Located(value, node.origin, (*node.path, *steps))


def mapping(node: Located) -> Located:
    """The node, which must be a mapping."""
    if not isinstance(node.value, dict):
        raise node.refuse("must be a mapping")
    return node


def optional(node: Located, *keys: str) -> Located | None:
    """The value at the end of these keys, None where one of them is missing."""
    for key in keys:
        if key not in mapping(node).value:
            return None
        node = child(node, node.value[key], key)
    return node


def required(node: Located, key: str) -> Located:
    """The value of a key."""
    found = optional(node, key)
    if found is None:
        raise node.refuse_key(key, "is missing")
    return found


def a_list(node: Located, key: str) -> Located:
    """A list, an empty one where it is missing."""
    found = optional(node, key) or child(node, [], key)
    if not isinstance(found.value, list):
        raise found.refuse("must be a list")
    return found


def listed(node: Located, key: str) -> Iterator[Located]:
    """The values of a list, none where it is missing."""
    every = a_list(node, key)
    return (child(every, value, index) for index, value in enumerate(every.value))


def extension(node: Located, name: str) -> Located | None:
    """An extension of an object, by its name."""
    found = optional(node, "extensions", name)
    return None if found is None else mapping(found)


def boolean(node: Located, key: str) -> bool:
    """True or false, which it is where it is missing."""
    return fields.boolean(optional(node, key) or child(node, False))


def integer(node: Located, key: str, default: int | None = None, least: int = 0, most: int = 2**53) -> int:
    """A whole number in [least, most], written without a fraction."""
    found = required(node, key) if default is None else optional(node, key) or child(node, default)
    return fields.integer(found, least, most)


def number(node: Located, key: str, default: float) -> float:
    """A finite number."""
    return fields.number(optional(node, key) or child(node, default))


def numbers(node: Located, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
    """As many finite numbers as the default has."""
    found = optional(node, key)
    if found is None:
        return default
    if not isinstance(found.value, list) or len(found.value) != len(default):
        raise found.refuse(f"must be {len(default)} numbers")
    return tuple(fields.number(each) for each in listed(node, key))


def component(node: Located, kinds: str) -> np.dtype[Any]:
    """The type of an accessor's numbers, of one of NumPy's `kinds`."""
    known = {code: np.dtype(name) for code, name in COMPONENTS.items() if np.dtype(name).kind in kinds}
    code = integer(node, "componentType")
    if code not in known:
        raise node.refuse_key("componentType", f"{code}: must be one of {', '.join(map(str, known))}")
    return known[code]


def name_of(node: Located, what: str) -> str:
    """The name that a file gives an object, else what it is with its index."""
    name = node.value.get("name")
    return name[:80] if isinstance(name, str) and name.strip() else f"{what}_{node.path[-1]}"

"""A glTF file as JSON values with their places, and the bytes and numbers of its buffers.

A reader of our own: pygltflib takes 7 s for a megabyte of JSON, makes numbers of texts and integers of fractions, sets
attributes that a file names, and says of no mistake where it is; trimesh leaves most material extensions and all lights out.
Everything here takes time and memory in proportion to the bytes of the files.
"""

from __future__ import annotations

import binascii
import json
import os
import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from engines.errors import SceneError
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
MAX_DEPTH = 200
"""Lists and mappings within each other, for extras are not ours."""
FREE_NUMBERS = 1 << 24
"""Numbers that accessors may have beyond one for each byte of the buffers: they may overlap, or have no bytes at all."""
BYTES_PER_BYTE = 12
"""Memory at the height of reading, for each byte of a buffer."""
COMPONENTS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
SIZES = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
_URI = re.compile(rb'"data:([^"\\]*)"')
_MARK = "data:"
_JSON, _BIN = 0x4E4F534A, 0x004E4942


@dataclass(slots=True)
class Document:
    """The JSON of a file, and what of its buffers has been read. `read` counts numbers of accessors, `held` bytes of buffers;
    `uris` are the data URIs, for which "data:0" and so on stand in the JSON."""

    file: Path
    place: Place
    root: Located
    uris: list[bytes]
    binary: memoryview | None
    held: int = 0
    read: int = 0
    buffers: dict[int, memoryview] = field(default_factory=dict)
    arrays: dict[int, NDArray[Any]] = field(default_factory=dict)

    def item(self, kind: str, index: Located) -> Located:
        """The item that a value of the file names, such as `accessors[3]`."""
        every = listed(self.root, kind)
        number = fields.integer(index, 0, 2**53)
        if number >= len(every):
            raise index.refuse(f"there are {len(every)} {kind}, counted from 0")
        return mapping(every[number])

    def bytes_of(self, node: Located) -> memoryview | None:
        """Of a `uri`, the bytes of the data URI or of the file; None where there is none. Raises `SceneError`."""
        uri = optional(node, "uri")
        if uri is None:
            return None
        text = fields.text(uri)
        if text.startswith(_MARK):
            return self._decoded(uri, text)
        path = self.place.find(uri, unquote(text), self.file.parent)
        try:
            with open_regular(path) as stream:
                size = os.fstat(stream.fileno()).st_size
                if lacks := lacking_memory(size * BYTES_PER_BYTE):
                    raise uri.refuse(f"reading it {lacks}")
                return memoryview(stream.read(size))
        except OSError as problem:
            raise uri.refuse(unreadable(problem)) from problem

    def _decoded(self, uri: Located, text: str) -> memoryview:
        number = text.removeprefix(_MARK)
        if not (number.isdecimal() and int(number) < len(self.uris)):
            raise uri.refuse("is not a data URI in base64")
        kind, _, encoded = self.uris[int(number)].partition(b",")
        try:
            if not kind.endswith(b";base64"):
                raise ValueError("not base64")
            return memoryview(binascii.a2b_base64(encoded))
        except ValueError:
            raise SceneError(f"{uri.where}: is not a data URI in base64") from None

    def view(self, node: Located) -> tuple[memoryview, int]:
        """The bytes of the buffer view that is named at `node`, and its stride, 0 where it has none. Raises `SceneError`."""
        view = self.item("bufferViews", node)
        named = required(view, "buffer")
        whole = self._buffer(named)
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
            self.held += length
        return self.buffers[index]

    def array(self, node: Located, types: tuple[str, ...]) -> NDArray[Any]:
        """(n, k) numbers of the accessor that is named at `node`: float64, but integers that are not normalised as they are.

        Raises `SceneError` where it is of none of the `types`, or its buffer is too short."""
        accessor = self.item("accessors", node)
        kind = fields.one_of(required(accessor, "type"), SIZES, "type of accessor")
        if kind not in types:
            raise node.refuse(f"accessor {node.value} is of type {kind}: {' or '.join(types)} is expected")
        if node.value not in self.arrays:
            self.arrays[node.value] = self._array(accessor, SIZES[kind])
        return self.arrays[node.value]

    def _array(self, accessor: Located, width: int) -> NDArray[Any]:
        count = integer(accessor, "count", least=1, most=2**31 - 1)
        dtype, normalized = component(accessor), fields.boolean(optional(accessor, "normalized") or child(accessor, False))
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
        if dtype.kind != "f" and not normalized:
            return found
        values = found.astype(np.float64)
        return np.maximum(values / np.iinfo(dtype).max, -1.0) if dtype.kind != "f" else values

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
        where = self._numbers(indices, required(indices, "bufferView"), component(indices, ("u",)), count, 1)[:, 0]
        if where.max() >= len(base):
            raise indices.refuse(f"element {where.max()} of {len(base)}")
        changed = base.copy()
        changed[where] = self._numbers(values, required(values, "bufferView"), base.dtype, count, base.shape[1])
        return changed


def read_document(file: Path, place: Place) -> Document:
    """The document of a file. Raises `SceneError` for one that is missing, damaged, too large or of another version."""
    try:
        with open_regular(file) as stream:
            size = os.fstat(stream.fileno()).st_size
            binary = stream.read(4) == b"glTF"
            if not binary and size > MAX_GLTF:
                raise SceneError(f"{file}: larger than {MAX_GLTF // 2**20} MiB: put its buffers into files, or write a .glb")
            if lacks := lacking_memory(size * BYTES_PER_BYTE):
                raise SceneError(f"{file}: reading it {lacks}")
            stream.seek(0)
            data = stream.read(size)
    except (OSError, ValueError) as problem:
        raise SceneError(f"{file}: {unreadable(problem)}") from problem
    text, chunk = _chunks(file, data) if binary else (memoryview(data), None)
    if len(text) > MAX_GLTF:
        raise SceneError(f"{file}: has more than {MAX_GLTF // 2**20} MiB of JSON with its data URIs")
    uris: list[bytes] = []

    def kept(found: re.Match[bytes]) -> bytes:
        uris.append(found[1])
        return b'"%s%d"' % (_MARK.encode(), len(uris) - 1)

    root = _json(file, _URI.sub(kept, bytes(text)))
    document = Document(file, place, root, uris, chunk)
    version = str(required(mapping(required(root, "asset")), "version").value)[:20]
    if version.split(".")[0] != "2":
        raise SceneError(f"{file}: is glTF {version}: version 2.0 is read; save it as that")
    return document


def _chunks(file: Path, data: bytes) -> tuple[memoryview, memoryview | None]:
    """The JSON and the binary chunk of a `.glb`."""
    if len(data) < 20:
        raise SceneError(f"{file}: is cut short: a .glb has a header of 20 bytes")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise SceneError(f"{file}: is a .glb of version {version}: version 2 is read; save it as that")
    if length > len(data):
        raise SceneError(f"{file}: is cut short: its header says {length} bytes, and it has {len(data)}")
    found: dict[int, memoryview] = {}
    at = 12
    while at + 8 <= length:
        size, kind = struct.unpack_from("<II", data, at)
        if at + 8 + size > length:
            raise SceneError(f"{file}: a chunk at byte {at} says {size} bytes: {length - at - 8} are left")
        if not found and kind != _JSON:
            raise SceneError(f"{file}: the first chunk of a .glb must be JSON")
        found.setdefault(kind, memoryview(data)[at + 8 : at + 8 + size])
        at += 8 + size
    return found.get(_JSON, memoryview(b"")), found.get(_BIN)


def _json(file: Path, text: bytes) -> Located:
    if len(text) > MAX_JSON:
        raise SceneError(f"{file}: has more than {MAX_JSON // 2**20} MiB of JSON beside its data URIs")
    try:
        data = json.loads(text.decode("utf-8-sig"))
        _check_depth(data)
    except (ValueError, RecursionError) as problem:
        said = "nested too deeply" if isinstance(problem, RecursionError) else str(problem)
        raise SceneError(f"{file}: is not a glTF file: {said[:200]}") from problem
    return mapping(Located(data, Origin(str(file), SceneError)))


def _check_depth(data: Any) -> None:
    level: list[Any] = [data]
    for _ in range(MAX_DEPTH):
        inner: list[Any] = []
        for each in level:
            if isinstance(each, (dict, list)):
                inner += each.values() if isinstance(each, dict) else each
        level = inner
        if not level:
            return
    raise RecursionError


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


def listed(node: Located, key: str) -> Items:
    """The values of a list, none where it is missing."""
    found = optional(node, key)
    if found is None:
        return Items(child(node, [], key))
    if not isinstance(found.value, list):
        raise found.refuse("must be a list")
    return Items(found)


@dataclass(frozen=True, slots=True)
class Items:
    """The values of a list, each with its place when it is asked for."""

    node: Located

    def __len__(self) -> int:
        return len(self.node.value)

    def __getitem__(self, index: int) -> Located:
        return child(self.node, self.node.value[index], index)

    def __iter__(self) -> Iterator[Located]:
        return (self[index] for index in range(len(self)))


def extension(node: Located, name: str) -> Located | None:
    """An extension of an object, by its name."""
    found = optional(node, "extensions", name)
    return None if found is None else mapping(found)


def integer(node: Located, key: str, default: int | None = None, least: int = 0, most: int = 2**53) -> int:
    """A whole number in [least, most]; 4.0 is one."""
    found = required(node, key) if default is None else optional(node, key)
    if found is None:
        assert default is not None
        return default
    value = found.value
    whole = int(value) if isinstance(value, float) and value.is_integer() else value
    return fields.integer(child(node, whole, key), least, most)


def number(node: Located, key: str, default: float) -> float:
    """A finite number."""
    found = optional(node, key)
    return default if found is None else fields.number(found)


def numbers(node: Located, key: str, default: tuple[float, ...]) -> tuple[float, ...]:
    """As many finite numbers as the default has."""
    found = optional(node, key)
    if found is None:
        return default
    if not isinstance(found.value, list) or len(found.value) != len(default):
        raise found.refuse(f"must be {len(default)} numbers")
    return tuple(fields.number(each) for each in Items(found))


def component(node: Located, kinds: tuple[str, ...] = ("i", "u", "f")) -> np.dtype[Any]:
    """The type of an accessor's numbers, of one of NumPy's `kinds`."""
    code = integer(node, "componentType")
    if code not in COMPONENTS or np.dtype(COMPONENTS[code]).kind not in kinds:
        known = ", ".join(str(code) for code, name in COMPONENTS.items() if np.dtype(name).kind in kinds)
        raise node.refuse_key("componentType", f"{code}: must be one of {known}")
    return np.dtype(COMPONENTS[code])


def name_of(node: Located, what: str) -> str:
    """The name that a file gives an object, else what it is with its index."""
    name = node.value.get("name")
    return name[:80] if isinstance(name, str) and name.strip() else f"{what}_{node.path[-1]}"

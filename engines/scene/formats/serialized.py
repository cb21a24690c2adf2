"""Mitsuba's `.serialized` files: meshes one after the other, each compressed, and at the end a table of their places."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from engines.scene.formats import FileMesh

MAGIC = 0x041C
VERSIONS = (3, 4)
NORMALS, UVS, COLORS, DOUBLE = 0x1, 0x2, 0x8, 0x2000
LONGEST_NAME = 1 << 16
MOST = 1 << 31
"""Vertices and faces have numbers of 32 bits."""
PIECE = 1 << 20


def parse_serialized(data: bytes, shape_index: int, check: Callable[[float], None]) -> FileMesh:
    """The mesh at `shape_index`. `check` is called with the bytes of memory that it takes before it is unpacked.

    Raises ValueError for what is wrong.
    """
    version = _version(data, 0)
    start, end = _place(data, version, shape_index)
    stream = _Inflated(memoryview(data)[start + 4 : end])
    (flags,) = struct.unpack("<I", stream.read(4))
    if _version(data, start) == 4:
        stream.skip_text(LONGEST_NAME)
    vertices, faces = struct.unpack("<QQ", stream.read(16))
    if max(vertices, faces) >= MOST:
        raise ValueError(f"has {vertices} vertices and {faces} faces: less than {MOST} of each are read")
    number = np.dtype("<f8" if flags & DOUBLE else "<f4")
    columns = 3 + sum(width for flag, width in ((NORMALS, 3), (UVS, 2), (COLORS, 3)) if flags & flag)
    check(4.0 * (vertices * columns * 8 + faces * 12))

    def rows(width: int) -> NDArray[np.float64]:
        return np.frombuffer(stream.read(vertices * width * number.itemsize), number).astype(np.float64).reshape(-1, width)

    positions = rows(3)
    normals = rows(3) if flags & NORMALS else None
    uvs = rows(2) if flags & UVS else None
    attributes = {"vertex_color": rows(3)} if flags & COLORS else {}
    corners = np.frombuffer(stream.read(faces * 12), "<u4").astype(np.int64).reshape(-1, 3)
    return FileMesh(positions, corners, normals, uvs, attributes=attributes)


def _version(data: bytes, at: int) -> int:
    if len(data) < at + 4 or struct.unpack_from("<H", data, at)[0] != MAGIC:
        raise ValueError("a mesh does not begin where one is expected")
    (version,) = struct.unpack_from("<H", data, at + 2)
    if version not in VERSIONS:
        raise ValueError(f"version {version}: known: {', '.join(map(str, VERSIONS))}")
    return version


def _place(data: bytes, version: int, shape_index: int) -> tuple[int, int]:
    """Where the mesh begins and where it must have ended."""
    (count,) = struct.unpack_from("<I", data, len(data) - 4)
    size = 8 if version == 4 else 4
    table = len(data) - 4 - size * count
    if table < 4:
        if shape_index == 0:
            return 0, len(data)  # a file without a table, which some programs write
        raise ValueError("the table of its meshes is damaged")
    if shape_index >= count:
        raise ValueError(f"has {count} meshes, counted from 0: there is no mesh {shape_index}")
    places = [0] if shape_index == 0 else []
    places = places or list(struct.unpack_from("<Q" if size == 8 else "<I", data, table + size * shape_index))
    if places[0] >= table:
        raise ValueError("the table of its meshes is damaged")
    return places[0], table


class _Inflated:
    """Reads a compressed stream a piece at a time, and never unpacks more than is asked for."""

    def __init__(self, data: memoryview) -> None:
        self.data, self.at, self.rest = data, 0, b""
        self.decoder = zlib.decompressobj()

    def read(self, size: int) -> bytearray:
        unpacked = bytearray()
        while len(unpacked) < size:
            piece = self.rest
            if not piece:
                piece = self.data[self.at : self.at + PIECE]
                self.at += len(piece)
            try:
                more = self.decoder.decompress(piece, size - len(unpacked))
            except zlib.error as problem:
                raise ValueError(f"its compressed data are damaged: {problem}") from problem
            self.rest = self.decoder.unconsumed_tail
            unpacked += more
            if not more and (self.decoder.eof or (not self.rest and self.at >= len(self.data))):
                raise ValueError("is cut short")
        return unpacked

    def skip_text(self, longest: int) -> None:
        for _ in range(longest):
            if self.read(1) == b"\0":
                return
        raise ValueError("the name of a mesh has no end")

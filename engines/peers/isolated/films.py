"""The memory of a film that two processes share: allocated where it is rendered, mapped where it is read."""

from __future__ import annotations

import mmap
import os
import tempfile
import weakref
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.errors import RendererFailed
from engines.film import BYTES_A_PIXEL, Arrays, Film

COLOURS = ("sums", "squares", "even_sums")
PARTS = (*COLOURS, "counts")


class Block(mmap.mmap):
    """The arrays of a film of `width` x `height` pixels, in memory behind a file descriptor, which it closes at its end."""

    width: int
    height: int
    descriptor: int

    def __new__(cls, width: int, height: int, descriptor: int | None = None) -> Block:
        """`descriptor` is that of another process's block; without one the block is new, and 0."""
        size = width * height * BYTES_A_PIXEL
        opened = _new(size) if descriptor is None else descriptor
        self = super().__new__(cls, opened, size)
        self.width, self.height, self.descriptor = width, height, opened
        weakref.finalize(self, os.close, opened)
        return self

    def arrays(self) -> Arrays:
        """Views, which keep the block."""
        pixels = self.width * self.height
        colours = np.frombuffer(self, np.float64, 9 * pixels).reshape(3, self.height, self.width, 3)
        counts = np.frombuffer(self, np.int64, pixels, colours.nbytes).reshape(self.height, self.width)
        return colours[0], colours[1], colours[2], counts


def _new(size: int) -> int:
    """A descriptor of `size` bytes of memory that no name leads to."""
    if hasattr(os, "memfd_create"):
        descriptor = os.memfd_create("raybench-film")
    else:
        with tempfile.TemporaryFile() as file:
            descriptor = os.dup(file.fileno())
    os.truncate(descriptor, size)
    return descriptor


def allocate(width: int, height: int) -> Arrays:
    """For `engines.film.allocated_by`."""
    return Block(width, height).arrays()


def _held_by(array: Any) -> Block | None:
    """The block that an array is a view of."""
    while array is not None and not isinstance(array, Block):
        array = array.obj if isinstance(array, memoryview) else getattr(array, "base", None)
    return array


def _same(one: Any, other: NDArray[Any]) -> bool:
    """Whether two arrays are one in memory."""
    return isinstance(one, np.ndarray) and one.__array_interface__ == other.__array_interface__


def block_of(film: Any, last: Block | None) -> Block:
    """The block that holds a film's samples: its own, or `last` or a new one with a copy of what the engine keeps elsewhere.

    Raises `RendererFailed` where it is no film, or its arrays are of different shapes or types.
    """
    lacking = [part for part in (*PARTS, "bad_samples") if not hasattr(film, part)]
    if lacking:
        raise RendererFailed(
            f"the engine's render returned {type(film).__name__}, which lacks {', '.join(lacking)}: a Film is expected"
        )
    parts = [getattr(film, part) for part in PARTS]
    block = _held_by(parts[0])
    height, width = _shape(parts[0])
    if block is None or (block.width, block.height) != (width, height):
        block = last if last and (last.width, last.height) == (width, height) else Block(width, height)
    for part, own, shared in zip(PARTS, parts, block.arrays(), strict=True):
        if not _same(own, shared):
            _copy(part, own, shared)
    return block


def _shape(sums: Any) -> tuple[int, int]:
    shape = np.shape(sums)
    if len(shape) != 3 or shape[2] != 3 or 0 in shape:
        raise RendererFailed(f"the engine's film.sums is of shape {shape}: (height, width, 3) is expected")
    return shape[0], shape[1]


def _copy(part: str, own: Any, shared: Any) -> None:
    own = np.asarray(own)
    if own.shape != shared.shape or not np.can_cast(own.dtype, shared.dtype, "same_kind"):
        raise RendererFailed(
            f"the engine's film.{part} is of shape {own.shape} and dtype {own.dtype}: "
            f"{shared.shape} and {shared.dtype} are expected"
        )
    shared[...] = own


def film_in(block: Block) -> Film:
    """A film whose arrays are those of a block."""
    film = Film(block.width, block.height)
    film.sums, film.squares, film.even_sums, film.counts = block.arrays()
    return film

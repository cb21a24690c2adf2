"""Objects as messages: pickled, large arrays beside the pickle without another copy.

Arrays and NumPy's numbers are written by this module, since NumPy 1 and 2 pickle them under different names.
"""

from __future__ import annotations

import io
import pickle
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.processes.channel import Channel, Pause

LARGE = 1 << 14
"""Bytes from which an array goes beside the pickle."""


class Unreadable(Exception):
    """A message that was received whole, of things that cannot be made here."""


def send(channel: Channel, message: Any, descriptor: int | None = None) -> None:
    """Sends an object, and a file descriptor after it. Raises `Closed`, and what pickle raises before anything is sent."""
    channel.send(*dumped(message), descriptor)


def receive(channel: Channel, pause: Pause | None = None) -> Any:
    """The next object. Raises `Closed`, `BadMessage` and `Unreadable`."""
    return loaded(*channel.receive(pause))


def dumped(message: Any) -> tuple[bytes, Sequence[memoryview]]:
    """A message as its pickle and the large arrays beside it."""
    beside: list[memoryview] = []

    def small(buffer: pickle.PickleBuffer) -> bool:
        raw = buffer.raw()
        if raw.nbytes >= LARGE:
            beside.append(raw)
        return raw.nbytes < LARGE

    file = io.BytesIO()
    _Pickler(file, 5, buffer_callback=small).dump(message)
    return file.getvalue(), beside


def loaded(data: bytes | bytearray, beside: Sequence[bytearray]) -> Any:
    """The message of a pickle and the arrays beside it. Raises `Unreadable`."""
    try:
        return pickle.loads(data, buffers=beside)
    except Exception as error:  # a class of the user's may raise anything
        raise Unreadable(f"{type(error).__name__}: {error}") from error


class _Pickler(pickle.Pickler):
    def reducer_override(self, obj: Any) -> Any:
        if type(obj) is np.ndarray and _plain(obj.dtype):
            flat: Any = np.ascontiguousarray(obj).reshape(-1).view(np.uint8)
            return _array, (pickle.PickleBuffer(flat), obj.dtype.str, obj.shape, obj.flags.writeable)
        if isinstance(obj, np.generic) and _plain(obj.dtype):
            return _number, (obj.dtype.str, obj.tobytes())
        return NotImplemented


def _plain(dtype: np.dtype[Any]) -> bool:
    """Whether `dtype.str` says all of it: that of a type with fields gives its size alone."""
    return not dtype.hasobject and dtype.kind != "V"


def _array(data: Any, dtype: str, shape: tuple[int, ...], writeable: bool) -> NDArray[Any]:
    found = np.frombuffer(data, dtype).reshape(shape) if len(data) else np.empty(shape, dtype)
    found.flags.writeable = writeable
    return found


def _number(dtype: str, data: bytes) -> Any:
    return np.frombuffer(data, dtype)[0]

"""Messages between two processes: pickled data over a socket, large arrays beside it without another copy.

A message is its size and the sizes of its arrays, then the pickle, then the arrays. Arrays and NumPy's numbers are written by
this module, since NumPy 1 and 2 pickle them under different names.
"""

from __future__ import annotations

import io
import pickle
import select
import socket
import struct
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

LARGE = 1 << 14
"""Bytes from which an array goes beside the pickle."""
_HEAD, _SIZE = struct.Struct("<QQ"), struct.Struct("<Q")
_POLL_MILLISECONDS = 500


class Closed(Exception):
    """The other end has gone."""


class Unreadable(Exception):
    """A message that was received whole, of things that cannot be made here."""


class Channel:
    """One end of a pair of sockets. `alive` is asked now and then while nothing comes: without it, an end that is closed alone
    says that the other process has gone, and another fork may hold that end open."""

    def __init__(self, connection: socket.socket, alive: Callable[[], bool] = lambda: True) -> None:
        self._socket, self._alive = connection, alive
        self._poll = select.poll()
        self._poll.register(connection, select.POLLIN)

    def close(self) -> None:
        self._socket.close()

    def send(self, message: Any, descriptor: int | None = None) -> None:
        """Sends a message, and a file descriptor after it. Raises `Closed`, and what pickle raises before anything is sent."""
        data, beside = dumped(message)
        sizes = b"".join(_SIZE.pack(each.nbytes) for each in beside)
        try:
            self._socket.sendall(_HEAD.pack(len(data), len(beside)) + sizes + data)
            for each in beside:
                self._socket.sendall(each)
            if descriptor is not None:
                socket.send_fds(self._socket, [b"."], [descriptor])
        except OSError as error:
            raise Closed from error

    def receive(self) -> Any:
        """The next message. Raises `Closed` and `Unreadable`."""
        size, count = _HEAD.unpack(self._exactly(_HEAD.size))
        sizes = [_SIZE.unpack(self._exactly(_SIZE.size))[0] for _ in range(count)]
        data = self._exactly(size)
        return loaded(data, [self._exactly(each) for each in sizes])

    def receive_descriptor(self) -> int:
        """The file descriptor that follows a message."""
        self._wait()
        try:
            descriptors = socket.recv_fds(self._socket, 1, 1)[1]
        except OSError as error:
            raise Closed from error
        if not descriptors:
            raise Closed
        return descriptors[0]

    def _exactly(self, size: int) -> bytearray:
        data = bytearray(size)
        view = memoryview(data)
        while view:
            self._wait()
            try:
                count = self._socket.recv_into(view)
            except OSError as error:
                raise Closed from error
            if not count:
                raise Closed
            view = view[count:]
        return data

    def _wait(self) -> None:
        while not self._poll.poll(_POLL_MILLISECONDS):
            if not self._alive():
                raise Closed


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
        if type(obj) is np.ndarray and not obj.dtype.hasobject:
            flat: Any = np.ascontiguousarray(obj).reshape(-1).view(np.uint8)
            return _array, (pickle.PickleBuffer(flat), obj.dtype.str, obj.shape, obj.flags.writeable)
        if isinstance(obj, np.generic) and not obj.dtype.hasobject:
            return _number, (obj.dtype.str, obj.tobytes())
        return NotImplemented


def _array(data: Any, dtype: str, shape: tuple[int, ...], writeable: bool) -> NDArray[Any]:
    found = np.frombuffer(data, dtype).reshape(shape) if len(data) else np.empty(shape, dtype)
    found.flags.writeable = writeable
    return found


def _number(dtype: str, data: bytes) -> Any:
    return np.frombuffer(data, dtype)[0]

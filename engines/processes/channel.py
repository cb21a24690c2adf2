"""One end of a connection between two processes: messages of bytes in frames, and large buffers or a descriptor beside them.

A frame is a mark, the number of buffers and the size of the message; then the sizes of the buffers, the message, the buffers.
The mark shows at once what is no message: an engine shares the process that sends, and may write to any descriptor.
`multiprocessing.connection` frames messages, too, but once one has begun it waits for the rest whatever the deadline, and to
import it takes longer than to start Python.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import struct
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

MARK = b"rayb"
HEAD = struct.Struct("<4sIQ")
_SIZE = struct.Struct("<Q")
_SHOWN = 80

Pause = Callable[[], float]
"""Called while nothing comes: returns the seconds until its next call, or raises to give up."""


class Closed(Exception):
    """The other end has gone."""


class BadMessage(Exception):
    """Something that is no message; says what was found and what is expected."""


class Message(NamedTuple):
    """What was received: the bytes of a message, and the buffers beside it."""

    data: bytearray
    beside: Sequence[bytearray]


class Channel:
    """One end of a pair of sockets. Messages may be sent from any thread; one thread at a time receives."""

    def __init__(self, connection: socket.socket, most_bytes: int | None = None, exits: bool = False) -> None:
        """`most_bytes`: the most that a received message and its buffers may have; None: any. With `exits` this process ends
        where the other end has gone, in place of `Closed`."""
        self.socket, self._most_bytes, self._exits = connection, most_bytes, exits
        self._sending = threading.Lock()
        self._poll = select.poll()
        self._poll.register(connection, select.POLLIN)

    @classmethod
    def at(cls, descriptor: int, exits: bool = False) -> Channel:
        """The end that a process was started with; programs that it starts do not have it."""
        os.set_inheritable(descriptor, False)
        return cls(socket.socket(fileno=descriptor), exits=exits)

    def fileno(self) -> int:
        """The descriptor of the socket, for `select`."""
        return self.socket.fileno()

    def close(self) -> None:
        """Closes the socket; the other end then raises `Closed`."""
        self.socket.close()

    def send(self, data: bytes, beside: Sequence[memoryview] = (), descriptor: int | None = None) -> None:
        """Sends a message, the buffers beside it, and a file descriptor after them. Raises `Closed`."""
        with self._open(), self._sending:
            self.socket.sendall(framed(data, beside))
            for buffer in beside:
                self.socket.sendall(buffer)
            if descriptor is not None:
                socket.send_fds(self.socket, [b"."], [descriptor])

    def receive(self, pause: Pause | None = None) -> Message:
        """The next message. Raises `Closed`, `BadMessage`, and what `pause` raises."""
        count, size = sizes(self._exactly(HEAD.size, pause, MARK))
        if self._most_bytes is not None and max(size, count) > self._most_bytes:
            start = self._exactly(min(size, _SHOWN), pause)
            raise BadMessage(f"it sent a message of more than {self._most_bytes >> 20} MiB: {excerpt(start)}")
        beside = [_SIZE.unpack(self._exactly(_SIZE.size, pause))[0] for _ in range(count)]
        if self._most_bytes is not None and size + sum(beside) > self._most_bytes:
            raise BadMessage(f"it sent a message and buffers of more than {self._most_bytes >> 20} MiB together")
        return Message(self._exactly(size, pause), [self._exactly(each, pause) for each in beside])

    def receive_descriptor(self, pause: Pause | None = None) -> int:
        """The file descriptor that follows a message. Raises `Closed`."""
        self._wait(pause)
        with self._open():
            descriptors = socket.recv_fds(self.socket, 1, 1)[1]
            if not descriptors:
                raise EOFError
        os.set_inheritable(descriptors[0], False)
        return descriptors[0]

    def _exactly(self, size: int, pause: Pause | None, start: bytes = b"") -> bytearray:
        """The next `size` bytes. Raises `BadMessage` as soon as they do not begin with `start`."""
        data, received = bytearray(size), 0
        while received < size:
            self._wait(pause)
            with self._open():
                count = self.socket.recv_into(memoryview(data)[received:])
                if not count:
                    raise EOFError
            received += count
            if not data.startswith(start[:received]):
                with contextlib.suppress(OSError):
                    data[received:] = self.socket.recv(_SHOWN, socket.MSG_DONTWAIT)
                raise not_a_message(data)
        return data

    def _wait(self, pause: Pause | None) -> None:
        milliseconds = None if pause is None else 0.0
        while not self._poll.poll(milliseconds):
            assert pause is not None
            milliseconds = 1e3 * pause()

    @contextlib.contextmanager
    def _open(self) -> Iterator[None]:
        """Within, what sockets raise means that the other end has gone."""
        try:
            yield
        except (OSError, EOFError) as error:
            if self._exits:
                os._exit(0)
            raise Closed from error


def framed(data: bytes, beside: Sequence[memoryview] = ()) -> bytes:
    """A message as it is sent, without the buffers that follow it."""
    return HEAD.pack(MARK, len(beside), len(data)) + b"".join(_SIZE.pack(each.nbytes) for each in beside) + data


def sizes(head: bytes | bytearray) -> tuple[int, int]:
    """The number of buffers beside a message and the size of the message, of the `HEAD` of its frame. Raises `BadMessage`."""
    mark, count, size = HEAD.unpack(head)
    if mark != MARK:
        raise not_a_message(head)
    return count, size


def not_a_message(data: bytes | bytearray) -> BadMessage:
    """The error for data that is no message."""
    return BadMessage(f"it wrote {excerpt(data)} where messages are sent: engines may print to stdout only")


def excerpt(data: bytes | bytearray) -> str:
    """The beginning of what was received, as text: of its first line, at most 80 bytes."""
    line = bytes(data).partition(b"\n")[0]
    return repr(line[:_SHOWN].decode("utf-8", "replace")) + ("..." if len(line) > _SHOWN else "")

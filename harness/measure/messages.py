"""The messages between a measuring worker, whose engine renders or traces rays, and its parent. Engines share the worker's
process, so that what it sends is checked."""

from __future__ import annotations

import pickle
from typing import Any, NamedTuple, TypeVar

from engines.processes import Channel, records
from engines.processes.records import Count, Counts, Fields, Flag, Integer, Items, Numbers, Seconds, SecondsOrNone, Text

MOST_BYTES = 1 << 24
"""Of one message."""
MOST_CHARACTERS = 2000
"""Of a text that an engine's process sends for people to read."""
T = TypeVar("T")


class Job(NamedTuple):
    """To the worker: calls `function`, module:function, with the engine, the `request` and the parent's end."""

    function: str
    request: Any


class Go(NamedTuple):
    """To the worker: the film has been used; `enough`: it is to be the last one."""

    enough: bool = False


class Imported(NamedTuple):
    """The engine is there after `seconds`; `code` is a hash of its sources. `forks`: every job gets a process of its own."""

    seconds: Seconds
    version: Text
    code: Text
    forks: Flag


class Prepared(NamedTuple):
    """The phases of a cold start."""

    load_seconds: Seconds
    build_seconds: Seconds
    compile_seconds: Seconds


class Point(NamedTuple):
    """A checkpoint, whose film waits in the request's file; the worker waits for `Go`.

    `seconds` and `rays` as in `clock.Point`. Its timed call `began` and `ended` at these moments of `monotonic`; `alive`: the
    threads that there were after it.
    """

    spp: Count
    seconds: Seconds
    rays: SecondsOrNone = None
    overshoots: Flag = False
    began: Seconds = 0.0
    ended: Seconds = 0.0
    alive: Counts = ()


class Traced(NamedTuple):
    """A set of rays was traced `passes` times in `seconds`; the answers wait in the request's file."""

    seconds: Seconds
    passes: Count
    began: Seconds = 0.0
    ended: Seconds = 0.0
    alive: Counts = ()


class Results(NamedTuple):
    """What a job of another room has found."""

    results: Items


class End(NamedTuple):
    """A job is done. `machine`: what disturbed its timed calls, see `contention`."""

    counters: Numbers
    machine: Fields
    warm_build_seconds: SecondsOrNone = None


class Failed(NamedTuple):
    """A job failed, or the import did."""

    message: Text


class Unwritten(NamedTuple):
    """A film or answers could not be handed over, which is no failure of the engine."""

    message: Text


class Idle(NamedTuple):
    """The process of a job has ended with this status, negative for a signal."""

    status: Integer


ANSWERS = (Imported, Prepared, Point, Traced, Results, End, Failed, Unwritten, Idle)
Answer = Imported | Prepared | Point | Traced | Results | End | Failed | Unwritten | Idle


def answer_of(data: bytes | bytearray) -> Answer:
    """A worker's message. Raises `BadMessage`."""
    answer: Answer = records.decoded(data, ANSWERS)
    if isinstance(answer, (Failed, Unwritten)):
        return answer._replace(message=" ".join(answer.message.split())[:MOST_CHARACTERS])
    return answer


class Parent:
    """The parent's end of a worker's channel. Where it has gone, the process ends."""

    def __init__(self, descriptor: int) -> None:
        self._channel = Channel.at(descriptor, exits=True)

    def send(self, answer: Answer) -> None:
        self._channel.send(records.encoded(answer))

    def receive(self, expected: type[T]) -> T:
        """What the parent sends next, of this type. It is trusted, and so may be pickled."""
        found = pickle.loads(self._channel.receive().data)
        assert isinstance(found, expected)
        return found

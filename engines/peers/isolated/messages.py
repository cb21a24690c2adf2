"""What goes between an engine's process and the one that uses it: requests there, answers here, pickled."""

from __future__ import annotations

from typing import Any, NamedTuple


class Request(NamedTuple):
    """A method of the server with its arguments. `drop` has no answer."""

    verb: str
    arguments: tuple[Any, ...] = ()


class Done(NamedTuple):
    """The answer to a request."""

    result: Any


class Failed(NamedTuple):
    """The error in place of an answer, with its traceback there."""

    error: BaseException
    traceback: str


class FilmReady(NamedTuple):
    """A film that can be read, on the way to an answer. `size` (width, height) where its memory is new: its descriptor follows.
    After one of a `callback` a `GoOn` is awaited."""

    callback: bool
    size: tuple[int, int] | None
    bad_samples: Any


class GoOn(NamedTuple):
    """Whether a render goes on after its callback."""

    yes: bool

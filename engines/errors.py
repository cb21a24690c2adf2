"""The errors a user can cause. Each message says where, what was found and what is expected."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable

MOST_NAMES = 100
"""Known names that a message lists."""


class RaybenchError(Exception):
    """Base of every error caused by input; the command line prints it without a traceback and exits with 2.

    Its text is one line whatever names it quotes: line feeds and terminal codes in it are shown as escapes.
    """

    def __str__(self) -> str:
        text = super().__str__()
        if text.isprintable():
            return text
        return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)


class SceneError(RaybenchError):
    """A scene, mesh or image file that cannot be used."""


class ConfigError(RaybenchError):
    """An experiment or a command line that cannot be run."""


class UnknownName(RaybenchError):
    """A name or option that does not exist."""

    def __init__(self, kind: str, found: object, known: Iterable[str]) -> None:
        self.kind, self.found, self.known = kind, found, tuple(known)
        super().__init__(f"unknown {kind} {found!r}: {suggestion(str(found), self.known)}")

    def __reduce__(self) -> tuple[type[UnknownName], tuple[str, object, tuple[str, ...]]]:
        return UnknownName, (self.kind, self.found, self.known)  # worker processes send errors home pickled


class Unsupported(RaybenchError):
    """A scene or setting that an engine cannot do; the message is what `Engine.why_not` answers."""


def why_unsupported(function: Callable[..., object], *arguments: object) -> str | None:
    """The words of the `Unsupported` that a call raises; None where it raises none."""
    try:
        function(*arguments)
    except Unsupported as error:
        return str(error)
    return None


class RendererFailed(RaybenchError):
    """A renderer that crashed, or left no image or an unusable one."""


def suggestion(found: str, known: Iterable[str]) -> str:
    """The second half of an unknown-name message: the nearest known name, if any is near, and all of them if they
    are not too many."""
    names = sorted(map(str, known))
    near = difflib.get_close_matches(found, names, n=1, cutoff=0.6)
    guess = f"did you mean {near[0]!r}? " if near else ""
    more = f" and {len(names) - MOST_NAMES} more" if len(names) > MOST_NAMES else ""
    return f"{guess}known: {', '.join(names[:MOST_NAMES]) or 'none'}{more}"

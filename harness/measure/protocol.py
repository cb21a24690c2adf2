"""The messages of a worker, checked as they arrive: an engine shares the worker's process and can write to its pipes."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping
from typing import Any

from harness.config.kinds import is_number

MOST_BYTES = 1 << 24
"""Of one message."""
_SHOWN = 80
LARGEST = sys.float_info.max
MOST_WORDS = 2000
"""Characters of a message that an engine's process sends for people to read."""


class BadMessage(Exception):
    """Something that is no message; says what was found and what is expected."""


def _seconds(value: Any) -> bool:
    return is_number(value) and 0 <= value <= LARGEST  # not isfinite: an integer may be too large for that


def _count(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and value > 0


def _is(*kinds: type) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, kinds)


def _numbers(value: Any) -> bool:
    return isinstance(value, dict) and all(is_number(each) and abs(each) <= LARGEST for each in value.values())


def _window(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and all(map(_seconds, value))


def _ids(value: Any) -> bool:
    return isinstance(value, list) and all(map(_count, value))


NUMBER = (_seconds, "a finite number from 0 on")
FIELDS: Mapping[str, Mapping[str, tuple[Callable[[Any], bool], str]]] = {
    "import": {
        "seconds": NUMBER,
        "version": (_is(str), "text"),
        "code": (_is(str), "text"),
        "forks": (_is(bool), "true or false"),
    },
    "prepared": dict.fromkeys(("load_seconds", "build_seconds", "compile_seconds"), NUMBER),
    "point": {"spp": (_count, "an integer above 0"), "seconds": NUMBER},
    "verified": {"results": (_is(list), "a list")},
    "traced": {"seconds": NUMBER, "passes": (_count, "an integer above 0")},
    "end": {},
    "failed": {"message": (_is(str), "text")},
    "unwritten": {"message": (_is(str), "text")},
    "idle": {"status": (_is(int), "an integer")},
}
"""What a message of each kind must have. A cell's "point" has `rays`, too, the `window` of its timed call in moments of
`monotonic` and the threads that were `alive` after it, and its "end" `counters`, `machine` and `warm_build_seconds`."""
OPTIONAL: Mapping[str, tuple[Callable[[Any], bool], str]] = {
    "rays": (lambda value: value is None or _seconds(value), f"{NUMBER[1]}, or null"),
    "counters": (_numbers, "a mapping to finite numbers"),
    "machine": (_is(dict), "a mapping"),
    "warm_build_seconds": NUMBER,
    "window": (_window, "two finite numbers from 0 on"),
    "alive": (_ids, "a list of thread ids"),
}


def parsed(line: bytes) -> dict[str, Any]:
    """A line as a message, its text encodable as UTF-8. Raises `BadMessage`."""
    try:
        # Half a surrogate pair, which JSON can spell, could not be written into a file later.
        message = json.loads(line)
        message = json.loads(json.dumps(message, ensure_ascii=False).encode("utf-8", "replace"))
    except (ValueError, RecursionError) as error:
        raise BadMessage(f"it wrote {excerpt(line)} where messages are sent: engines may print to stdout only") from error
    kind = message.get("did") if isinstance(message, dict) else None
    if not isinstance(kind, str) or kind not in FIELDS:
        raise BadMessage(f"it wrote {excerpt(line)} where messages are sent: engines may print to stdout only")
    wanted = {**FIELDS[kind], **{key: check for key, check in OPTIONAL.items() if key in message}}
    for key, (holds, words) in wanted.items():
        if not holds(message.get(key)):
            raise BadMessage(f"its message {kind!r} has {key} = {message.get(key)!r:.{_SHOWN}}: {words} is expected")
    if "message" in message:
        message["message"] = " ".join(message["message"].split())[:MOST_WORDS]
    return message


def excerpt(data: bytes) -> str:
    """The beginning of what was received, as text."""
    return repr(data[:_SHOWN].decode("utf-8", "replace")) + ("..." if len(data) > _SHOWN else "")

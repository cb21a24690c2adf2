"""Records as messages: NamedTuples of plain data, written as JSON and checked as they arrive.

The annotation of each field is one of the types here, or another `Annotated` with a `Check`: an engine shares the process that
sends, and may have written the message.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from typing import Annotated, Any, NamedTuple, TypeVar, get_type_hints

from engines.processes.channel import BadMessage, not_a_message

LARGEST = sys.float_info.max
_SHOWN = 80
T = TypeVar("T")


class Check(NamedTuple):
    """What must hold of a value as JSON has it, and the words for what is expected."""

    holds: Callable[[Any], bool]
    expected: str


def _is(*kinds: type) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, kinds) and (bool in kinds or not isinstance(value, bool))


def _finite(value: Any) -> bool:
    return _is(int, float)(value) and abs(value) <= LARGEST  # not isfinite: an integer may be too large for that


def _seconds(value: Any) -> bool:
    return _finite(value) and value >= 0


def _count(value: Any) -> bool:
    return _is(int)(value) and value > 0


def _each(holds: Callable[[Any], bool], of: type) -> Callable[[Any], bool]:
    return lambda value: isinstance(value, of) and all(map(holds, value.values() if of is dict else value))


NUMBER = "a finite number from 0 on"
Seconds = Annotated[float, Check(_seconds, NUMBER)]
SecondsOrNone = Annotated[float | None, Check(lambda value: value is None or _seconds(value), f"{NUMBER}, or null")]
Count = Annotated[int, Check(_count, "an integer above 0")]
Integer = Annotated[int, Check(_is(int), "an integer")]
Flag = Annotated[bool, Check(_is(bool), "true or false")]
Text = Annotated[str, Check(_is(str), "text")]
Fields = Annotated[Mapping[str, Any], Check(_is(dict), "a mapping")]
Numbers = Annotated[Mapping[str, float], Check(_each(_finite, dict), "a mapping to finite numbers")]
Items = Annotated[Sequence[Any], Check(_is(list), "a list")]
Counts = Annotated[Sequence[int], Check(_each(_count, list), "a list of integers above 0")]


def kind(record: type) -> str:
    """What a record is called in messages."""
    return record.__name__.lower()


def encoded(record: Any) -> bytes:
    """A record, a NamedTuple, as a message."""
    return json.dumps({"type": kind(type(record)), **record._asdict()}).encode()


def decoded(data: bytes | bytearray, kinds: Iterable[type[T]]) -> T:
    """The record of a message, of one of the types `kinds`, its text encodable as UTF-8. Raises `BadMessage`."""
    try:
        # Half a surrogate pair, which JSON can spell, could not be written into a file later.
        fields = json.loads(data)
        fields = json.loads(json.dumps(fields, ensure_ascii=False).encode("utf-8", "replace"))
    except (ValueError, RecursionError) as error:
        raise not_a_message(data) from error
    name = fields.pop("type", None) if isinstance(fields, dict) else None
    record: Any = {kind(each): each for each in kinds}.get(name) if isinstance(name, str) else None
    if record is None:
        raise not_a_message(data)
    checks = _checks(record)
    for key in fields.keys() - checks.keys():
        raise BadMessage(f"its message {name!r} has {key!r:.{_SHOWN}}: {', '.join(checks)} are expected")
    for key, check in checks.items():
        if (key in fields or key not in record._field_defaults) and not check.holds(fields.get(key)):
            raise BadMessage(f"its message {name!r} has {key} = {fields.get(key)!r:.{_SHOWN}}: {check.expected} is expected")
    return record(**fields)


@cache
def _checks(record: type) -> Mapping[str, Check]:
    return {key: hint.__metadata__[0] for key, hint in get_type_hints(record, include_extras=True).items()}

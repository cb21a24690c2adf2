"""Messages of a JSON header and bytes, the same from worker to server and from server to page.

    4 bytes, little endian: length of the header | header, UTF-8 JSON | payload (pixels, a file) or nothing

A header's `type` says what the message is. Requests of the page are JSON texts with a `type` (`requests`).
"""

from __future__ import annotations

import json
import math
import traceback
from collections.abc import Mapping
from typing import Any

import psutil

from engines.errors import RaybenchError
from harness.processes import one_line

MAX_REQUEST_BYTES = 1 << 16
"""Bytes of a request, at most."""
LENGTH_BYTES = 4
STARTS_RENDERING = frozenset({"open", "resume", "camera", "drag", "race", "dahlquist"})
"""Requests that make a worker render: they need a render slot."""
LATEST_ONLY = frozenset({"camera", "drag", "probe", "tone", "switches", "move"})
"""Requests that replace a waiting one of the same type (and finger)."""


def packed(header: Mapping[str, Any], payload: bytes | memoryview = b"") -> bytes:
    """A message. Numbers that JSON does not have (NaN, infinities) become null."""
    text = json.dumps(_finite(header), allow_nan=False, separators=(",", ":")).encode()
    return b"".join((len(text).to_bytes(LENGTH_BYTES, "little"), text, payload))


def header_of(message: bytes) -> dict[str, Any]:
    """The header of a message."""
    end = LENGTH_BYTES + int.from_bytes(message[:LENGTH_BYTES], "little")
    return json.loads(message[LENGTH_BYTES:end])


def coalescing_key(type: str, finger: int | None) -> tuple[str, int | None] | None:
    """The key of a request in a coalescing queue; None for a request that replaces no other."""
    return (type, finger) if type in LATEST_ONLY else None


def error_message(text: str) -> bytes:
    """A message that the page shows as an error."""
    return packed({"type": "error", "text": text})


def failure_message(error: Exception) -> bytes:
    """The error message of an exception; one that is no `RaybenchError` is a mistake of ours and printed in full."""
    if not isinstance(error, RaybenchError):
        traceback.print_exception(error)
    return error_message(one_line(error))


def state_message(state: str, seq: int, **fields: Any) -> bytes:
    """What a worker does: `state` is idle, busy, stopped or finished; `seq` is of the last request that starts rendering."""
    memory = psutil.Process().memory_info().rss
    return packed({"type": "state", "state": state, "seq": seq, "activity": "", "memory_bytes": memory, **fields})


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _finite(child) for key, child in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(child) for child in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

"""Messages: a JSON header and bytes, the same from worker to server and from server to page.

    4 bytes, little endian: length of the header | header, UTF-8 JSON | payload (pixels, a file) or nothing

A header's `is` says what it tells. The page answers in JSON text alone, whose `do` says what it wants.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any

LONGEST_REQUEST = 1 << 16
"""Bytes of a message from a page."""
LENGTH_BYTES = 4
BEGIN_WORK = frozenset({"open", "resume", "camera", "drag", "race", "demo"})
"""Requests that have a worker render: they need a turn."""
LATEST = frozenset({"camera", "drag", "probe", "tone", "switches", "move"})
"""Requests of which the last of a kind alone counts; of those of fingers, the last of each finger."""


def packed(header: Mapping[str, Any], payload: bytes | memoryview = b"") -> bytes:
    """A message. Numbers that JSON does not have (NaN, infinities) become null."""
    text = json.dumps(_finite(header), allow_nan=False, separators=(",", ":")).encode()
    return b"".join((len(text).to_bytes(LENGTH_BYTES, "little"), text, payload))


def header_of(message: bytes) -> dict[str, Any]:
    """The header of a message."""
    end = LENGTH_BYTES + int.from_bytes(message[:LENGTH_BYTES], "little")
    return json.loads(message[LENGTH_BYTES:end])


def latest_key(do: str, finger: int | None) -> tuple[str, int | None] | None:
    """The same for requests of which the later one replaces the earlier; None for those that all count."""
    return (do, finger) if do in LATEST else None


def problem(text: str) -> bytes:
    """What the page shows as an error."""
    return packed({"is": "problem", "text": text})


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _finite(child) for key, child in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(child) for child in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

"""One spelling for plain data, and the hash of it: two requests that mean the same have the same id."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from typing import Any

from engines.errors import ConfigError

ID_LENGTH = 16
"""Hexadecimal digits kept of a SHA-256: 64 bits, no collision among millions of cells."""


def canonical(value: Any) -> Any:
    """Plain data in one spelling: keys sorted, whole floats as integers, tuples as lists.

    Raises `ConfigError` for numbers that are not finite.
    """
    if isinstance(value, Mapping):
        return {str(key): canonical(child) for key, child in sorted(value.items())}
    if isinstance(value, (list, tuple)):
        return [canonical(child) for child in value]
    if isinstance(value, float):
        if not math.isfinite(value):
            raise ConfigError(f"{value}: only finite numbers can be part of an experiment")
        return int(value) if value == int(value) else value
    return value


def canonical_json(value: Any) -> str:
    return json.dumps(canonical(value), separators=(",", ":"), ensure_ascii=True)


def digest(value: Any) -> str:
    """The id of plain data."""
    return hashlib.sha256(canonical_json(value).encode()).hexdigest()[:ID_LENGTH]

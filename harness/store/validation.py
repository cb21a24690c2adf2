"""Checks what was loaded from a results folder, once, at the door, and makes records of it; see `records`.

Folders come from other machines and other people. Besides the types of the records: numbers fit 64 bits, text is Unicode, and
nothing is nested deeper than `MAX_DEPTH`. What is wrong is said in a line: file, line, field, what is expected.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Mapping
from functools import cache
from typing import Any

from pydantic import TypeAdapter, ValidationError

from engines.errors import ConfigError
from harness.config import recorded
from harness.store.records import AnyEvent, Event, Manifest, ReferenceMeta

FORMAT_VERSION = 3
"""Of manifest, events and references together: the manifest's `raybench_results`."""
MAX_DEPTH = 64
LARGEST_INTEGER = 2**63


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def event(data: Any, where: str) -> AnyEvent:
    """The event of a line's data. Raises `ConfigError`, one line that begins with `where`, if this is none."""
    return _read(Event, data, where)


def manifest(data: Any, where: str) -> Manifest:
    """The manifest of a file's data. Raises `ConfigError` if this is none, or one of another version of the format."""
    version(data, where)
    found: Manifest = _read(Manifest, data, where)
    if found.config:
        recorded(found.config, where)
    for index, source in enumerate(found.merged):
        manifest({"raybench_results": FORMAT_VERSION, **source}, f"{where} merged[{index}]")
    return found


def version(data: Any, where: str) -> None:
    """Raises `ConfigError` if this is no manifest of the version of the format that is read here."""
    found = data.get("raybench_results") if isinstance(data, dict) else None
    if not isinstance(found, int) or isinstance(found, bool):
        raise ConfigError(f"{where}: 'raybench_results: {FORMAT_VERSION}' is expected: this is no manifest of results")
    if found != FORMAT_VERSION:
        age = "a newer raybench wrote it" if found > FORMAT_VERSION else "an older raybench wrote it: measure again"
        raise ConfigError(f"{where}: results of format {found}, and this raybench reads {FORMAT_VERSION}: {age}")


def reference_meta(data: Any, where: str) -> ReferenceMeta:
    """The metadata of a reference. Raises `ConfigError` if this is none."""
    return _read(ReferenceMeta, data, where)


def made(kind: Any, fields: Mapping[str, Any], where: str, part: str = "") -> Any:
    """The record of a kind with these fields, Python's own values. Raises `ConfigError` as the readers do."""
    return _checked(lambda: _adapter(kind).validate_python(dict(fields)), where, part)


def _read(kind: Any, data: Any, where: str, part: str = "") -> Any:
    """As JSON: there a list stands for a tuple, and nothing else is converted."""

    def read() -> Any:
        _plain(data)
        return _adapter(kind).validate_json(json.dumps(data, ensure_ascii=False))

    return _checked(read, where, part)


def _checked(make: Callable[[], Any], where: str, part: str) -> Any:
    try:
        return make()
    except ValidationError as error:
        raise ConfigError(f"{where}: {_first(error, part)}") from None
    except ValueError as error:
        raise ConfigError(f"{where}: {error}") from None


def _plain(value: Any, depth: int = 0) -> None:
    """Raises `ValueError` for what JSON can say and programs cannot hold."""
    if isinstance(value, str):
        if not value.isascii() and any("\ud800" <= letter <= "\udfff" for letter in value):
            raise ValueError("text that is no Unicode: half of a surrogate pair")
    elif isinstance(value, int):
        if not -LARGEST_INTEGER <= value < LARGEST_INTEGER:
            raise ValueError("an integer of more than 64 bits")
    elif isinstance(value, (dict, list)):
        if depth == MAX_DEPTH:
            raise ValueError(f"nested deeper than {MAX_DEPTH}")
        for child in value:
            _plain(child, depth + 1)
            if isinstance(value, dict):
                _plain(value[child], depth + 1)


def _first(error: ValidationError, part: str) -> str:
    """The first thing that is wrong, in a line: where in the data, what was found, what is expected."""
    found = error.errors(include_url=False, include_context=False)[0]
    field = re.sub(r"\.(\d+)", r"[\1]", ".".join(map(str, found["loc"])))
    message = found["msg"].removeprefix("Value error, ")
    shown = found["input"]
    said = "" if isinstance(shown, (Mapping, list)) else f" = {shown!r:.120}"
    return " ".join(f"{part}{field or 'the whole'}{said}: {message}".split())

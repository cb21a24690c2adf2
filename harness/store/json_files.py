"""JSON files: read from regular files alone, written in one step."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from engines.errors import ConfigError
from engines.input_files import open_regular
from harness.store import atomic


def read_json(path: Path) -> Any:
    """What a JSON file says. Raises `OSError`, and `ConfigError` for what is no JSON."""
    try:
        with open_regular(path) as file:
            return json.loads(file.read())
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{path}: not JSON: {error}") from error


def write_json(path: Path, data: Any) -> None:
    """Replaces a file by JSON in one step: readers see the old or the new one, whole. Raises `ConfigError`."""
    atomic.write_text(path, json.dumps(data, indent=2, ensure_ascii=False) + "\n", durable=True)

"""verify.json: the results of a run as plain data, with the version of the format."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from engines.errors import ConfigError
from harness.check_results import CheckResult, counts
from harness.store import read_json

FORMAT_VERSION = 2
"""2: outcomes are pass, xfail, fail and skip; the rows are `results`."""
NOT_FINITE = {None: math.nan, "inf": math.inf, "-inf": -math.inf}
NUMBERS = {name for name, field in CheckResult.model_fields.items() if field.annotation is float}


def document(results: Sequence[CheckResult], quick: bool) -> dict[str, Any]:
    """Plain data. Numbers that JSON lacks are null (NaN) or the texts "inf" and "-inf"."""
    rows = [{key: _plain(value) for key, value in result} for result in results]
    return {"raybench_verify": FORMAT_VERSION, "quick": quick, "outcomes": dict(counts(results)), "results": rows}


def read_results(path: str | Path) -> list[CheckResult]:
    """The results in a verify.json. Raises `ConfigError` for what is none, and for one of another format version."""
    try:
        data = read_json(Path(path))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror or error}") from error
    version = data.get("raybench_verify") if isinstance(data, dict) else None
    if not isinstance(version, int) or isinstance(version, bool):
        raise ConfigError(f"{path}: not results of raybench verify: the key 'raybench_verify' is missing")
    if version != FORMAT_VERSION:
        raise ConfigError(f"{path}: format {version}, this raybench reads {FORMAT_VERSION}: run raybench verify again")
    try:
        return TypeAdapter(list[CheckResult]).validate_python(_numbers_of(data.get("results")))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = ".".join(map(str, ("results", *first["loc"])))
        raise ConfigError(f"{path}: {place} = {first['input']!r}: {first['msg']}") from error


def _numbers_of(rows: Any) -> Any:
    """Rows with numbers in the place of what `document` writes for those that JSON lacks."""
    if not (isinstance(rows, list) and all(isinstance(row, dict) for row in rows)):
        return rows
    return [
        {
            key: NOT_FINITE.get(value, value) if key in NUMBERS and isinstance(value, str | None) else value
            for key, value in row.items()
        }
        for row in rows
    ]


def _plain(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else "inf" if value > 0 else "-inf"
    return value

"""What the fields of a results folder's records are: types with their ranges."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field, PlainSerializer, PlainValidator

from engines.choices import Choice
from harness.metrics import METRICS, epsilon_of
from harness.store import confined


def _path(text: str) -> str:
    if not confined.is_relative(text):
        raise ValueError("a relative path without '..' is expected")
    return text


def _metric(text: str) -> str:
    if (epsilon := epsilon_of(text)) is not None:
        if not 0.0 < epsilon <= 1e6:
            raise ValueError("an epsilon in (0, 1e6] is expected")
    elif text in ("relmse", "trimmed_relmse") or text not in METRICS:
        raise ValueError("the name of a metric is expected, such as relmse_e0.01")
    return text


def _unicode(value: Any) -> Any:
    """What is no Unicode, as parts of file names may be, becomes `?`."""
    return value.encode(errors="replace").decode() if isinstance(value, str) and not value.isascii() else value


def _one_nan(value: float) -> float:
    """NaN as one object: Python calls collections that hold the same one equal."""
    return math.nan if math.isnan(value) else value


def _choice(value: Any) -> Choice:
    if isinstance(value, Choice):
        return value
    if not isinstance(value, Mapping) or not isinstance(value.get("name"), str):
        raise ValueError("a mapping with a 'name' is expected")
    return Choice.of(value)


Id = Annotated[str, Field(pattern=confined.ID)]
Text = Annotated[str, BeforeValidator(_unicode)]
ImagePath = Annotated[str, AfterValidator(_path)]
Seconds = Annotated[float, Field(ge=0, le=1e10)]
Count = Annotated[int, Field(ge=0, le=2**62)]
Samples = Annotated[int, Field(ge=1, le=2**40)]
Pixels = Annotated[int, Field(ge=1, le=65_536)]
Threads = Annotated[int, Field(ge=1, le=65_536)]
MetricName = Annotated[str, AfterValidator(_metric)]
Target = Annotated[float, Field(gt=0, le=1e30)]
Numbers = dict[str, Annotated[float, AfterValidator(_one_nan)] | None]
Setting = Annotated[Choice, PlainValidator(_choice), PlainSerializer(Choice.describe)]
"""A shader, sampler or accelerator with its options, in JSON `{"name": ..., option: value}`."""
AsObject = PlainSerializer(lambda value: None if value is None else value._asdict())
"""A named tuple as a JSON object."""

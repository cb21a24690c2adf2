"""The settings with which an engine renders a cell: one type in plans, requests of workers and events."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from engines.choices import Choice

CHOICES = ("shader", "sampler", "accelerator")
"""Settings that have options."""


@dataclass(frozen=True, slots=True)
class CellSettings:
    """What an engine is told about a cell, beside scene and seed. `width` and `height` are in pixels, `precision` is float64 or
    float32; a choice has all of its options."""

    shader: Choice
    sampler: Choice
    accelerator: Choice
    precision: str
    threads: int
    width: int
    height: int

    @classmethod
    def of(cls, plain: Mapping[str, Any]) -> CellSettings:
        """The settings that `describe` made `plain` data of, which may hold other keys beside."""
        given = {key: plain[key] for key in cls.__dataclass_fields__}
        return cls(**{**given, **{kind: Choice.of(given[kind]) for kind in CHOICES}})

    def describe(self) -> dict[str, Any]:
        """Plain data, as specs, requests and events hold it."""
        plain = {key: getattr(self, key) for key in self.__dataclass_fields__}
        return {**plain, **{kind: plain[kind].describe() for kind in CHOICES}}

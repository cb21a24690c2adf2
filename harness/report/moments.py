"""The moment at which contestants are compared in figures and tables of papers: after a time, at a number of samples, at the
end."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

from engines.errors import ConfigError
from harness.store.records import Point


class Moment(NamedTuple):
    """After `seconds`, at `spp`, or at the last checkpoint where both are None."""

    seconds: float | None = None
    spp: int | None = None

    def of(self, points: Sequence[Point]) -> Point | None:
        """The checkpoint of a cell at this moment: the last one within the time, or the one at the samples; None if there is
        none."""
        if self.spp is not None:
            points = [point for point in points if point.spp == self.spp]
        elif self.seconds is not None:
            points = [point for point in points if point.seconds <= self.seconds]
        return points[-1] if points else None

    def __str__(self) -> str:
        if self.spp is not None:
            return f"at {self.spp} spp"
        return f"within {self.seconds:g} s" if self.seconds is not None else "at the end"


def moment_of(text: str) -> Moment:
    """A moment from `2s`, `64spp` or `last`. Raises `ConfigError`."""
    for unit, kind in (("spp", int), ("s", float)):
        if text.endswith(unit):
            try:
                value = kind(text.removesuffix(unit))
            except ValueError:
                break
            if 0 < value < math.inf:
                return Moment(spp=int(value)) if unit == "spp" else Moment(seconds=float(value))
    if text != "last":
        raise ConfigError(f"--at {text}: expected a time (2s), a number of samples (64spp) or last")
    return Moment()

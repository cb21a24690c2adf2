"""Parameters of BSDF models that are no plain numbers: what a texture gives, and tables."""

from __future__ import annotations

from typing import NamedTuple

from engines.scene import Color, Number, Texture

LUMINANCE = 3


class Lookup(NamedTuple):
    """A number that is looked up at each hit: a channel (0, 1, 2) of a texture or its luminance, held in [low, high]."""

    texture: Texture
    channel: int
    low: float
    high: float


class Table(NamedTuple):
    """Numbers that a model reads in `SurfaceInteraction.tables`; its parameter is the place of the first."""

    numbers: tuple[float, ...]


Parameter = float | Lookup | Table


def color_parameters(value: Color, high: float = 1.0) -> list[Parameter]:
    """Three parameters: the constant colour, or lookups."""
    if isinstance(value, tuple):
        return [float(channel) for channel in value]
    return [Lookup(value, channel, 0.0, high) for channel in range(3)]


def number_parameter(value: Number, low: float = 0.0, high: float = 1.0) -> float | Lookup:
    """One parameter: the constant number, or a lookup."""
    return float(value) if isinstance(value, int | float) else Lookup(value, LUMINANCE, low, high)

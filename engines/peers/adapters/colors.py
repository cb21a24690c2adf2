"""Colours and numbers that may be textures: their extremes, and multiples of them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from engines.scene import Checkerboard, Color, ImageTexture, MeshAttribute, Mixture, Number, Triple

LUMINANCE = np.array([0.212671, 0.715160, 0.072169])


def luminance(color: Triple) -> float:
    """The Y of linear sRGB."""
    return float(np.dot(LUMINANCE, color))


def largest(value: Color | Number) -> float:
    """The largest component that it has anywhere, or that meshes may give it."""
    if isinstance(value, MeshAttribute):
        return value.scale
    if isinstance(value, ImageTexture):
        return float(value.pixels.max())
    return max(*value.a, *value.b) if isinstance(value, Checkerboard) else float(np.max(value))


def least(value: Color | Number) -> float:
    """The least component that it has anywhere, or that meshes may give it."""
    if isinstance(value, MeshAttribute):
        return 0.0
    if isinstance(value, ImageTexture):
        return float(value.pixels.min())
    return min(*value.a, *value.b) if isinstance(value, Checkerboard) else float(np.min(value))


def scaled(value: Color, factor: Any) -> Any:
    """A colour times a number, or times three; an attribute times a number."""
    if isinstance(value, MeshAttribute):
        return replace(value, scale=value.scale * float(factor))
    factors = np.broadcast_to(np.asarray(factor, np.float64), (3,))
    if isinstance(value, ImageTexture):
        wide = factors if value.pixels.shape[2] == 3 or len(set(factors)) > 1 else factors[:1]
        return replace(value, pixels=(value.pixels * wide).astype(np.float32))
    if isinstance(value, Checkerboard):
        return replace(value, a=scaled(value.a, factors), b=scaled(value.b, factors))
    red, green, blue = (float(part * scale) for part, scale in zip(value, factors, strict=True))
    return red, green, blue


def mirror_share(part: Mixture) -> float:
    """The share of the mirror in a blend that replaces a mixture of a diffuse and a mirror lobe; 0 without a mirror, 1 alone.

    Divided by their shares, neither lobe has a component above 1 where `mixture_lacks` nothing.
    """
    diffuse, mirror = largest(part.kd), largest(part.ks)
    return mirror / (diffuse + mirror) if mirror > 0.0 else 0.0

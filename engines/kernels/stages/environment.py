"""Environment images: bilinear radiance, and importance sampling by texel (docs/transport.md)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from engines.kernels.compile.jit import inline
from engines.kernels.compile.records import address_of, prefetch
from engines.kernels.compile.values import pick, select
from engines.kernels.lane.elementary import arccos, arctan2
from engines.kernels.lane.vector import Vec3, dot, sin_cos_turn


@inline
def first_above(values, start, n, u):
    """The first index in [0, n) with values[start + index] > u, else n - 1. Its branches depend on n alone."""
    low, n = np.int64(0), np.int64(n)
    while n > 1:
        half = n // 2
        low = pick(values[start + low + half - 1] > u, low, low + half)
        n -= half
    return low


@inline
def first_above_in(values, start, n, steps, u):
    """The same in a given number of steps, enough for n; 0 where n is 0. `values[start]` must exist."""
    low = np.int64(0)
    for _ in range(steps):
        half = n >> 1
        before = pick(half > 0, low + half - 1, low)
        low = pick(values[start + before] > u, low, low + half)
        n -= half
    return low


@inline
def guide_entry(n, u):
    """The index of the entry of a guide table (n,) that says where the search for `u` begins."""
    return max(min(int(u * n), n - 1), 0)


@inline
def first_above_from(values, start, first, n, u):
    """The same as `first_above`, from the index `first` on, at which or beyond which it lies: a step or two on average, where
    `first` comes from a guide table (Chen and Asau 1974)."""
    index = int(first)
    while index < n - 1 and not values[start + index] > u:
        index += 1
    return index


@inline
def direction_to_uv(x, y, z):
    """(u, v) in [0, 1] of a unit direction: -z at u = 0, +z at 1/2, +y at v = 0. Vector code, as is the way back."""
    u = arctan2(x, -z) * (0.5 / math.pi)
    y = select(y < 1.0, select(y > -1.0, y, -1.0), 1.0)
    return u - np.floor(u), arccos(y) * (1.0 / math.pi)


@inline
def uv_to_direction(u, v):
    """(direction, sine of its angle to the y axis)."""
    sine_phi, cosine_phi = sin_cos_turn(u)
    sine, cosine = sin_cos_turn(v * 0.5)
    return Vec3(sine_phi * sine, cosine, -cosine_phi * sine), sine


@inline
def to_image(axes, d):
    """A direction of the scene in the coordinates of a rotated image, whose `EnvironmentRow` is given."""
    return Vec3(dot(axes.x, d), dot(axes.y, d), dot(axes.z, d))


@inline
def to_scene(axes, d):
    """The way back."""
    return axes.x * d.x + axes.y * d.y + axes.z * d.z


class Texels(NamedTuple):
    """The four texels around a place on an image, by index, and how near the place is to the right and the lower ones."""

    left: int
    right: int
    above: int
    below: int
    fx: float
    fy: float


@inline
def texels_at(width, height, axes, u, v):
    """Columns wrap, rows clamp. `above` and `below` are where rows begin. NaN, of a direction that is NaN, gives some texel."""
    x, y = u * width - 0.5, v * axes.rows - axes.first_row
    left, top = math.floor(x), math.floor(y)
    x0, y0 = int(left), min(max(int(top), 0), height - 1)
    x0 = min(max(x0 + width if x0 < 0 else x0, 0), width - 1)
    x1, y1 = x0 + 1 if x0 + 1 < width else 0, max(min(int(top) + 1, height - 1), 0)
    return Texels(x0, x1, y0 * width, y1 * width, x - left, y - top)


@inline
def radiance(image, at):
    """Bilinear between texel centres, in float64."""
    above = image[at.above + at.left] * (1.0 - at.fx) + image[at.above + at.right] * at.fx
    below = image[at.below + at.left] * (1.0 - at.fx) + image[at.below + at.right] * at.fx
    return above * (1.0 - at.fy) + below * at.fy


@inline
def texel_of(width, height, u, v):
    """The index of the texel that holds (u, v)."""
    column, row = max(min(int(u * width), width - 1), 0), max(min(int(v * height), height - 1), 0)
    return row * width + column


@inline
def pdf_solid_angle(density, sine):
    """From the density in (u, v); 0 at the poles."""
    return density / (2.0 * math.pi * math.pi * sine) if sine > 0.0 else 0.0


@inline
def prefetch_texels(scene, axes, u, v, real_bytes):
    """Starts loading what `radiance` reads at (u, v)."""
    width, height = scene.environment_width, scene.environment_height
    at, texels = texels_at(width, height, axes, u, v), address_of(scene.environment)
    prefetch(texels + 3 * real_bytes * (at.above + at.left))
    prefetch(texels + 3 * real_bytes * (at.above + at.right + 1) - 1)
    prefetch(texels + 3 * real_bytes * (at.below + at.left))
    prefetch(texels + 3 * real_bytes * (at.below + at.right + 1) - 1)

"""Environment images: bilinear radiance, and importance sampling by texel (docs/transport.md)."""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.lane.vector import Vec3, dot


@inline
def first_above(values, start, n, u):
    """The first index in [0, n) with values[start + index] > u, else n - 1."""
    low, high = 0, n - 1
    while low < high:
        middle = (low + high) // 2
        if values[start + middle] > u:
            high = middle
        else:
            low = middle + 1
    return low


@inline
def first_above_guided(values, start, guide, n, u):
    """The same, begun at the entry of a guide table for `u`: a step or two on average (Chen and Asau 1974)."""
    index = int(guide[start + max(min(int(u * n), n - 1), 0)])
    while index < n - 1 and not values[start + index] > u:
        index += 1
    return index


@inline
def direction_to_uv(x, y, z):
    """(u, v) in [0, 1] of a unit direction: -z at u = 0, +z at 1/2, +y at v = 0."""
    u = math.atan2(x, -z) / (2.0 * math.pi)
    return u - math.floor(u), math.acos(min(1.0, max(-1.0, y))) / math.pi


@inline
def uv_to_direction(u, v):
    phi, theta = 2.0 * math.pi * u, math.pi * v
    sine = math.sin(theta)
    return Vec3(math.sin(phi) * sine, math.cos(theta), -math.cos(phi) * sine)


@inline
def to_image(axes, d):
    """A direction of the scene in the coordinates of a rotated image, whose `EnvironmentRow` is given."""
    return Vec3(dot(axes.x, d), dot(axes.y, d), dot(axes.z, d))


@inline
def to_scene(axes, d):
    """The way back."""
    return axes.x * d.x + axes.y * d.y + axes.z * d.z


@inline
def radiance(image, width, height, axes, u, v):
    """Bilinear between texel centres; columns wrap, rows clamp. float64. NaN, of a direction that is NaN, reads some texel."""
    x, y = u * width - 0.5, v * axes.rows - axes.first_row
    left, top = math.floor(x), math.floor(y)
    fx, fy = x - left, y - top
    x0, x1 = int(left) % width, (int(left) + 1) % width
    y0, y1 = min(max(int(top), 0), height - 1), max(min(int(top) + 1, height - 1), 0)
    above = image[y0 * width + x0] * (1.0 - fx) + image[y0 * width + x1] * fx
    below = image[y1 * width + x0] * (1.0 - fx) + image[y1 * width + x1] * fx
    return above * (1.0 - fy) + below * fy


@inline
def pdf_solid_angle(density, width, height, u, v):
    """Of the texel that holds (u, v), per solid angle; 0 at the poles, and of NaN."""
    column, row = max(min(int(u * width), width - 1), 0), max(min(int(v * height), height - 1), 0)
    sine = math.sin(math.pi * v)
    return density[row * width + column] / (2.0 * math.pi * math.pi * sine) if sine > 0.0 else 0.0

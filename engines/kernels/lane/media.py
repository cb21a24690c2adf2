"""Homogeneous media: how far rays fly, what passes, and how it is scattered (docs/transport.md, "Media")."""

from __future__ import annotations

import math

from engines.kernels.compile.jit import inline
from engines.kernels.compile.values import const, select
from engines.kernels.compile.vec3 import Vec3
from engines.kernels.lane.elementary import exp, log
from engines.kernels.lane.target import sqrt
from engines.kernels.lane.vector import dot, sin_cos_turn, tangents, total

SPHERE_PDF = 0.25 / math.pi
"""Per solid angle, of directions that are uniform on the sphere."""


@inline
def _share_passed(sigma_t, distance):
    return select(sigma_t > 0.0, exp(-sigma_t * distance), 1.0)


@inline
def transmittance(sigma_t, distance):
    """The share of light that passes so many metres, inf too."""
    x, y, z = _share_passed(sigma_t.x, distance), _share_passed(sigma_t.y, distance), _share_passed(sigma_t.z, distance)
    return Vec3(x, y, z)


@inline
def _is_grey(sigma_t):
    return (sigma_t.x == sigma_t.y) & (sigma_t.x == sigma_t.z)


@inline
def _choose(takes, begin, size, sigma, begin0, size0, sigma0):
    return select(takes, begin, begin0), select(takes, size, size0), select(takes, sigma, sigma0)


@inline
def flight(sigma_t, throughput, u, least):
    """Metres to where the medium scatters a ray, by a number in [0, 1): of the channel that it chooses, in proportion to
    `throughput`. `least` is the smallest difference of such a number to 1."""
    place = u * total(throughput)
    begin, size, sigma = const(0.0, u), throughput.x, sigma_t.x
    second = (throughput.y > 0.0) & (throughput.x <= place)
    begin, size, sigma = _choose(second, throughput.x, throughput.y, sigma_t.y, begin, size, sigma)
    below = throughput.x + throughput.y
    third = (throughput.z > 0.0) & (below <= place)
    begin, size, sigma = _choose(third, below, throughput.z, sigma_t.z, begin, size, sigma)
    left = 1.0 - select(_is_grey(sigma_t), u, (place - begin) / select(size > 0.0, size, 1.0))
    left = select(left > least, left, least)
    return select(sigma > 0.0, -log(left) / sigma, math.inf)


@inline
def _density(sigma_t, throughput, least, way, scattered):
    """Of a channel, as far as it differs from the others: of scattering there, or of passing."""
    passed = select(sigma_t > least, exp(-(sigma_t - least) * way), 1.0)
    return select(throughput > 0.0, select(scattered, sigma_t, 1.0) * passed, 0.0)


@inline
def _lesser(sigma_t, throughput, least):
    return select((throughput > 0.0) & (sigma_t < least), sigma_t, least)


@inline
def flight_weight(sigma_t, throughput, way, scattered):
    """The weights of a ray that is scattered after so many metres, or that a surface has ended there: those of the balance
    heuristic over the channels."""
    least = _lesser(sigma_t.x, throughput.x, const(math.inf, way))
    least = _lesser(sigma_t.z, throughput.z, _lesser(sigma_t.y, throughput.y, least))
    x = _density(sigma_t.x, throughput.x, least, way, scattered)
    y = _density(sigma_t.y, throughput.y, least, way, scattered)
    z = _density(sigma_t.z, throughput.z, least, way, scattered)
    mean = throughput.x * x + throughput.y * y + throughput.z * z
    factor = total(throughput) / select(mean > 0.0, mean, 1.0)
    grey = _is_grey(sigma_t)
    return Vec3(select(grey, 1.0, x * factor), select(grey, 1.0, y * factor), select(grey, 1.0, z * factor))


@inline
def _henyey_greenstein(g, versine):
    """Per solid angle, of scattering by an angle of this versine, 1 minus the cosine, from the peak of the phase function
    (Henyey and Greenstein 1941)."""
    size = abs(g)
    least = 1.0 - size
    x = least * least + 2.0 * size * versine
    return least * (1.0 + size) * SPHERE_PDF / (x * sqrt(x))


@inline
def phase(g, direction, wi):
    """Per solid angle, of scattering from `direction` to `wi`."""
    # not from the cosine: at the peak it rounds to 1, while the difference of directions keeps their angle
    off = direction - wi * select(g < 0.0, -1.0, 1.0)
    return _henyey_greenstein(g, 0.5 * dot(off, off))


@inline
def sample_phase(g, direction, u0, u1):
    """(the direction in which a ray along `direction` is scattered, its pdf per solid angle)."""
    size, share = abs(g), select(g < 0.0, 1.0 - u0, u0)
    least = 1.0 - size
    ratio = least / (least + 2.0 * size * share)
    versine = 2.0 * (1.0 - share) * (1.0 + size * share) * ratio * ratio
    square, cosine = versine * (2.0 - versine), 1.0 - versine
    sine = sqrt(select(square > 0.0, square, 0.0))
    sin_phi, cos_phi = sin_cos_turn(u1)
    t, b = tangents(direction)
    wi = t * (sine * cos_phi) + b * (sine * sin_phi) + direction * select(g < 0.0, -cosine, cosine)
    return wi, _henyey_greenstein(g, versine)


@inline
def uniform_direction(u0, u1):
    """A unit direction, uniform on the sphere."""
    z = 1.0 - 2.0 * u0
    sine, cosine = sin_cos_turn(u1)
    square = 1.0 - z * z
    ring = sqrt(select(square > 0.0, square, 0.0))
    return Vec3(ring * cosine, ring * sine, z)


@inline
def is_at_vertex_of_medium(normal):
    """Whether this is the normal of a vertex in a medium, which has none."""
    return dot(normal, normal) == 0.0

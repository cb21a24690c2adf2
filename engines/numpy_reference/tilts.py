"""Shading frames that a bump or normal map tilts, and what that does to the BSDF inside (docs/transport.md, "Wrappers")."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from engines.numpy_reference.interaction import SurfaceInteraction, Wrapped
from engines.numpy_reference.textures import color, gradient
from engines.numpy_reference.vectors import Array, Frame, Mask, cross, dot, unit
from engines.scene import Bump, NormalMap


class Tilt(NamedTuple):
    """The unit normal and the derivatives of the point, (3, n) each, of a surface that is tilted at n points."""

    normal: Array
    dp_du: Array
    dp_dv: Array
    scatters: Mask
    """(n,) whether any light is scattered."""


def tilted(wrapper: Bump | NormalMap, at: SurfaceInteraction, transmits: bool) -> Tilt:
    """The frame at points of a textured surface, turned so that the viewer sees its front.

    What transmits light has one surface, whose front is tilted; of what is opaque the side that is met is tilted, and that is
    black where its front cannot be seen.
    """
    assert at.uv is not None and at.dp_dv is not None, "a material that tilts frames has texture coordinates"
    given = Tilt(at.normal, at.dp_du, at.dp_dv, np.ones(at.front.shape, bool))
    side = np.where(at.front, 1.0, -1.0)
    along = side if transmits else np.ones_like(side)
    if isinstance(wrapper, Bump):
        tilt = _bumped(wrapper, at, at.uv, given, along)
    else:
        tilt = _mapped(wrapper, at.uv, given, np.stack([along, side * along, np.ones_like(side)]))
    found = _towards_viewer(tilt, at)
    return found._replace(scatters=found.scatters | transmits)


def _bumped(bump: Bump, at: SurfaceInteraction, uv: Array, given: Tilt, along: Array) -> Tilt:
    """The normal of the surface that is `scale` times `height` higher along the given one where `along` (n,) is 1; lower
    where it is -1."""
    n = given.normal
    h_u, h_v = (along * bump.scale * slope for slope in gradient(bump.height, uv))
    with np.errstate(over="ignore", invalid="ignore"):
        dp_du = given.dp_du + n * (h_u - dot(n, given.dp_du))
        dp_dv = given.dp_dv + n * (h_v - dot(n, given.dp_dv))
        normal = unit(cross(dp_du, dp_dv))
    normal = np.where(dot(normal, at.geometric) < 0.0, -normal, normal)
    good = np.isfinite(normal).all(axis=0)
    normal, dp_du, dp_dv = (np.where(good, *pair) for pair in zip((normal, dp_du, dp_dv), given[:3], strict=True))
    return Tilt(normal, dp_du, dp_dv, given.scatters)


def _mapped(wrapper: NormalMap, uv: Array, given: Tilt, signs: Array) -> Tilt:
    """The normal 2 c - 1 of the texel c, times `signs` (3, n), in the given frame."""
    local = signs * (2.0 * color(wrapper.map, uv) - 1.0)
    normal = unit(Frame.along(given.normal, given.dp_du).to_world(local))
    return given._replace(normal=np.where(np.isfinite(normal).all(axis=0), normal, given.normal))


def _towards_viewer(tilt: Tilt, at: SurfaceInteraction) -> Tilt:
    """A normal that the viewer does not see is turned half around the one before it; that one, where this does not help."""
    before, normal = at.normal, tilt.normal
    turned = np.where(dot(normal, at.wo) > 0.0, normal, 2.0 * dot(before, normal) * before - normal)
    seen = dot(turned, at.wo) > 0.0
    return tilt._replace(normal=np.where(seen, turned, before), scatters=seen)


def kept(at: SurfaceInteraction, wrapped: Wrapped, wi: Array) -> Mask:
    """(n,) whether `wi` lies on the same side of the tilted surface as of the one before its last tilt."""
    return dot(wrapped.innermost, wi) * dot(at.normal, wi) > 0.0


def shadowing(at: SurfaceInteraction, wrapped: Wrapped, wi: Array) -> Array:
    """(n,) by which values are multiplied, so that they end smoothly where the surface ends that is not tilted (Estevez,
    Lecocq and Stein 2019). 1 where nothing is tilted."""
    n = wrapped.outermost
    with np.errstate(divide="ignore", invalid="ignore"):
        strength = np.minimum(_tangent2(n, at.normal) / 8.0, 1.0)
        return np.where(strength > 0.0, 2.0 / (1.0 + np.sqrt(1.0 + strength * _tangent2(n, wi))), 1.0)


def _tangent2(a: Array, b: Array) -> Array:
    """(n,) squared tangents of the angles between unit vectors, 0 where they are equal to the last bit."""
    across, cosine = cross(a, b), dot(a, b)
    return dot(across, across) / (cosine * cosine)

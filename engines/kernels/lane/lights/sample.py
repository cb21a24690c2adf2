"""What a light's lane function takes and gives."""

from __future__ import annotations

from typing import NamedTuple

from engines.kernels.compile.vec3 import Vec3


class Light(NamedTuple):
    """A row of the scene's lights; for a mesh that emits, a face of it and that face's emission."""

    parameters: tuple[float, ...]
    color: Vec3
    two_sided: float
    """1 or 0."""
    vertex0: Vec3
    vertex1: Vec3
    vertex2: Vec3


class LightSample(NamedTuple):
    """`wi` unit, towards the light; `radiance` over pdf; `pdf` per solid angle, inf for delta lights, 0 for no sample."""

    wi: Vec3
    distance: float
    radiance: Vec3
    pdf: float

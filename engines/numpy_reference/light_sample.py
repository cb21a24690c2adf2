"""What sampling a light from a point gives, whatever the light."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from engines.numpy_reference.vectors import Array, Indices


class LightSample(NamedTuple):
    """n samples of lights, one a point. No sample: `arriving` is 0, whatever the rest says."""

    wi: Array
    """(3, n) unit, from the point to the light."""
    distance: Array
    """(n,) metres, inf for lights at infinity."""
    arriving: Array
    """(3, n) radiance over pdf; for delta lights what stands in its place: W/m2 on a surface that faces the light."""
    pdf: Array
    """(n,) per solid angle, inf for delta lights."""

    @classmethod
    def empty(cls, n: int) -> LightSample:
        """Samples that hold nothing yet."""
        return cls(np.zeros((3, n)), np.zeros(n), np.zeros((3, n)), np.zeros(n))

    def put(self, lanes: Indices, samples: LightSample) -> None:
        """Overwrites some of the samples."""
        for mine, new in zip(self, samples, strict=True):
            mine[..., lanes] = new

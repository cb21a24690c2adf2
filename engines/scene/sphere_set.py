"""Many spheres as one shape."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["SphereSet"]


@dataclass(frozen=True, slots=True, eq=False)
class SphereSet:
    """Many spheres that make one shape (a sphereflake): `centers` (n, 3), `radii` (n,), one material."""

    centers: NDArray[np.float64]
    radii: NDArray[np.float64]
    material: int
    name: str = "spheres"

    def bounds(self) -> NDArray[np.float64]:
        """(2, 3) lowest and highest coordinates."""
        radii = self.radii[:, None]
        return np.stack([(self.centers - radii).min(axis=0), (self.centers + radii).max(axis=0)])

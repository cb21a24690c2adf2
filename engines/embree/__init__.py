"""The embree engine: Embree finds the hits, the kernels shared with the numba engine do the rest."""

from engines.embree.engine import Engine

__all__ = ["Engine"]

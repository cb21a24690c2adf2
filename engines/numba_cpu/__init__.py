"""The numba engine: lanes, stages and accelerators compiled for the scene at hand."""

from engines.numba_cpu.engine import Engine

__all__ = ["Engine"]

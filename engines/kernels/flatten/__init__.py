"""A scene flattened into arrays: one registry each for shapes, lights and BSDF models."""

from engines.kernels.flatten.scene import FlatScene, flatten

__all__ = ["FlatScene", "flatten"]

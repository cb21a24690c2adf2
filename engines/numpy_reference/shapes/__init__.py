"""The kinds of shapes, one a module, and the registry through which the rest of the engine knows them."""

from engines.numpy_reference.registry import collect
from engines.numpy_reference.shapes.interface import LocalGeometry, Primitives, ShapeSample, TextureCoordinates
from engines.numpy_reference.shapes.triangle import Triangles

SHAPES: dict[type, type[Primitives]] = collect("SHAPES", __name__, __path__)
"""For each shape of a scene, the class that holds all of its kind; from the tables `SHAPES` of the modules."""

__all__ = ["SHAPES", "LocalGeometry", "Primitives", "ShapeSample", "TextureCoordinates", "Triangles"]

"""The kinds of shapes, one a module, and the registry through which the rest of the engine knows them."""

from engines.numpy_reference.shapes.disk import Disks
from engines.numpy_reference.shapes.interface import LocalGeometry, Primitives, ShapeSample
from engines.numpy_reference.shapes.plane import Planes
from engines.numpy_reference.shapes.sphere import Spheres
from engines.numpy_reference.shapes.triangle import Triangles
from engines.scene import Disk, Mesh, Plane, Sphere, SphereSet, Triangle

SHAPES: dict[type, type[Primitives]] = {
    Plane: Planes,
    Triangle: Triangles,
    Mesh: Triangles,
    Sphere: Spheres,
    SphereSet: Spheres,
    Disk: Disks,
}
"""For each shape of the scene model, the class that holds all of its kind."""

__all__ = ["SHAPES", "Disks", "LocalGeometry", "Planes", "Primitives", "ShapeSample", "Spheres", "Triangles"]

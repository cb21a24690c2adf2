"""Instances: matrices that turn rays into the coordinates of groups, and what is found there back into the world's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engines.numpy_reference.shapes import LocalGeometry, Primitives, TextureCoordinates, Triangles
from engines.numpy_reference.vectors import Array, Indices, norm, unit
from engines.scene import Instance


class Instances:
    """All instances of a scene, k of them. `shape`, `first` (the id of its first primitive) and `group` (k,); `low` and `high`
    (3, k), corners of their boxes."""

    def __init__(self, instances: Sequence[Instance], shape: Indices, first: Indices, group: Indices) -> None:
        self.shape, self.first, self.group = shape, first, group
        boxes = np.array([instance.bounds() for instance in instances])
        self.low, self.high = boxes.transpose(1, 2, 0)
        matrix = np.array([instance.matrix for instance in instances])
        inverse = np.linalg.inv(matrix[:, :, :3])
        self._linear, self._inverse = matrix[:, :, :3].transpose(1, 2, 0).copy(), inverse.transpose(1, 2, 0).copy()
        self._moved = matrix[:, :, 3].T.copy()
        size = np.abs(matrix[:, :, :3]).sum(axis=2).max(axis=1)
        self.slack = float((size * np.abs(inverse).sum(axis=2).max(axis=1)).max())
        """How many times as large rounding errors of turned rays are as in the world, at most."""
        local = np.array([np.abs(instance.group.box).max() for instance in instances])
        self.extent = float((size * local + np.abs(self._moved).max(axis=0)).max())
        """The largest number that makes up a coordinate of a box."""

    def of_shape(self, shape: Indices) -> Indices:
        """(n,) instances by their places among the scene's shapes."""
        return np.searchsorted(self.shape, shape)

    def inwards(self, instance: Indices, origin: Array, direction: Array) -> tuple[Array, Array, Array]:
        """Origins and unit directions of rays (3, n) in the coordinates of the groups of `instance` (n,), and how long a metre
        along each is there (n,)."""
        inverse = self._inverse.take(instance, axis=2)
        turned = _times(inverse, direction)
        length = norm(turned)
        return _times(inverse, origin - self._moved.take(instance, axis=1)), turned / length, length

    def points_inwards(self, instance: Indices, point: Array) -> Array:
        """(3, n) points in the coordinates of groups."""
        return _times(self._inverse.take(instance, axis=2), point - self._moved.take(instance, axis=1))

    def vectors(self, instance: Indices, vector: Array) -> Array:
        """(3, n) differences of points, in the world's coordinates."""
        return _times(self._linear.take(instance, axis=2), vector)

    def normals(self, instance: Indices, normal: Array) -> Array:
        """(3, n) unit M^-T n: fronts stay fronts where the matrix mirrors."""
        return unit(_times(self._inverse.take(instance, axis=2).transpose(1, 0, 2), normal))

    def reach(self, instance: Indices, point: Array, radius: Array | float) -> Array:
        """(n,) metres: the largest numbers that make up the world's coordinates of points (3, n) of round shapes, on the way to
        the group and back: rounding errors grow where the matrix is ill-conditioned."""
        linear, inverse = (np.abs(each.take(instance, axis=2)) for each in (self._linear, self._inverse))
        place = _times(linear, np.abs(point) + radius) + np.abs(self._moved.take(instance, axis=1))
        return np.maximum(place, _times(linear, _times(inverse, place))).max(axis=0)


def _times(matrix: Array, vector: Array) -> Array:
    """(3, n) products of matrices (3, 3, n) and vectors (3, n), each of which is computed by itself."""
    return matrix[:, 0] * vector[0] + matrix[:, 1] * vector[1] + matrix[:, 2] * vector[2]


class Turned:
    """Primitives of a group, as `instance` (n,) of `instances` show them to n rays: the verbs of `Primitives` that n rays are
    asked for, in the world's coordinates."""

    def __init__(self, primitives: Primitives, instances: Instances, instance: Indices) -> None:
        self._primitives, self._instances, self._instance = primitives, instances, instance

    def interaction(self, index: Indices, origin: Array, direction: Array, point: Array) -> LocalGeometry:
        """See `Primitives.interaction`."""
        instances, instance = self._instances, self._instance
        start, way, _ = instances.inwards(instance, origin, direction)
        place = instances.points_inwards(instance, point)
        local = self._primitives.interaction(index, start, way, place)
        return LocalGeometry(
            instances.normals(instance, local.outward),
            instances.normals(instance, local.shading_normal),
            instances.vectors(instance, local.dp_du),
            instances.reach(instance, place, local.radius),
        )

    def coordinates(self, index: Indices, origin: Array, direction: Array, point: Array) -> TextureCoordinates:
        """See `Primitives.coordinates`."""
        instances, instance = self._instances, self._instance
        start, way, _ = instances.inwards(instance, origin, direction)
        local = self._primitives.coordinates(index, start, way, instances.points_inwards(instance, point))
        along = (instances.vectors(instance, vector) for vector in (local.dp_du, local.dp_dv))
        return TextureCoordinates(local.uv, *along, local.attributes)

    def barycentric(self, index: Indices, origin: Array, direction: Array) -> tuple[Array, Array]:
        """(n,) weights of the second and third vertex where rays hit triangles; 0 on other shapes."""
        if not isinstance(self._primitives, Triangles):
            return np.zeros(index.size), np.zeros(index.size)
        start, way, _ = self._instances.inwards(self._instance, origin, direction)
        return self._primitives.barycentric(index, start, way)

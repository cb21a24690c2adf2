"""What a ray finds: the point, its normals, which side was met, and where rays that leave it start."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from engines.numpy_reference.accelerators.nearest import Nearest
from engines.numpy_reference.geometry import Geometry
from engines.numpy_reference.shapes import Triangles
from engines.numpy_reference.vectors import Array, Indices, Mask, dot


class SurfaceInteraction(NamedTuple):
    """n points that rays have hit. Both normals are unit and on the side that the ray came from."""

    point: Array
    wo: Array
    """(3, n) unit, back along the ray: towards the viewer."""
    geometric: Array
    """(3, n) normal of the shape itself."""
    normal: Array
    """(3, n) shading normal: interpolated on smooth meshes, else the geometric one."""
    dp_du: Array
    """(3, n) derivative of the point by the shape's first coordinate, of any length; 0 where there is none."""
    front: Mask
    """(n,) whether the ray met the front: the counter-clockwise side, the outside, the side of a plane's normal."""
    material: Indices
    primitive_id: Indices
    offset: Array
    """(n,) metres between the surface and the origins of rays that leave it."""
    uv: Array | None = None
    """(2, n) texture coordinates; None in scenes that need none."""
    dp_dv: Array | None = None
    """(3, n) derivative of the point by the shape's second coordinate; None in scenes that need none."""

    def take(self, lanes: Indices) -> SurfaceInteraction:
        """The interactions at some of the points."""
        taken: list[Any] = [None if field is None else field.take(lanes, axis=-1) for field in self]
        return SurfaceInteraction(*taken)

    def leave(self, inwards: bool = False) -> Array:
        """(3, n) origins of rays that leave on the side where the ray came from, or on the other one."""
        return self.point + (-self.offset if inwards else self.offset) * self.geometric

    def spawn(self, wi: Array) -> Array:
        """(3, n) origins of rays along `wi`, on the side into which they go."""
        return self.point + np.where(dot(self.geometric, wi) < 0.0, -self.offset, self.offset) * self.geometric

    def reflects(self, wi: Array) -> Mask:
        """(n,) whether `wi` lies above the surface where the viewer is, by both normals."""
        return (dot(self.normal, wi) > 0.0) & (dot(self.geometric, wi) > 0.0)


def surface_interaction(
    geometry: Geometry, origin: Array, direction: Array, hits: Nearest, offset: float
) -> SurfaceInteraction:
    """Where rays (3, n) hit; every one of them must have hit something. `offset` is the tracer's."""
    point = origin + hits.t * direction
    outward, shading, dp_du = np.empty_like(point), np.empty_like(point), np.empty_like(point)
    scale = np.maximum(np.maximum(np.abs(point).max(axis=0), np.abs(origin).max(axis=0)), hits.t)
    for primitives, lanes, index in geometry.by_kind(hits.primitive_id):
        rays = (vectors.take(lanes, axis=1) for vectors in (origin, direction, point))
        local = primitives.interaction(index, *rays)
        outward[:, lanes], shading[:, lanes], dp_du[:, lanes] = local.outward, local.shading_normal, local.dp_du
        scale[lanes] = np.maximum(scale[lanes], local.radius)
    front = dot(direction, outward) < 0.0
    geometric = np.where(front, outward, -outward)
    normal = np.where(dot(shading, geometric) < 0.0, -shading, shading)
    normal = np.where(dot(direction, normal) < 0.0, normal, geometric)  # one that the viewer cannot see will not do
    material = geometry.material[hits.primitive_id]
    return SurfaceInteraction(
        point, -direction, geometric, normal, dp_du, front, material, hits.primitive_id, offset * scale
    )  # fmt: skip


def barycentric(geometry: Geometry, origin: Array, direction: Array, primitive_id: Indices) -> tuple[Array, Array]:
    """(n,) weights of the second and third vertex where rays hit triangles; 0 on other shapes."""
    u, v = np.zeros(primitive_id.size), np.zeros(primitive_id.size)
    for primitives, lanes, index in geometry.by_kind(primitive_id):
        if isinstance(primitives, Triangles):
            u[lanes], v[lanes] = primitives.barycentric(
                index, origin.take(lanes, axis=1), direction.take(lanes, axis=1)
            )
    return u, v

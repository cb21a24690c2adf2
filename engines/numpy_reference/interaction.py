"""What a ray finds: the point, its normals, which side was met, and where rays that leave it start."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from engines.numpy_reference.accelerators.nearest import Nearest
from engines.numpy_reference.accelerators.tracer import OFFSET_ULPS
from engines.numpy_reference.geometry import Geometry
from engines.numpy_reference.instances import Turned
from engines.numpy_reference.shapes import Triangles
from engines.numpy_reference.vectors import EPSILON, Array, Indices, Mask, dot


class Wrapped(NamedTuple):
    """Where the wrappers of materials have led at n points (docs/transport.md, "Wrappers")."""

    leaf: Indices
    """(n,) number of the BSDF, among those of the scene that are no wrappers."""
    opacity: Array
    """(n,) the product of the masks' opacities."""
    passing: Mask
    """(n,) whether a scattered ray goes straight on."""
    outermost: Array
    """(3, n) normal before the first tilt."""
    innermost: Array
    """(3, n) normal before the last tilt; 0 where nothing is scattered."""

    def take(self, lanes: Indices) -> Wrapped:
        """What belongs to some of the points."""
        taken: list[Any] = [field.take(lanes, axis=-1) for field in self]
        return Wrapped(*taken)


class SurfaceInteraction(NamedTuple):
    """n points that rays have hit. Both normals are unit and on the side that the ray came from."""

    point: Array
    wo: Array
    """(3, n) unit, back along the ray: towards the viewer."""
    geometric: Array
    """(3, n) normal of the shape itself."""
    normal: Array
    """(3, n) shading normal: interpolated on smooth meshes, else the geometric one; or a tilted one."""
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
    attributes: Mapping[str, Array] = {}
    """(3, n) each, by name, where the material needs texture coordinates."""
    wrapped: Wrapped | None = None
    """None in scenes without wrappers, and before they have been walked. Afterwards `normal` and `dp_du` are the leaf's."""

    def take(self, lanes: Indices) -> SurfaceInteraction:
        """The interactions at some of the points."""
        taken: list[Any] = [None if field is None else field.take(lanes, axis=-1) for field in self[:-2]]
        attributes = {name: values.take(lanes, axis=1) for name, values in self.attributes.items()}
        found = SurfaceInteraction(*taken, attributes)
        return found if self.wrapped is None else found._replace(wrapped=self.wrapped.take(lanes))

    def leave(self, inwards: bool = False) -> Array:
        """(3, n) origins of rays that leave on the side where the ray came from, or on the other one."""
        return self.point + (-self.offset if inwards else self.offset) * self.geometric

    def spawn(self, wi: Array) -> Array:
        """(3, n) origins of rays along `wi`, on the side into which they go."""
        return self.point + np.where(dot(self.geometric, wi) < 0.0, -self.offset, self.offset) * self.geometric

    def cosine(self, wi: Array) -> Array:
        """(n,) by which light along `wi` is weighted."""
        return np.abs(dot(self.normal, wi))

    def faces(self, wi: Array) -> Mask:
        """(n,) whether `wi` lies on the side that the ray came from."""
        return dot(self.geometric, wi) > 0.0

    def reflects(self, wi: Array) -> Mask:
        """(n,) whether `wi` lies above the surface where the viewer is, by both normals."""
        return (dot(self.normal, wi) > 0.0) & (dot(self.geometric, wi) > 0.0)


def surface_interaction(
    geometry: Geometry, origin: Array, direction: Array, hits: Nearest, offset: float, placed: Mask | None = None
) -> SurfaceInteraction:
    """Where rays (3, n) hit; every one of them must have hit something. `offset` is the tracer's; `placed` says of each
    material whether it needs texture coordinates, None that none does."""
    point = origin + hits.t * direction
    outward, shading, dp_du = np.empty_like(point), np.empty_like(point), np.empty_like(point)
    scale = np.maximum(np.maximum(np.abs(point).max(axis=0), np.abs(origin).max(axis=0)), hits.t)
    for primitives, lanes, index in geometry.by_kind(hits.primitive_id):
        rays = (vectors.take(lanes, axis=1) for vectors in (origin, direction, point))
        local = primitives.interaction(index, *rays)
        outward[:, lanes], shading[:, lanes], dp_du[:, lanes] = local.outward, local.shading_normal, local.dp_du
        # round shapes are met in float64, whatever the tracer's precision
        share = 1.0 if isinstance(primitives, Turned) else OFFSET_ULPS * EPSILON / offset
        scale[lanes] = np.maximum(scale[lanes], share * local.radius)
    front = dot(direction, outward) < 0.0
    geometric = np.where(front, outward, -outward)
    normal = np.where(dot(shading, geometric) < 0.0, -shading, shading)
    normal = np.where(dot(direction, normal) < 0.0, normal, geometric)  # one that the viewer cannot see will not do
    material = geometry.material[geometry.row(hits.primitive_id)]
    found = SurfaceInteraction(point, -direction, geometric, normal, dp_du, front, material, hits.primitive_id, offset * scale)
    return found if placed is None else _with_coordinates(found, geometry, origin, direction, placed)


def _with_coordinates(
    at: SurfaceInteraction, geometry: Geometry, origin: Array, direction: Array, placed: Mask
) -> SurfaceInteraction:
    """With (u, v), their derivatives and the attributes of meshes where the material needs them, 0 elsewhere."""
    uv, dp_du, dp_dv = np.zeros((2, at.material.size)), at.dp_du.copy(), np.zeros_like(at.dp_du)
    attributes: dict[str, Array] = {}
    some = np.flatnonzero(placed[at.material])
    for primitives, chosen, index in geometry.by_kind(at.primitive_id[some]):
        lanes = some[chosen]
        rays = (vectors.take(lanes, axis=1) for vectors in (origin, direction, at.point))
        place = primitives.coordinates(index, *rays)
        uv[:, lanes], dp_du[:, lanes], dp_dv[:, lanes] = place[:3]
        for name, values in place.attributes.items():
            attributes.setdefault(name, np.zeros_like(dp_du))[:, lanes] = values
    return at._replace(uv=uv, dp_du=dp_du, dp_dv=dp_dv, attributes=attributes)


def barycentric(geometry: Geometry, origin: Array, direction: Array, primitive_id: Indices) -> tuple[Array, Array]:
    """(n,) weights of the second and third vertex where rays hit triangles; 0 on other shapes."""
    u, v = np.zeros(primitive_id.size), np.zeros(primitive_id.size)
    for primitives, lanes, index in geometry.by_kind(primitive_id):
        if isinstance(primitives, Triangles | Turned):
            u[lanes], v[lanes] = primitives.barycentric(index, origin.take(lanes, axis=1), direction.take(lanes, axis=1))
    return u, v

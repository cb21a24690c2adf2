"""Engines whose rays go astray."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from engines.conformance import hits
from engines.interface import Hits
from tests.conformance.mutants import breaks
from tests.conformance.small_engine import Renderer


@breaks(hits.hits_have_their_shapes)
class SinglePrecisionHits(Renderer):
    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        found = super().trace(origins, directions, t_max)
        return replace(found, t=found.t.astype(np.float32))


@breaks(hits.hits_have_their_shapes)
class NoneIsTooFew(Renderer):
    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        found = super().trace(origins, directions, t_max)
        return found if len(found.t) else replace(found, normal=np.zeros(0))


@breaks(hits.spheres_are_hit_where_they_are)
class NearRootFromInside(Renderer):
    def sphere(self, o, d, center, radius):
        t, u, v, normal = super().sphere(o, d, center, radius)
        inside = np.linalg.norm(o - center, axis=1) < radius
        return np.where(inside, np.nan, t), u, v, normal


@breaks(hits.cylinders_are_open_and_hit_on_both_sides)
class CylindersHaveNoEnd(Renderer):
    def on_side(self, place):
        return np.isfinite(place)


@breaks(hits.planes_are_hit_on_both_sides, hits.triangles_are_hit_on_both_sides, hits.meshes_say_which_face)
class BackFacesAreCulled(Renderer):
    def intersections(self, o, d):
        for index, piece, (t, u, v, normal) in super().intersections(o, d):
            yield index, piece, (np.where(d @ np.atleast_2d(normal)[0] < 0, t, np.nan), u, v, normal)


@breaks(hits.planes_are_hit_on_both_sides, hits.spheres_are_hit_where_they_are, hits.normals_are_unit_and_face_the_ray)
class NormalsFaceAway(Renderer):
    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        found = super().trace(origins, directions, t_max)
        return replace(found, normal=-found.normal)


@breaks(hits.triangles_are_hit_on_both_sides, hits.normals_are_unit_and_face_the_ray)
class NormalsAreNotUnit(Renderer):
    def triangle(self, o, d, a, b, c):
        t, u, v, _ = super().triangle(o, d, a, b, c)
        return t, u, v, np.cross(b - a, c - a)


@breaks(hits.triangles_are_hit_on_both_sides, hits.meshes_say_which_face)
class WeightsAreExchanged(Renderer):
    def triangle(self, o, d, a, b, c):
        t, u, v, normal = super().triangle(o, d, a, b, c)
        return t, v, u, normal


@breaks(hits.meshes_say_which_face, hits.the_nearest_of_many_wins)
class FacesAreNotTold(Renderer):
    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        found = super().trace(origins, directions, t_max)
        return replace(found, primitive=np.minimum(found.primitive, 0))


@breaks(hits.the_nearest_of_many_wins)
class LargeMeshesAreCutShort(Renderer):
    def intersections(self, o, d):
        return ((index, piece, hit) for index, piece, hit in super().intersections(o, d) if piece < 700)


@breaks(hits.t_max_ends_a_ray, hits.trace_and_occluded_agree)
class NoEnd(Renderer):
    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        return super().trace(origins, directions)


@breaks(hits.t_max_ends_a_ray)
class NegativeIsEndless(Renderer):
    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        return super().trace(origins, directions, np.where(np.asarray(t_max) < 0, np.inf, t_max))


@breaks(hits.t_counts_in_lengths_of_the_direction)
class DistancesInMetres(Renderer):
    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        found = super().trace(origins, directions, t_max)
        return replace(found, t=found.t * np.linalg.norm(np.asarray(directions, float), axis=1))


@breaks(hits.t_counts_in_lengths_of_the_direction)
class ShortDirectionsAreLost(Renderer):
    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        square = np.sum(np.square(np.asarray(directions, np.float32)), axis=1, keepdims=True)
        return super().trace(origins, np.where(square > 0, directions, np.nan), t_max)


@breaks(hits.what_is_no_ray_misses)
class BadRaysRaise(Renderer):
    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        if not np.isfinite(origins).all():
            raise ValueError("a ray is not finite")
        return super().trace(origins, directions, t_max)


@breaks(hits.what_is_no_ray_misses)
class OneBadRaySpoilsAll(Renderer):
    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        bad = not np.isfinite(origins).all()
        return super().trace(np.full_like(origins, np.nan) if bad else origins, directions, t_max)


@breaks(hits.ties_go_to_the_lower_index, hits.ties_of_spheres_go_to_the_lower_shape)
class LastWins(Renderer):
    def wins(self, t, other):
        return t <= other


@breaks(hits.trace_and_occluded_agree, hits.hits_have_their_shapes)
class ShadowsIgnoreTheEnd(Renderer):
    def occluded(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf):
        return super().occluded(origins, directions)


@breaks(hits.rays_do_not_see_each_other)
class LastLanesAreForgotten(Renderer):
    def trace(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        origins = np.array(origins, float)
        origins[len(origins) // 16 * 16 :] = np.nan
        return super().trace(origins, directions, t_max)

"""Claims about `trace` and `occluded`: hits computed by hand, rays that are none, and agreement between the two."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.conformance.stage import TRIANGLES, cylinder, mesh, plane, rectangle, scene, sphere, triangle
from engines.conformance.subject import Subject, expect
from engines.interface import Hits, Renderer

RELATIVE = 2e-6
"""What float32 geometry may be wrong by in t, u, v and the normal on the coordinates used here."""


class Ray(NamedTuple):
    """A ray and its closest hit by hand; `t` = inf is a miss."""

    origin: tuple[float, float, float]
    direction: tuple[float, float, float]
    t: float
    normal: tuple[float, float, float] = (0, 0, 0)
    shape: int = 0
    primitive: int = 0
    u: float = 0
    v: float = 0
    t_max: float = np.inf


MISS = np.inf


def _compare(renderer: Renderer, rays: list[Ray], label: str) -> None:
    """Holds `trace` and `occluded` of `renderer` against the hits by hand."""
    origins = np.array([ray.origin for ray in rays], np.float64)
    directions = np.array([ray.direction for ray in rays], np.float64)
    t_max = np.array([ray.t_max for ray in rays])
    hits = renderer.trace(origins, directions, t_max)
    blocked = np.asarray(renderer.occluded(origins, directions, t_max))
    for i, ray in enumerate(rays):
        where = f"{label}: ray from {ray.origin} along {ray.direction}, t_max {ray.t_max:g}"
        hit = np.isfinite(ray.t)
        expect(np.isclose(hits.t[i], ray.t, rtol=RELATIVE, atol=0), f"{where}: t = {hits.t[i]!r}, by hand it is {ray.t!r}")
        found = int(hits.shape[i]), int(hits.primitive[i])
        expected = (ray.shape, ray.primitive) if hit else (-1, -1)
        expect(found == expected, f"{where}: shape, primitive = {found}, by hand they are {expected}")
        expect(
            np.allclose(hits.normal[i], ray.normal, atol=10 * RELATIVE),
            f"{where}: normal {hits.normal[i]}, by hand it is {ray.normal}",
        )
        expect(
            np.allclose([hits.u[i], hits.v[i]], [ray.u, ray.v], atol=10 * RELATIVE),
            f"{where}: u, v = {hits.u[i]}, {hits.v[i]}, by hand they are {ray.u}, {ray.v}",
        )
        expect(bool(blocked[i]) == hit, f"{where}: occluded answers {bool(blocked[i])}, by hand it is {hit}")


def _hold(subject: Subject, shapes: list[dict[str, Any]], rays: list[Ray]) -> None:
    for label, renderer in subject.tracers(scene(shapes)):
        _compare(renderer, rays, label)


def hits_have_their_shapes(subject: Subject) -> None:
    """trace gives six arrays of the agreed shapes and types, for any number of rays, one and none included."""
    _, renderer = next(subject.tracers(TRIANGLES))
    for count in (0, 1, 17):
        origins, directions = np.tile([0.0, 1.0, 5.0], (count, 1)), np.tile([0.0, 0.0, -1.0], (count, 1))
        hits = renderer.trace(origins, directions)
        for name, kind, shape in (
            *((name, np.float64, (count,)) for name in ("t", "u", "v")),
            *((name, np.int64, (count,)) for name in ("shape", "primitive")),
            ("normal", np.float64, (count, 3)),
        ):
            array = np.asarray(getattr(hits, name))
            expect(array.shape == shape, f"{count} rays: {name} has shape {array.shape}, expected {shape}")
            expect(array.dtype == kind, f"{count} rays: {name} is {array.dtype}, expected {kind.__name__}")
        blocked = np.asarray(renderer.occluded(origins, directions))
        expect(blocked.shape == (count,), f"{count} rays: occluded has shape {blocked.shape}")
        expect(blocked.dtype == np.bool_, f"{count} rays: occluded is {blocked.dtype}, expected bool")
    expect(renderer.occluded([[0, 1, 5]], [[0, 0, -1]], 3.0).tolist() == [False], "lists and a scalar t_max are misread")


def spheres_are_hit_where_they_are(subject: Subject) -> None:
    """A sphere is hit at the nearer root in front, from inside at the farther one; its normal faces the ray."""
    _hold(
        subject,
        [sphere()],
        [
            Ray((0, 0, 5), (0, 0, -1), 4, (0, 0, 1)),
            Ray((0.6, 0, 5), (0, 0, -1), 4.2, (0.6, 0, 0.8)),
            Ray((0, 0, 0), (1, 0, 0), 1, (-1, 0, 0)),
            Ray((0.5, 0, 0), (-1, 0, 0), 1.5, (1, 0, 0)),
            Ray((0, 0, 5), (0, 0, 1), MISS),
            Ray((1.5, 0, 5), (0, 0, -1), MISS),
        ],
    )
    _hold(subject, [sphere((3, -4, 2), 0.5)], [Ray((3, -4, 12), (0, 0, -1), 9.5, (0, 0, 1))])


def cylinders_are_open_and_hit_on_both_sides(subject: Subject) -> None:
    """A cylinder is hit on its side alone, from outside and from inside, and rays pass through its ends."""
    _hold(
        subject,
        [cylinder((1, 0, 0), (1, 2, 0), 0.5)],
        [
            Ray((1, 1, 4), (0, 0, -1), 3.5, (0, 0, 1)),
            Ray((1.3, 1, 4), (0, 0, -1), 3.6, (0.6, 0, 0.8)),
            Ray((1, 1, 0), (1, 0, 0), 0.5, (-1, 0, 0)),
            Ray((1, 4, 0), (0.25, -1.25, 0), 2, (-1, 0, 0)),
            Ray((1, -0.75, 4), (0, 0.25, -1), 3.5, (0, 0, 1)),
            Ray((1, -1, 4), (0, 0.25, -1), 4.5, (0, 0, 1)),
            Ray((1.2, 4, 0.1), (0, -1, 0), MISS),
            Ray((1, 2.1, 4), (0, 0, -1), MISS),
            Ray((1, 1, 4), (0, 0, 1), MISS),
            Ray((1.6, 1, 4), (0, 0, -1), MISS),
        ],
    )


def planes_are_hit_on_both_sides(subject: Subject) -> None:
    """A plane is hit from either side, far and near, and missed by rays along it or away from it."""
    _hold(
        subject,
        [plane((5, 0, 5), (0, 2, 0))],
        [
            Ray((3, 2, -1), (0, -1, 0), 2, (0, 1, 0)),
            Ray((0, -2, 0), (0, 1, 0), 2, (0, -1, 0)),
            Ray((0, 1, 0), (1, -1, 0), 1, (0, 1, 0)),
            Ray((0, 1, 0), (1e4, -1, 0), 1, (0, 1, 0)),
            Ray((0, 1, 0), (1, 0, 0), MISS),
            Ray((0, 1, 0), (0, 1, 0), MISS),
        ],
    )


def triangles_are_hit_on_both_sides(subject: Subject) -> None:
    """A triangle is hit from either side; u and v weigh its second and third vertex."""
    u, v = 0.25, 0.125
    _hold(
        subject,
        [triangle((0, 0, 0), (2, 0, 0), (0, 2, 0))],
        [
            Ray((0.5, 0.25, 1), (0, 0, -1), 1, (0, 0, 1), u=u, v=v),
            Ray((0.5, 0.25, -3), (0, 0, 1), 3, (0, 0, -1), u=u, v=v),
            Ray((0.5 - 2, 0.25, 1), (2, 0, -1), 1, (0, 0, 1), u=u, v=v),
            Ray((1.5, 1.5, 1), (0, 0, -1), MISS),
            Ray((-0.5, 0.5, 1), (0, 0, -1), MISS),
            Ray((0.5, 0.25, 1), (0, 0, 1), MISS),
        ],
    )


def meshes_say_which_face(subject: Subject) -> None:
    """A hit on a mesh names the shape and, as primitive, the face."""
    _hold(
        subject,
        [rectangle((-1, 1), (-1, 1), -7), rectangle((-1, 1), (-1, 1), 0)],
        [
            Ray((0.5, -0.5, 2), (0, 0, -1), 2, (0, 0, 1), shape=1, primitive=0, u=0.5, v=0.25),
            Ray((-0.5, 0.5, 2), (0, 0, -1), 2, (0, 0, 1), shape=1, primitive=1, u=0.25, v=0.5),
            Ray((0.5, -0.5, -8), (0, 0, 1), 1, (0, 0, -1), shape=0, primitive=0, u=0.5, v=0.25),
            Ray((0.5, -0.5, 2), (0, 0, 1), MISS),
        ],
    )


def the_nearest_of_many_wins(subject: Subject) -> None:
    """Among 800 faces at eleven heights each ray finds its own, from either side."""
    count, corners, faces, rays = 20, [], [], []
    for i in range(count):
        for j in range(count):
            z, first, x, y = ((7 * i + 3 * j) % 11) / 11, len(corners), float(i), float(j)
            corners += [[x, y, z], [x + 1, y, z], [x + 1, y + 1, z], [x, y + 1, z]]
            faces += [[first, first + 1, first + 2], [first, first + 2, first + 3]]
            face, below = len(faces) - 2, (i + j) % 2
            origin = (x + 0.75, y + 0.25, -1.0 if below else 2.0)
            direction, t = ((0, 0, 1), 1 + z) if below else ((0, 0, -1), 2 - z)
            rays.append(Ray(origin, direction, t, (0, 0, -direction[2]), primitive=face, u=0.5, v=0.25))
    _hold(subject, [mesh(corners, faces)], rays)


def t_max_ends_a_ray(subject: Subject) -> None:
    """Nothing at or beyond t_max is found, and no t_max of zero, below zero or NaN finds anything."""
    towards = ((0, 1, 5), (0, 0, -1))
    rays = [Ray(*towards, 8, (0, 0, 1), u=0.25, v=0.25, t_max=8.01), Ray(*towards, MISS, t_max=7.99)]
    rays += [Ray(*towards, MISS, t_max=t_max) for t_max in (0.0, -1.0, -np.inf, np.nan)]
    _hold(subject, [rectangle((-3, 3), (0, 4), -3)], rays)
    for label, renderer in subject.tracers(scene([sphere()])):
        _compare(renderer, [Ray((0, 0, 5), (0, 0, -1), MISS, t_max=3.99)], label)
        _compare(renderer, [Ray((0, 0, 0), (0, 0, -1), MISS, t_max=0.99)], label)


def t_counts_in_lengths_of_the_direction(subject: Subject) -> None:
    """A direction of another length, 1e-30 to 1e30, hits the same point, and t and t_max scale with it."""
    rays = []
    for size in (1e-30, 1e-10, 1e-3, 2.0, 1e10, 1e30):
        hit = Ray((0.5, 0.25, 1), (0, 0, -size), 1 / size, (0, 0, 1), u=0.25, v=0.125)
        rays += [hit, hit._replace(t_max=1.01 / size)]
        rays += [Ray(hit.origin, hit.direction, MISS, t_max=0.99 / size)]
    _hold(subject, [triangle((0, 0, 0), (2, 0, 0), (0, 2, 0))], rays)


def what_is_no_ray_misses(subject: Subject) -> None:
    """A ray with a part that is NaN or infinite, or without direction, misses, and leaves its neighbours alone."""
    good = Ray((0.5, 0.25, 1), (0, 0, -1), 1, (0, 0, 1), u=0.25, v=0.125)
    rays = [good]
    for bad in (np.nan, np.inf, -np.inf):
        rays += [Ray((bad, 0.25, 1), (0, 0, -1), MISS), Ray((0.5, 0.25, 1), (0, bad, -1), MISS), good]
    rays += [Ray((0.5, 0.25, 1), (0, 0, 0), MISS), good]
    _hold(subject, [triangle((0, 0, 0), (2, 0, 0), (0, 2, 0))], rays)


def ties_go_to_the_lower_index(subject: Subject) -> None:
    """Of faces at exactly the same distance the lower shape is hit, then the lower primitive."""
    corners = ((0, 0, 0), (2, 0, 0), (0, 2, 0))
    hit = Ray((0.5, 0.25, 1), (0, 0, -1), 1, (0, 0, 1), u=0.25, v=0.125)
    _hold(subject, [triangle(*corners)] * 3, [hit])
    _hold(subject, [mesh([list(corner) for corner in corners], [[0, 1, 2]] * 3)], [hit])


def ties_of_spheres_go_to_the_lower_shape(subject: Subject) -> None:
    """Of spheres at exactly the same distance the lower shape is hit."""
    for label, renderer in subject.tracers(scene([sphere()] * 3)):
        _compare(renderer, [Ray((0, 0, 5), (0, 0, -1), 4, (0, 0, 1))], label)


def _random_rays(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    random = np.random.default_rng(5)
    return random.uniform([-4, -1, -4], [4, 5, 6], (count, 3)), random.normal(size=(count, 3))


def _differences(one: Hits, other: Hits) -> int:
    same_t = np.isclose(one.t, other.t, rtol=RELATIVE, atol=0, equal_nan=True)
    return int((~same_t | (one.shape != other.shape) | (one.primitive != other.primitive)).sum())


def trace_and_occluded_agree(subject: Subject) -> None:
    """Something lies in (0, t_max) exactly where the closest hit does."""
    origins, directions = _random_rays(499)
    for label, renderer in subject.tracers(subject.easiest[0]):
        hits = renderer.trace(origins, directions)
        hit = np.isfinite(hits.t)
        expect(0 < hit.sum() < len(hit), f"{label}: {hit.sum()} of {len(hit)} rays into the room hit")
        reach = np.where(hit, hits.t, 1.0)
        for t_max, expected in ((np.inf, hit), (reach * 1.001, hit), (reach * 0.999, np.zeros_like(hit))):
            wrong = int((np.asarray(renderer.occluded(origins, directions, t_max)) != expected).sum())
            expect(wrong == 0, f"{label}: trace and occluded contradict each other on {wrong} of {len(hit)} rays")


def rays_do_not_see_each_other(subject: Subject) -> None:
    """A ray's hit does not depend on the rays traced beside it."""
    origins, directions = _random_rays(83)
    for label, renderer in subject.tracers(subject.easiest[0]):
        whole = renderer.trace(origins, directions)
        for part in (slice(None, None, -1), *(slice(i, i + 1) for i in range(len(origins)))):
            picked = Hits(*(getattr(whole, name)[part] for name in ("t", "shape", "primitive", "normal", "u", "v")))
            count = _differences(picked, renderer.trace(origins[part], directions[part]))
            expect(count == 0, f"{label}: {count} rays of {part} hit something else than in the company of others")


def normals_are_unit_and_face_the_ray(subject: Subject) -> None:
    """Every normal is of length one and turned against its ray."""
    origins, directions = _random_rays(499)
    for label, renderer in subject.tracers(subject.easiest[0]):
        hits = renderer.trace(origins, directions)
        hit = np.isfinite(hits.t)
        lengths = np.linalg.norm(hits.normal[hit], axis=1)
        expect(np.allclose(lengths, 1, atol=1e-6), f"{label}: lengths of normals from {lengths.min()} to {lengths.max()}")
        away = int((np.einsum("ij,ij->i", hits.normal[hit], directions[hit]) > 0).sum())
        expect(away == 0, f"{label}: {away} of {hit.sum()} normals point along their ray")


CLAIMS = (
    hits_have_their_shapes,
    spheres_are_hit_where_they_are,
    cylinders_are_open_and_hit_on_both_sides,
    planes_are_hit_on_both_sides,
    triangles_are_hit_on_both_sides,
    meshes_say_which_face,
    the_nearest_of_many_wins,
    t_max_ends_a_ray,
    t_counts_in_lengths_of_the_direction,
    what_is_no_ray_misses,
    ties_go_to_the_lower_index,
    ties_of_spheres_go_to_the_lower_shape,
    trace_and_occluded_agree,
    rays_do_not_see_each_other,
    normals_are_unit_and_face_the_ray,
)

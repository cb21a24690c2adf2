"""The sets of rays, the same for every contestant and, for a seed, on every machine.

- camera: jittered primary rays, pixel by pixel along rows: neighbours go through the same boxes (coherent).
- shadow: from first hits towards points on lights, to be answered by `occluded`; those of one hit follow each other.
- incoherent: scattered by the cosine rule from first hits and from hits along paths of several bounces, all shuffled.

The kinds are those of Aila and Laine 2009, *Understanding the efficiency of ray traversal on GPUs* (primary, and diffuse), and
of Wald and others 2014, *Embree: a kernel framework for efficient CPU ray tracing*. Hits are exact (`truth`). Origins and
directions are float32 numbers, so that their rounding is no engine's error; origins leave a surface as in docs/transport.md.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.errors import Unsupported
from engines.scene import (
    Cylinder,
    DirectionalLight,
    Disk,
    EnvironmentLight,
    Instance,
    Mesh,
    Orthographic,
    Perspective,
    PointLight,
    ProjectorLight,
    Scene,
    Shape,
    Sphere,
    SphereSet,
    SpotLight,
    ThinLens,
    Triangle,
)
from harness.config.settings import RAY_KINDS
from harness.trace.truth import INSTANCES, Truth, unit

Array = NDArray[np.float64]
EPSILON = 256 * 2.0**-23
"""By how much an origin is off the surface, and a shadow ray's end off its light: as in docs/transport.md for float32."""
PATHS = 10_000
"""Paths, at most, whose hits the rays of `shadow` and `incoherent` start from."""


class Rays(NamedTuple):
    """`origins`, `directions` (n, 3) of any length, `t_max` (n,) in units of the direction's length."""

    origins: Array
    directions: Array
    t_max: Array

    def take(self, index: NDArray[np.int64]) -> Rays:
        """Those at these places."""
        return Rays(self.origins[index], self.directions[index], self.t_max[index])


def why_not(kind: str, scene: Scene) -> str | None:
    """Why a scene has no such rays, as far as its file, its camera and its lights say it, or None."""
    if scene.native is not None and scene.native.refusal:
        return scene.native.refusal
    if not isinstance(scene.camera, Perspective | ThinLens | Orthographic):
        return f"rays start from perspective, thin-lens and orthographic cameras: this is {type(scene.camera).__name__}"
    if any(isinstance(shape, Instance) for shape in scene.shapes):
        return INSTANCES
    if kind == "shadow" and not _makers(scene):
        return f"{scene.name} has no light that shadow rays could go to"
    return None


def make_rays(kind: str, scene: Scene, truth: Truth, count: int, bounces: int, seed: int) -> Rays:
    """`count` rays of one of `RAY_KINDS`. Raises `Unsupported` where a scene has none."""
    if reason := why_not(kind, scene):
        raise Unsupported(reason)
    rng = np.random.default_rng([seed, RAY_KINDS.index(kind)])
    if kind == "camera":
        return camera_rays(scene, count, rng)
    points, normals = _surface_points(scene, truth, min(count, PATHS), 1 if kind == "shadow" else bounces, rng)
    each = -(-count // len(points))
    if kind == "shadow":
        chosen = np.repeat(np.arange(len(points)), each)[np.linspace(0, len(points) * each - 1, count).astype(np.int64)]
        return _shadow_rays(scene, truth, points[chosen], normals[chosen], rng)
    chosen = rng.permutation(np.tile(np.arange(len(points)), each)[:count])
    directions = _scattered(normals[chosen], rng)
    return _rounded(Rays(_off(points[chosen], normals[chosen], truth), directions, np.full(count, np.inf)))


def camera_rays(scene: Scene, count: int, rng: np.random.Generator) -> Rays:
    """Rays through a random place of each pixel of an image with about `count` pixels; a thin lens counts as its pinhole."""
    camera = scene.camera
    assert isinstance(camera, Perspective | ThinLens | Orthographic)
    aspect = camera.resolution[0] / camera.resolution[1]
    width = max(1, round(math.sqrt(count * aspect)))
    height = -(-count // width)
    pixel = np.arange(count) * (width * height) // count
    place = np.stack([pixel % width, pixel // width], axis=1) + rng.random((count, 2))
    forward, right, up = _frame(camera)
    parallel = isinstance(camera, Orthographic)
    if isinstance(camera, Orthographic):
        across, along = (side / 2 for side in camera.window(aspect))
    else:
        half = math.tan(math.radians(camera.fov) / 2)
        across, along = (half, half / aspect) if camera.fov_axis == "x" else (half * aspect, half)
    share = 2 * (place / [width, height] - camera.principal_point) - 1
    aside = share[:, :1] * across * right - share[:, 1:] * along * up
    eye, ahead = np.array(camera.eye), np.broadcast_to(forward, (count, 3))
    origins = eye + aside if parallel else np.broadcast_to(eye, (count, 3))
    directions = ahead if parallel else unit(ahead + aside)
    near, far = camera.clip
    slope = directions @ forward
    return _rounded(Rays(origins + (near / slope)[:, None] * directions, directions, (far - near) / slope))


def _frame(camera: Perspective | ThinLens | Orthographic) -> tuple[Array, Array, Array]:
    """Unit vectors forward, right and up in the image."""
    forward = unit(np.subtract(camera.target, camera.eye)[None])[0]
    right = unit(np.cross(forward, camera.up)[None])[0]
    return forward, -right if camera.mirror else right, np.cross(right, forward)


def _surface_points(scene: Scene, truth: Truth, count: int, bounces: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Points (n, 3) that camera paths of diffuse bounces hit, and the normals there, towards where the path came from."""
    rays, points, normals = camera_rays(scene, count, rng), [], []
    for _ in range(bounces):
        hits = truth.closest(*rays)
        found = np.flatnonzero(hits.item >= 0)
        if not found.size:
            break
        origins, directions, _ = rays.take(found)
        points.append(origins + hits.t[found, None] * directions)
        normal = truth.normals(hits.item[found], points[-1])
        facing = np.where((normal * directions).sum(axis=1, keepdims=True) > 0, -normal, normal)
        normals.append(facing)
        ways = _scattered(facing, rng)
        rays = _rounded(Rays(_off(points[-1], facing, truth), ways, np.full(len(found), np.inf)))
    if not points:
        raise Unsupported(f"{scene.name}: no ray of the camera hits anything: there are rays of the kind camera alone")
    return np.concatenate(points), np.concatenate(normals)


def _scattered(normals: Array, rng: np.random.Generator) -> Array:
    """(n, 3) unit directions about normals, by the cosine rule: a point on the unit sphere about the normal's tip."""
    return unit(normals + unit(rng.normal(size=normals.shape)) * (1 - 1e-6))


def _off(points: Array, normals: Array, truth: Truth) -> Array:
    """Origins off the surface on the side of the normals."""
    size = np.maximum(np.abs(points).max(axis=1, keepdims=True), truth.largest * 2.0**-10)
    return points + EPSILON * size * normals


def _rounded(rays: Rays) -> Rays:
    origins, directions = (each.astype(np.float32).astype(np.float64) for each in rays[:2])
    return Rays(origins, directions, rays.t_max)


# --- towards lights -------------------------------------------------------------------------------------------------


def _shadow_rays(scene: Scene, truth: Truth, points: Array, normals: Array, rng: np.random.Generator) -> Rays:
    """A ray from each point to a random light: each as likely as another, points by area, skies by the cosine rule."""
    makers = _makers(scene)
    which, count = rng.integers(len(makers), size=len(points)), len(points)
    targets, directions, distant = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros(count, bool)
    for number, maker in enumerate(makers):
        own = np.flatnonzero(which == number)
        found, distant[own] = maker(normals[own], rng), maker.distant
        (directions if maker.distant else targets)[own] = found
    sides = np.where(distant[:, None], directions, targets - points)
    below = (sides * normals).sum(axis=1) < 0
    origins = _off(points, np.where(below[:, None], -normals, normals), truth)
    origins = origins.astype(np.float32).astype(np.float64)
    directions = np.where(distant[:, None], directions, targets - origins)
    t_max = np.where(distant, np.inf, 1.0 - EPSILON * (1.0 + truth.largest / _lengths(directions)))
    return _rounded(Rays(origins, directions, np.maximum(t_max, 0.5)))


def _makers(scene: Scene) -> list[_Maker]:
    """One for each light that rays can go to."""
    emitters = [*scene.lights, *(shape for shape in scene.shapes if _emits(scene, shape))]
    return [maker for each in emitters if (maker := _maker(each)) is not None]


def _lengths(vectors: Array) -> Array:
    return np.maximum(np.linalg.norm(vectors, axis=1), 1e-300)


def _emits(scene: Scene, shape: Shape) -> bool:
    if isinstance(shape, Instance):
        return False
    indices = np.unique(shape.materials) if isinstance(shape, Mesh) else [shape.material]
    return any(scene.materials[int(index)].emits for index in indices)


class _Maker:
    """Points on a light (n, 3), or directions where it is `distant`."""

    def __init__(self, make, distant: bool) -> None:
        self._make, self.distant = make, distant

    def __call__(self, normals: Array, rng: np.random.Generator) -> Array:
        return self._make(normals, rng)


def _maker(light: object) -> _Maker | None:
    match light:
        case PointLight() | SpotLight() | ProjectorLight():
            return _Maker(lambda normals, rng: np.tile(light.position, (len(normals), 1)), False)
        case DirectionalLight():
            return _Maker(lambda normals, rng: np.tile(-np.array(light.direction), (len(normals), 1)), True)
        case EnvironmentLight():
            return _Maker(_scattered, True)
        case Mesh() | Triangle():
            return _Maker(lambda normals, rng: _on_triangles(light, len(normals), rng), False)
        case Sphere() | SphereSet() | Disk() | Cylinder():
            return _Maker(lambda normals, rng: _on_round(light, len(normals), rng), False)
    return None


def _on_triangles(shape: Mesh | Triangle, count: int, rng: np.random.Generator) -> Array:
    faces = np.array([[shape.a, shape.b, shape.c]]) if isinstance(shape, Triangle) else shape.vertices[shape.faces]
    area = np.linalg.norm(np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0]), axis=1)
    a, b, c = faces[rng.choice(len(faces), size=count, p=area / area.sum())].transpose(1, 0, 2)
    u, v = rng.random((2, count, 1))
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    return a + u * (b - a) + v * (c - a)


def _on_round(shape: Sphere | SphereSet | Disk | Cylinder, count: int, rng: np.random.Generator) -> Array:
    way = unit(rng.normal(size=(count, 3)))
    if isinstance(shape, SphereSet):
        each = rng.choice(len(shape.radii), size=count, p=shape.radii**2 / (shape.radii**2).sum())
        return shape.centers[each] + shape.radii[each, None] * way
    if isinstance(shape, Sphere):
        return np.array(shape.center) + shape.radius * way
    if isinstance(shape, Disk):
        across = unit(way - (way @ np.array(shape.normal))[:, None] * np.array(shape.normal))
        return np.array(shape.center) + shape.radius * np.sqrt(rng.random((count, 1))) * across
    p0, whole = np.array(shape.p0), np.subtract(shape.p1, shape.p0)
    axis = unit(whole[None])[0]
    around = unit(way - (way @ axis)[:, None] * axis)
    return p0 + rng.random((count, 1)) * whole + shape.radius * around


# --- at shared edges and vertices -----------------------------------------------------------------------------------

LEAST_HEIGHT = 2e-5
"""Least height of triangles beside an edge, as a share of the largest coordinate: the ray's rounding must stay on them."""
LEAST_COSINE = 0.15
"""Least cosine between the ray and the faces at its edge or vertex, all of which face it."""
ATTEMPTS = 20
"""Times that rays are drawn until there are enough which all the faces at their target face."""
DEEPER = 1e-4
"""By how much, as a share of the way, a hit may lie behind the target."""


def hard_rays(truth: Truth, count: int, seed: int) -> Rays:
    """Rays aimed at points on edges that two triangles share, and at vertices all around which triangles are, half each.

    All the triangles there face the ray, so that none may pass: each has a hit at t <= 1 + `DEEPER`, its `t_max`. There are
    none where no triangles share edges. As in Woop, Benthin and Wald 2013, *Watertight ray/triangle intersection*.
    """
    rng = np.random.default_rng([seed, len(RAY_KINDS)])
    found: list[Rays] = []
    corners, faces = _merged(truth)
    normals = np.cross(corners[faces[:, 1]] - corners[faces[:, 0]], corners[faces[:, 2]] - corners[faces[:, 0]])
    edges, beside, fans = _shared(corners, faces, normals, LEAST_HEIGHT * truth.largest)
    extent = float(np.ptp(corners, axis=0).max()) if len(corners) else 0.0
    for _ in range(ATTEMPTS):
        left = count - sum(len(each.origins) for each in found)
        if left <= 0 or not len(edges):
            break
        half = left if not fans.size else left - left // 2
        chosen = rng.integers(len(edges), size=half)
        share = rng.uniform(0.05, 0.95, (half, 1))
        ends = corners[edges[chosen]]
        targets, around = ends[:, 0] * (1 - share) + ends[:, 1] * share, unit(normals.reshape(-1, 3))[beside[chosen]]
        found.append(_aimed(targets, around, extent, rng))
        if fans.size and left > half:
            vertices = fans[rng.integers(len(fans), size=left - half)]
            found += [_aimed(corners[vertices], _fan_normals(vertices, faces, unit(normals)), extent, rng)]
    if not found:
        return Rays(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    whole = Rays(*(np.concatenate(parts) for parts in zip(*found, strict=True)))
    return whole.take(rng.permutation(len(whole.origins))[:count])


def _aimed(targets: Array, around: Array, extent: float, rng: np.random.Generator) -> Rays:
    """Rays at targets (n, 3) from in front of, or behind, all the faces there, of unit normals (n, k, 3), zeros
    being none."""
    middle = unit(around.sum(axis=1))
    away = unit(middle + 0.9 * rng.random((len(targets), 1)) * unit(rng.normal(size=targets.shape)))
    cosines = (around * away[:, None]).sum(axis=2)
    clear = np.where(around.any(axis=2), cosines, 1.0).min(axis=1) > LEAST_COSINE
    side = rng.choice([-1.0, 1.0], (len(targets), 1))
    origins = (targets + side * rng.uniform(0.1, 1.0, (len(targets), 1)) * extent * away).astype(np.float32)
    directions = (targets - origins.astype(np.float64)).astype(np.float32).astype(np.float64)
    rays = Rays(origins.astype(np.float64), directions, np.full(len(targets), 1.0 + DEEPER))
    return rays.take(np.flatnonzero(clear))


def _merged(truth: Truth) -> tuple[Array, NDArray[np.int64]]:
    """All triangles with area as vertices (n, 3), each place once, and faces (m, 3)."""
    flat = truth.corners.reshape(-1, 3)
    if not len(flat):
        return flat, np.zeros((0, 3), np.int64)
    _, first, index = np.unique(
        np.ascontiguousarray(flat + 0.0).view([("", flat.dtype)] * 3).ravel(), return_index=True, return_inverse=True
    )
    faces = index.reshape(-1, 3)
    distinct = (faces != np.roll(faces, 1, axis=1)).all(axis=1)
    return flat[first], faces[distinct]


def _shared(
    corners: Array, faces: NDArray[np.int64], normals: Array, least: float
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Edges (n, 2) between exactly two faces (n, 2) of one orientation, and vertices that have only such edges."""
    if not len(faces):
        return np.zeros((0, 2), np.int64), np.zeros((0, 2), np.int64), np.zeros(0, np.int64)
    longest = np.linalg.norm(corners[faces] - corners[np.roll(faces, 1, axis=1)], axis=2).max(axis=1)
    good_face = np.linalg.norm(normals, axis=1) > least * longest
    ends = np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2)
    owner, upwards = np.repeat(np.arange(len(faces)), 3), ends[:, 0] < ends[:, 1]
    key = ends.min(axis=1) * len(corners) + ends.max(axis=1)
    order = np.argsort(key, kind="stable")
    starts = np.flatnonzero(np.diff(key[order], prepend=-1))
    pairs = starts[np.diff(starts, append=len(key)) == 2]
    one, other = order[pairs], order[pairs + 1]
    good = (upwards[one] != upwards[other]) & good_face[owner[one]] & good_face[owner[other]]
    one, other = one[good], other[good]
    whole = np.zeros(len(key), bool)
    whole[one] = whole[other] = True
    open_vertices = np.zeros(len(corners), bool)
    open_vertices[ends[~whole].ravel()] = True
    return ends[one], np.stack([owner[one], owner[other]], axis=1), np.flatnonzero(~open_vertices)


def _fan_normals(vertices: NDArray[np.int64], faces: NDArray[np.int64], normals: Array) -> Array:
    """(n, k, 3) normals of the faces around each vertex, zeros beyond their number."""
    corner = np.argsort(faces.ravel(), kind="stable")
    starts = np.searchsorted(faces.ravel()[corner], [vertices, vertices + 1])
    most = int((starts[1] - starts[0]).max())
    place = starts[0][:, None] + np.arange(most)
    there = place < starts[1][:, None]
    return np.where(there[..., None], normals[corner[np.where(there, place, 0)] // 3], 0.0)

"""Exact answers to rays in a whole scene: closest hits and occlusion, decided in decimals of 80 digits.

A hierarchy of boxes, padded by more than float64 rounds, leaves the primitives that a ray can meet; `oracle` decides
which it does meet. No code is shared with an engine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.errors import Unsupported
from engines.scene import Cylinder, Disk, Instance, Mesh, Plane, Scene, Sphere, SphereSet, Triangle
from harness.trace import oracle

Array = NDArray[np.float64]
Index = NDArray[np.int64]
GROUP = 8
"""Boxes that one of the level above holds."""
PADDING = 1e-12
"""Of boxes, as a share of the largest coordinate."""
LOOSE = 1e-6
"""How far outside of a triangle, in barycentric weights, the float64 filter still leaves a crossing to the decimals."""
PARALLEL = 1e-7
"""Sine of the angle between ray and triangle below which the filter leaves the crossing to the decimals."""
CHUNK = 2048
"""Rays that go through the hierarchy together."""
INSTANCES = "rays have exact answers in scenes without instances"


class Closest(NamedTuple):
    """Exact closest hits of n rays: `t` (n,) float64, inf for a miss; `item` (n,) index into `Truth.items`, -1 for a miss."""

    t: Array
    item: Index


@dataclass(frozen=True, slots=True)
class Items:
    """The primitives of a scene: `shape` and `primitive` as `Hits` names them, and where to find the geometry: `kind` and
    `place` in the arrays of that kind."""

    shape: Index
    primitive: Index
    kind: Index
    place: Index


TRIANGLE, SPHERE, OTHER = range(3)
Other = Plane | Disk | Cylinder


class Truth:
    """A scene whose rays can be answered exactly. `largest` is its largest coordinate, by size. Raises `Unsupported` for scenes
    with instances."""

    def __init__(self, scene: Scene) -> None:
        corners: list[Array] = [np.zeros((0, 3, 3))]
        spheres: list[Array] = [np.zeros((0, 4))]
        self.others: list[Other] = []
        named: list[tuple[int, Index, int]] = []
        for index, shape in enumerate(scene.shapes):
            count, kind = 1, OTHER
            if isinstance(shape, Mesh | Triangle):
                corners.append(_corners(shape))
                count, kind = len(corners[-1]), TRIANGLE
            elif isinstance(shape, Sphere | SphereSet):
                spheres.append(_sphere_rows(shape))
                count, kind = len(spheres[-1]), SPHERE
            elif isinstance(shape, Instance):
                raise Unsupported(INSTANCES)
            else:
                self.others.append(shape)
            named.append((index, np.arange(count), kind))
        self.corners, self.spheres = np.concatenate(corners), np.concatenate(spheres)
        self.items = _items(named)
        self._first = [np.flatnonzero(self.items.kind == kind) for kind in (TRIANGLE, SPHERE, OTHER)]
        self.largest = _largest(self.corners, self.spheres, self.others)
        self._levels = _hierarchy(*self._boxes(), PADDING * self.largest)

    def _boxes(self) -> tuple[Array, Array]:
        """Lowest and highest coordinates (n, 3) of triangles and spheres, in that order."""
        centers, radii = self.spheres[:, :3], self.spheres[:, 3:]
        low = np.concatenate([self.corners.min(axis=1), centers - radii])
        return low, np.concatenate([self.corners.max(axis=1), centers + radii])

    def closest(self, origins: Array, directions: Array, t_max: Array) -> Closest:
        """The first hits in (0, t_max) of rays (n, 3), (n, 3), (n,)."""
        found = Closest(np.full(len(origins), np.inf), np.full(len(origins), -1))
        for first in range(0, len(origins), CHUNK):
            part = slice(first, first + CHUNK)
            ray, item = self._candidates(origins[part], directions[part], t_max[part])
            self._offer(found, first + ray, item, origins, directions, t_max)
        for place, shape in enumerate(self.others):
            t = _other_t(shape, origins, directions)
            self._take(found, np.arange(len(origins)), np.full(len(t), self._first[OTHER][place]), t, t_max)
        return found

    def _offer(self, found: Closest, ray: Index, box: Index, o: Array, d: Array, t_max: Array) -> None:
        """Decides which of these pairs of a ray and a triangle or sphere meet, and takes over the nearest."""
        is_sphere = box >= len(self.corners)
        lines, faces = ray[~is_sphere], box[~is_sphere]
        near = _may_cross(self.corners[faces], o[lines], d[lines])
        lines, faces = lines[near], faces[near]
        if lines.size:
            a, b, c = (self.corners[faces, k] for k in range(3))
            t, u, v = oracle.triangle(a, b, c, o[lines], d[lines])
            inside = np.asarray((u >= 0) & (v >= 0) & (u + v <= 1), bool)
            self._take(found, lines, self._first[TRIANGLE][faces], np.where(inside, t.astype(np.float64), np.inf), t_max)
        lines, which = ray[is_sphere], box[is_sphere] - len(self.corners)
        if lines.size:
            roots = oracle.sphere_roots(self.spheres[which, :3], self.spheres[which, 3], o[lines], d[lines])
            for root in roots:
                self._take(found, lines, self._first[SPHERE][which], root.astype(np.float64), t_max)

    def _take(self, found: Closest, ray: Index, item: Index, t: Array, t_max: Array) -> None:
        good = np.flatnonzero((t > 0) & (t < t_max[ray]) & (t < found.t[ray]))
        order = good[np.argsort(t[good], kind="stable")[::-1]]  # of the values for one ray the last one written stays
        found.t[ray[order]], found.item[ray[order]] = t[order], item[order]

    def _candidates(self, o: Array, d: Array, t_max: Array) -> tuple[Index, Index]:
        """Pairs of a ray and a triangle or sphere whose box it meets before `t_max`."""
        if not self._levels:
            return np.zeros(0, np.int64), np.zeros(0, np.int64)
        with np.errstate(over="ignore"):
            inverse = 1.0 / np.where(np.abs(d) < 1e-300, np.copysign(1e-300, d), d)
        top = len(self._levels[-1].low)
        ray, box = np.repeat(np.arange(len(o)), top), np.tile(np.arange(top), len(o))
        for number, level in reversed([*enumerate(self._levels)]):
            met = _meets(level.low[box], level.high[box], o[ray], inverse[ray], t_max[ray])
            ray, box = ray[met], box[met]
            if number:
                ray, box = np.repeat(ray, GROUP), (box[:, None] * GROUP + np.arange(GROUP)).ravel()
                there = box < len(self._levels[number - 1].low)
                ray, box = ray[there], box[there]
        return ray, self._levels[0].order[box]

    def normals(self, item: Index, points: Array) -> Array:
        """(n, 3) unit normals of items at points (n, 3); 0 of a triangle without area."""
        found = np.zeros((len(item), 3))
        kind, place = self.items.kind[item], self.items.place[item]
        face, sphere = kind == TRIANGLE, kind == SPHERE
        a, b, c = (self.corners[place[face], k] for k in range(3))
        found[face] = unit(np.cross(b - a, c - a))
        found[sphere] = unit(points[sphere] - self.spheres[place[sphere], :3])
        for index in np.flatnonzero(kind == OTHER):
            shape = self.others[place[index]]
            if isinstance(shape, Cylinder):
                p0 = np.array(shape.p0)
                axis = unit(np.subtract(shape.p1, p0)[None])[0]
                away = points[index] - p0
                found[index] = unit((away - (away @ axis) * axis)[None])[0]
            else:
                found[index] = shape.normal
        return found

    def distance(self, item: Index, points: Array) -> Array:
        """(n,) distances of points (n, 3) from items; infinite for those of no item (-1)."""
        found = np.full(len(item), np.inf)
        kind = np.where(item < 0, -1, self.items.kind[item])
        place = np.where(item < 0, 0, self.items.place[item])
        face, sphere = kind == TRIANGLE, kind == SPHERE
        found[face] = triangle_distance(self.corners[place[face]], points[face])
        off = np.linalg.norm(points[sphere] - self.spheres[place[sphere], :3], axis=1)
        found[sphere] = np.abs(off - self.spheres[place[sphere], 3])
        for index in np.flatnonzero(kind == OTHER):
            found[index] = _other_distance(self.others[place[index]], points[index])
        return found

    def item_of(self, shape: Index, primitive: Index) -> Index:
        """Items by what `Hits` says; -1 for what is none."""
        starts = np.searchsorted(self.items.shape, np.arange(self.items.shape.max(initial=-1) + 2))
        known = (shape >= 0) & (shape < len(starts) - 1)
        safe = np.where(known, shape, 0)
        if len(starts) < 2:
            return np.full(len(shape), -1)
        known &= (primitive >= 0) & (primitive < starts[safe + 1] - starts[safe])
        return np.where(known, starts[safe] + np.where(known, primitive, 0), -1)


def unit(vectors: Array) -> Array:
    """Rows of length 1; rows of zeros stay."""
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)


def triangle_distance(corners: Array, points: Array) -> Array:
    """(n,) distances of points (n, 3) from triangles (n, 3, 3), edges included."""
    edges = np.roll(corners, -1, axis=1) - corners
    away = points[:, None] - corners
    length = (edges**2).sum(axis=2)
    along = np.clip((away * edges).sum(axis=2) / np.where(length > 0, length, 1.0), 0.0, 1.0)
    nearest = np.linalg.norm(away - along[..., None] * edges, axis=2).min(axis=1)
    normal = unit(np.cross(edges[:, 0], -edges[:, 2]))
    inside = ((np.cross(edges, away) * normal[:, None]).sum(axis=2) >= 0).all(axis=1) & normal.any(axis=1)
    return np.where(inside, np.abs((away[:, 0] * normal).sum(axis=1)), nearest)


class _Level(NamedTuple):
    """Boxes of a level (n, 3); the lowest one has the `order` of the primitives in it."""

    low: Array
    high: Array
    order: Index


def _hierarchy(low: Array, high: Array, padding: float) -> list[_Level]:
    """Levels from single primitives up, in the order of their Morton codes."""
    if not len(low):
        return []
    order = np.argsort(_morton(0.5 * (low + high)), kind="stable")
    levels = [_Level(low[order] - padding, high[order] + padding, order)]
    while len(levels[-1].low) > GROUP:
        starts = np.arange(0, len(levels[-1].low), GROUP)
        below = levels[-1]
        parts = np.minimum.reduceat(below.low, starts), np.maximum.reduceat(below.high, starts)
        levels.append(_Level(*parts, starts))
    return levels


def _morton(points: Array) -> Index:
    """Codes of 3 x 20 bits."""
    low, high = points.min(axis=0), points.max(axis=0)
    cells = ((points - low) / np.where(high > low, high - low, 1.0) * (2**20 - 1)).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for bit in range(20):
        for axis in range(3):
            code |= ((cells[:, axis] >> bit) & 1) << (3 * bit + axis)
    return code


def _meets(low: Array, high: Array, origin: Array, inverse: Array, t_max: Array) -> NDArray[np.bool_]:
    """Whether rays enter boxes before `t_max`, never missing one by rounding."""
    with np.errstate(invalid="ignore", over="ignore"):
        one, other = (low - origin) * inverse, (high - origin) * inverse
        enter, leave = np.fmin(one, other).max(axis=1), np.fmax(one, other).min(axis=1)
    slack = 1e-12 * np.abs(np.where(np.isfinite(leave), leave, 0.0))
    return (enter <= leave + slack) & (leave >= 0) & (enter <= t_max + slack)


def _may_cross(corners: Array, origin: Array, direction: Array) -> NDArray[np.bool_]:
    """A filter in float64: False only for lines that surely pass beside their triangles."""
    a, ab, ac = corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    p, s = np.cross(direction, ac), origin - a
    q = np.cross(s, ab)
    det = (ab * p).sum(axis=1)
    size = np.linalg.norm(ab, axis=1) * np.linalg.norm(ac, axis=1) * np.linalg.norm(direction, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = (s * p).sum(axis=1) / det, (direction * q).sum(axis=1) / det
        inside = np.minimum(np.minimum(u, v), 1.0 - u - v) >= -LOOSE
    far = np.linalg.norm(s, axis=1) > 1e6 * np.sqrt(np.maximum((ab**2).sum(axis=1), (ac**2).sum(axis=1)))
    return inside | far | (np.abs(det) <= PARALLEL * size)


def _items(named: Sequence[tuple[int, Index, int]]) -> Items:
    count = [0, 0, 0]
    parts: list[tuple[Index, Index, Index, Index]] = [tuple(np.zeros(0, np.int64) for _ in range(4))]  # type: ignore
    for shape, primitives, kind in named:
        n = len(primitives)
        parts.append((np.full(n, shape), primitives, np.full(n, kind), count[kind] + np.arange(n)))
        count[kind] += n
    return Items(*(np.concatenate(each) for each in zip(*parts, strict=True)))


def _corners(shape: Mesh | Triangle) -> Array:
    """(n, 3, 3) corners of triangles."""
    if isinstance(shape, Triangle):
        return np.array([[shape.a, shape.b, shape.c]], np.float64)
    return shape.vertices[shape.faces]


def _sphere_rows(shape: Sphere | SphereSet) -> Array:
    """(n, 4) centers and radii."""
    if isinstance(shape, Sphere):
        return np.array([[*shape.center, shape.radius]])
    return np.concatenate([shape.centers, shape.radii[:, None]], axis=1)


def _largest(corners: Array, spheres: Array, others: Sequence[Other]) -> float:
    """The largest coordinate of anything that has bounds, by size, and of the points that planes go through."""
    sizes = [np.abs(corners).max(initial=0.0), (np.abs(spheres[:, :3]) + spheres[:, 3:]).max(initial=0.0)]
    sizes += [np.abs(np.asarray(shape.point if isinstance(shape, Plane) else shape.bounds())).max() for shape in others]
    return float(max(sizes)) or 1.0


@oracle.exactly
def _other_t(shape: Other, origins: Array, directions: Array) -> Array:
    """(n,) smallest t > 0 at which rays meet a plane, disk or cylinder; inf for none."""
    if isinstance(shape, Cylinder):
        return oracle.cylinder(shape.p0, shape.p1, shape.radius, origins, directions)[0].astype(np.float64)
    point, normal = (shape.point, shape.normal) if isinstance(shape, Plane) else (shape.center, shape.normal)
    n, o, d = (oracle.lift(each) for each in (normal, origins, directions))
    slope = oracle.dot(n, d)
    flat = np.asarray(slope == 0, bool)
    t = oracle.dot(n, oracle.lift(point) - o) / np.where(flat, oracle.lift(1.0), slope)
    met = ~flat & np.asarray(t > 0, bool)
    if isinstance(shape, Disk):
        away = o + t[:, None] * d - oracle.lift(point)
        met &= np.asarray(oracle.dot(away, away) <= oracle.lift(shape.radius) ** 2, bool)
    return np.where(met, t.astype(np.float64), np.inf)


def _other_distance(shape: Other, point: Array) -> float:
    if isinstance(shape, Cylinder):
        axis = unit(np.subtract(shape.p1, shape.p0)[None])[0]
        away = point - shape.p0
        length = float(np.linalg.norm(np.subtract(shape.p1, shape.p0)))
        along = float(away @ axis)
        beside = float(np.linalg.norm(away - along * axis)) - shape.radius
        return float(np.hypot(beside, max(0.0, -along, along - length)))
    away = point - np.array(shape.point if isinstance(shape, Plane) else shape.center)
    height = float(away @ np.array(shape.normal))
    if isinstance(shape, Plane):
        return abs(height)
    beside = float(np.linalg.norm(away - height * np.array(shape.normal)))
    return float(np.hypot(height, max(0.0, beside - shape.radius)))

"""A hierarchy of lights, by which one is chosen from a point (Conty Estevez and Kulla 2018): nodes of eight children each.

All engines share the tree and choose in it by their own code (docs/transport.md). Any tree whose bounds hold gives the same
mean.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.scene.bsdf_tree import transmits
from engines.scene.light_bounds import LightBounds, bounding_cone, light_bounds
from engines.scene.scene import Scene

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

WIDTH = 8
"""Children of a node."""
CUTS = 12
"""Parts of equal width into which an axis is cut to find where a group of lights is split."""
MOST_TRIED = 4096
"""Lights of a group beyond which it is halved at the median of its longest axis."""


class LightHierarchy(NamedTuple):
    """m nodes, the first the root. Where a child is missing its power is 0.

    Of each child: the sphere around its box, the cone and power of `LightBounds`, and `child`: a node's index, or -1 - j
    for light j.
    """

    center: Array
    """(m, 8, 3) metres."""
    radius: Array
    """(m, 8)"""
    axis: Array
    """(m, 8, 3) unit."""
    spread: Array
    """(m, 8) radians, as `reach`."""
    reach: Array
    power: Array
    child: Indices
    parent: Indices
    """(m,) 8 times the node's parent plus the place in it; -1 of the root."""
    place: Indices
    """(J,) the same of each light; -1 of lights that are in no node."""
    unbounded: Indices
    """Lights from everywhere, which are in no node."""
    through: bool
    """Some BSDF transmits: a surface may be lit from behind."""


class _Lights(NamedTuple):
    """Bounds of n lights as arrays: box (n, 2, 3), axis (n, 3), and (n,) each."""

    box: Array
    axis: Array
    spread: Array
    reach: Array
    power: Array


def light_hierarchy(scene: Scene) -> LightHierarchy:
    """The hierarchy of a scene's lights; lights without power are left out."""
    bounds = light_bounds(scene)
    bounded = [j for j, light in enumerate(bounds) if light.box is not None and light.power > 0.0]
    unbounded = np.array([j for j, light in enumerate(bounds) if light.box is None], np.int64)
    nodes, place = _Nodes(), np.full(len(bounds), -1, np.int64)
    if bounded:
        nodes.build(_arrays([bounds[j] for j in bounded]), np.array(bounded), place)
    return nodes.hierarchy(place, unbounded, lit_through(scene))


def lit_through(scene: Scene) -> bool:
    """Whether some BSDF transmits, so that light from behind a surface may count."""
    return any(transmits(material.as_bsdf) for material in scene.materials)


def _arrays(bounds: list[LightBounds]) -> _Lights:
    columns = zip(*((light.box, light.axis, light.spread, light.reach, light.power) for light in bounds), strict=True)
    return _Lights(*(np.array(column, np.float64) for column in columns))


class _Nodes:
    """Rows of the hierarchy while it grows."""

    def __init__(self) -> None:
        self.rows: list[Array] = []
        self.child: list[Indices] = []
        self.parent: list[int] = []

    def build(self, lights: _Lights, light: Indices, place: Indices) -> None:
        """Adds the tree of the lights whose numbers in the scene are `light`, and fills in their `place`."""
        waiting: list[tuple[Indices, int]] = [(np.arange(light.size), -1)]
        while waiting:
            members, parent = waiting.pop()
            node = len(self.rows)
            if parent >= 0:
                self.child[parent // WIDTH][parent % WIDTH] = node
            row, child = np.zeros((WIDTH, 10)), np.zeros(WIDTH, np.int64)
            for slot, group in enumerate(_groups(lights, members)):
                row[slot] = _row(lights, group)
                if group.size == 1:
                    child[slot] = -1 - light[group[0]]
                    place[light[group[0]]] = WIDTH * node + slot
                else:
                    waiting.append((group, WIDTH * node + slot))
            self.rows.append(row)
            self.child.append(child)
            self.parent.append(parent)

    def hierarchy(self, place: Indices, unbounded: Indices, through: bool) -> LightHierarchy:
        rows = np.reshape(self.rows, (-1, WIDTH, 10))
        center, radius, axis, spread, reach, power = (
            rows[..., 0:3],
            rows[..., 3],
            rows[..., 4:7],
            rows[..., 7],
            rows[..., 8],
            rows[..., 9],
        )
        child, parent = np.reshape(self.child, (-1, WIDTH)).astype(np.int64), np.array(self.parent, np.int64)
        return LightHierarchy(center, radius, axis, spread, reach, power, child, parent, place, unbounded, through)


def _row(lights: _Lights, group: Indices) -> Array:
    """Center and radius of the sphere around the group's box, its cone, and its power."""
    low, high = lights.box[group, 0].min(axis=0), lights.box[group, 1].max(axis=0)
    axis, spread = lights.axis[group[0]], lights.spread[group[0]]
    if group.size > 1:
        axis, spread = bounding_cone(lights.axis[group], lights.spread[group])
    radius = float(np.linalg.norm(high - low)) / 2.0
    return np.array([*(low + high) / 2.0, radius, *axis, spread, lights.reach[group].max(), lights.power[group].sum()])


def _groups(lights: _Lights, members: Indices) -> list[Indices]:
    """The members in at most eight groups: the group that costs most is split until there are as many."""
    if members.size <= WIDTH:
        return [members[k : k + 1] for k in range(members.size)]
    groups, costs = [members], [np.inf]
    while len(groups) < WIDTH:
        most = int(np.argmax(costs))
        left, right = _split(lights, groups[most])
        groups[most : most + 1] = [left, right]
        costs[most : most + 1] = [
            -np.inf if g.size == 1 else float(_cost(lights, g, np.ones((1, g.size), bool))[0]) for g in (left, right)
        ]
    return groups


def _split(lights: _Lights, members: Indices) -> tuple[Indices, Indices]:
    """Two groups, cut across an axis where the sum of their costs is least."""
    middle = lights.box[members].mean(axis=1)
    low, extent = middle.min(axis=0), np.ptp(middle, axis=0)
    longest = extent.max()
    if longest > 0.0 and members.size <= MOST_TRIED:
        share = (middle - low) / np.where(extent > 0.0, extent, 1.0)
        left = (share.T[:, None] < (np.arange(1, CUTS) / CUTS)[:, None]).reshape(-1, members.size)
        axis = np.repeat(np.arange(3), CUTS - 1)
        tried = np.flatnonzero(left.any(axis=1) & ~left.all(axis=1))
        left, thin = left[tried], longest / extent[axis[tried]]
        costs = thin * (_cost(lights, members, left) + _cost(lights, members, ~left))
        chosen = left[np.argmin(costs)]
        return members[chosen], members[~chosen]
    order = members[np.argsort(middle[:, np.argmax(extent)], kind="stable")]
    return order[: order.size // 2], order[order.size // 2 :]


def _cost(lights: _Lights, members: Indices, taken: NDArray[np.bool_]) -> Array:
    """(k,) of k selections (k, n) of the members, none empty: power, times the solid angle into which they shine, times the
    square of their box's diagonal. (The surface area orientation heuristic, by the sphere around the box.)"""
    box, axis, spread = lights.box[members], lights.axis[members], lights.spread[members]
    low = np.where(taken[:, :, None], box[:, 0], np.inf).min(axis=1)
    high = np.where(taken[:, :, None], box[:, 1], -np.inf).max(axis=1)
    total = taken @ axis
    length = np.linalg.norm(total, axis=1, keepdims=True)
    mean = total / np.where(length > 0.0, length, 1.0)
    angle = np.arccos(np.clip(mean @ axis.T, -1.0, 1.0)) + spread
    cone = np.minimum(np.where(taken, angle, 0.0).max(axis=1), np.pi)
    cone = np.where(length[:, 0] > 0.0, cone, np.pi)
    edge = np.minimum(cone + np.where(taken, lights.reach[members], 0.0).max(axis=1), np.pi)
    solid_angle = 2.0 * np.pi * (1.0 - np.cos(cone)) + np.pi / 2.0 * (
        2.0 * edge * np.sin(cone) - np.cos(cone - 2.0 * edge) - 2.0 * cone * np.sin(cone) + np.cos(cone)
    )
    return (taken @ lights.power[members]) * solid_angle * np.square(high - low).sum(axis=1)

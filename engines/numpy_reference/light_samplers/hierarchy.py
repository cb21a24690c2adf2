"""The choice of a light by a hierarchy: node by node, in proportion to how much each child may send to the point."""

from __future__ import annotations

import numpy as np

from engines.numpy_reference.distribution import BELOW_ONE
from engines.numpy_reference.light_samplers.plain import ChosenLight
from engines.numpy_reference.vectors import Array, Indices, cross, dot, norm
from engines.scene.light_hierarchy import WIDTH, LightHierarchy


class HierarchicalLightSampler:
    """Lights without a box with one probability each, all others by the tree with that of one more light."""

    def __init__(self, tree: LightHierarchy) -> None:
        self._tree = tree
        self._parts = tree.unbounded.size + int(tree.child.size > 0)
        self._is_unbounded = np.zeros(tree.place.size, bool)
        self._is_unbounded[tree.unbounded] = True

    def choose(self, point: Array, geometric: Array, u: Array) -> ChosenLight:
        if not self._parts:
            return ChosenLight(np.full(u.size, -1), u, np.full(u.size, np.inf))
        scaled = u * self._parts
        part = np.minimum(scaled.astype(np.int64), self._parts - 1)
        light, uc, probability = np.full(u.size, -1), scaled - part, np.full(u.size, 1.0 / self._parts)
        outside = np.flatnonzero(part < self._tree.unbounded.size)
        light[outside] = self._tree.unbounded[part[outside]]
        inside = np.flatnonzero(part >= self._tree.unbounded.size)
        node = np.zeros(inside.size, np.int64)
        while inside.size:
            shares = self._shares(node, point.take(inside, axis=1), geometric.take(inside, axis=1))
            sums = np.cumsum(shares, axis=0)
            slot = np.minimum((sums <= uc[inside] * sums[-1]).sum(axis=0), WIDTH - 1)
            lane = np.arange(inside.size)
            share = shares[slot, lane]
            with np.errstate(divide="ignore", invalid="ignore"):
                left = (uc[inside] * sums[-1] - sums[slot, lane] + share) / share
                probability[inside] *= share / sums[-1]
            uc[inside] = np.clip(left, 0.0, BELOW_ONE)
            child = np.where(share > 0.0, self._tree.child[node, slot], 0)
            light[inside] = np.where(child < 0, -1 - child, -1)
            inside, node = inside[child > 0], child[child > 0]
        probability[light < 0] = 0.0
        with np.errstate(divide="ignore"):
            return ChosenLight(light, uc, 1.0 / probability)

    def inverse_pmf(self, light: Indices, point: Array, geometric: Array) -> Array:
        place = self._tree.place[light]
        known = (place >= 0) | self._is_unbounded[light]
        probability = np.where(known, 1.0 / max(self._parts, 1), 0.0)
        lanes = np.flatnonzero(place >= 0)
        place = place[lanes]
        while lanes.size:
            shares = self._shares(place // WIDTH, point.take(lanes, axis=1), geometric.take(lanes, axis=1))
            with np.errstate(invalid="ignore"):
                share = shares[place % WIDTH, np.arange(lanes.size)] / shares.sum(axis=0)
            probability[lanes] *= np.where(share > 0.0, share, 0.0)
            place = self._tree.parent[place // WIDTH]
            lanes, place = lanes[place >= 0], place[place >= 0]
        with np.errstate(divide="ignore"):
            return 1.0 / probability

    def _shares(self, node: Indices, point: Array, geometric: Array) -> Array:
        """(8, n) importance of the children of nodes (n,) at points (3, n)."""
        tree = self._tree
        center, axis = (vectors[node].transpose(2, 1, 0) for vectors in (tree.center, tree.axis))
        radius, spread, reach, power = (numbers[node].T for numbers in (tree.radius, tree.spread, tree.reach, tree.power))
        from_light = point[:, None] - center
        distance = norm(from_light)
        with np.errstate(divide="ignore", invalid="ignore"):
            half_angle = np.arcsin(radius / distance)
        inside = distance <= radius
        half_angle = np.where(inside, np.pi, half_angle)
        # the least angle between the light's axis, or its cone, and a direction to the point
        emitted = np.maximum(0.0, _angle(axis, from_light) - spread - half_angle)
        # the least one between the normal and a direction to the light
        normal = np.broadcast_to(geometric[:, None], from_light.shape)
        incident = _angle(normal, -from_light)
        if tree.through:
            incident = np.minimum(incident, np.pi - incident)
        incident = np.maximum(0.0, incident - half_angle)
        square = np.maximum(np.square(np.maximum(distance, radius)), 1e-30)
        lit = (emitted < reach) & (incident < np.pi / 2)
        return np.where(lit, power * np.cos(emitted) * np.cos(incident) / square, 0.0)


def _angle(a: Array, b: Array) -> Array:
    """Between vectors of any length, precise near 0 and pi; 0 where one is 0, whatever the signs of its zeros."""
    return np.arctan2(norm(cross(a, b)), dot(a, b) + 0.0)

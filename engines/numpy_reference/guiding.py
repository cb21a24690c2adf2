"""Path guiding: BSDFs whose directions are in part sampled by an SD-tree, and what the tree learns from paths.

Müller, Gross and Novák 2017; docs/transport.md, "Path guiding".
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from engines.choices import Choice
from engines.numpy_reference.bsdf import BSDFSample, Lobes
from engines.numpy_reference.distribution import BELOW_ONE
from engines.numpy_reference.interaction import SurfaceInteraction
from engines.numpy_reference.materials import Materials
from engines.numpy_reference.vectors import Array, Indices, Mask, dot
from engines.scene import Scene
from engines.sd_tree import COUNT, HALF_WORD, HIGH, LOW, MOST, MOST_RECORDS, UNIT, SDTree, Training


class Records(NamedTuple):
    """m directions in which vertices scattered paths."""

    lane: Indices
    cell: Indices
    """(m,) where in the tree the direction lies."""
    throughput: Array
    """(3, m) of the path, before the vertex."""
    radiance: Array
    """(3, m) of the path, emission and light sample of the vertex included."""


class GuidedScattering:
    """`sample` and `pdf` of the scene's materials, guided where a BSDF has a lobe that is no delta."""

    def __init__(self, materials: Materials, scene: Scene, shader: Choice) -> None:
        options = shader.options
        boxes = [box for shape in scene.shapes if (box := shape.bounds()) is not None]
        self.training = Training(boxes, options["spatial_threshold"], options["flux_threshold"])
        self._materials, self._bsdf_fraction = materials, options["bsdf_fraction"]
        self._found: list[tuple[Indices, Array]] = []

    def sample(self, at: SurfaceInteraction, uc: Array, u0: Array, u1: Array) -> tuple[BSDFSample, Array]:
        """`Materials.sample`, where what is guided has the density of both ways to find a direction; and how many times that
        of the BSDF alone this is (n,), at least 1."""
        tree, share = self.training.tree, self._share_of_bsdf(at)
        by_bsdf = uc < share
        found = self._materials.sample(at, np.minimum(uc / share, BELOW_ONE), u0, u1)
        leaf = leaf_at(tree, at.point)
        wi = np.where(by_bsdf, found.wi, sample_direction(tree, leaf, u0, u1))
        pdf = np.where(by_bsdf, found.pdf, self._materials.pdf(at, wi))
        _, guide_pdf = cell_and_pdf(tree, leaf, wi)
        mixed = share * pdf + (1.0 - share) * guide_pdf * _opacity(at)
        value = self._materials.evaluate(at, wi) * np.abs(dot(at.normal, wi))
        with np.errstate(divide="ignore", invalid="ignore"):
            by_chance = found.weight * np.where(np.isinf(pdf), 1.0 / share, pdf / mixed)
            weight = np.where(by_bsdf, by_chance, np.where(value > 0.0, value / mixed, 0.0))
            odds = np.where(np.isfinite(pdf) & (pdf > 0.0), np.maximum(mixed / pdf, 1.0), 1.0)
        return BSDFSample(wi, np.where(mixed > 0.0, weight, 0.0), mixed), odds

    def pdf(self, at: SurfaceInteraction, wi: Array) -> Array:
        """(n,) per solid angle, with which `sample` finds directions (3, n) by a lobe that is no delta, or by the tree."""
        tree, share = self.training.tree, self._share_of_bsdf(at)
        _, guide_pdf = cell_and_pdf(tree, leaf_at(tree, at.point), wi)
        return share * self._materials.pdf(at, wi) + (1.0 - share) * guide_pdf * _opacity(at)

    def evaluate(self, at: SurfaceInteraction, wi: Array) -> Array:
        """`Materials.evaluate`."""
        return self._materials.evaluate(at, wi)

    def record(self, lane: Indices, point: Array, wi: Array, throughput: Array, radiance: Array) -> Records:
        """What is kept of directions (3, m) in which vertices at points (3, m) scattered paths; see `Records`."""
        tree = self.training.tree
        return Records(lane, cell_and_pdf(tree, leaf_at(tree, point), wi)[0], throughput, radiance)

    def add(self, records: Records, radiance: Array) -> None:
        """Takes what the vertices have sent on from the directions, given the radiance (3, n) of whole paths."""
        with np.errstate(divide="ignore", invalid="ignore"):
            sent_on = (radiance.take(records.lane, axis=1) - records.radiance) / records.throughput
        self._found.append((records.cell, np.where(records.throughput > 0.0, sent_on, 0.0).mean(axis=0)))

    def commit(self, spp: int) -> None:
        """Adds up what has been taken, of a pass that is whole; the film has `spp` samples per pixel now."""
        totals = self.training.totals.reshape(-1, 3)
        for cell, found in self._found:
            units = np.where((found > 0.0) & (found < np.inf), np.minimum(found, MOST) / UNIT + 0.5, 0.0).astype(np.int64)
            np.add.at(totals, (cell, LOW), units & ((1 << HALF_WORD) - 1))
            np.add.at(totals, (cell, HIGH), units >> HALF_WORD)
            np.add.at(totals, (cell, COUNT), 1)
        self.drop()
        if spp == self.training.end:
            self.training.advance()

    def drop(self) -> None:
        """Forgets what has been taken, of a pass that was stopped."""
        self._found.clear()

    def restart(self) -> None:
        """Forgets everything, as the film does."""
        self.drop()
        self.training.restart()

    def _share_of_bsdf(self, at: SurfaceInteraction) -> Array:
        """(n,) the probability with which the BSDF samples the direction."""
        if not self.training.guides:
            return np.ones(at.material.size)
        guided = self._materials.has(at, Lobes.NON_SPECULAR)
        if at.wrapped is not None:
            guided &= ~at.wrapped.passing
        return np.where(guided, self._bsdf_fraction, 1.0)


def recorded(pdf: Array, depth: Indices) -> Mask:
    """(n,) whether something is learned from directions of these densities, scattered at vertex number `depth` of a path."""
    return np.isfinite(pdf) & (pdf > 0.0) & (depth <= MOST_RECORDS)


def leaf_at(tree: SDTree, point: Array) -> NDArray[np.int64]:
    """(n,) leaves in which points (3, n) lie; what is outside the box counts as on its surface."""
    place = (point - tree.corner[:, None]) / tree.size[:, None]
    place = np.clip(place, 0.0, BELOW_ONE)
    node, axis = np.full(point.shape[1], tree.root, np.int64), 0
    inner = np.flatnonzero(node >= 0)
    while inner.size:
        doubled = 2.0 * place[axis, inner]
        upper = doubled >= 1.0
        place[axis, inner] = doubled - upper
        node[inner] = tree.halves[node[inner], upper.astype(np.int64)]
        inner, axis = inner[node[inner] >= 0], (axis + 1) % 3
    return -1 - node


def sample_direction(tree: SDTree, leaf: Indices, u0: Array, u1: Array) -> Array:
    """(3, n) unit directions, in proportion to the light in the quadtrees of leaves (n,), by numbers (n,) in [0, 1)."""
    node, u0, u1 = leaf.astype(np.int64), u0.copy(), u1.copy()
    x, y, edge = np.zeros(leaf.size), np.zeros(leaf.size), np.ones(leaf.size)
    inside = np.arange(leaf.size)
    while inside.size:
        left, low_left, low_right = tree.shares[node[inside]].T
        right, u0[inside] = _chosen(u0[inside], left)
        high, u1[inside] = _chosen(u1[inside], np.where(right, low_right, low_left))
        edge[inside] /= 2.0
        x[inside] += right * edge[inside]
        y[inside] += high * edge[inside]
        node[inside] = tree.quarters[node[inside], right + 2 * high]
        inside = inside[node[inside] >= 0]
    z, phi = 2.0 * (x + u0 * edge) - 1.0, 2.0 * np.pi * (y + u1 * edge)
    radius = np.sqrt(np.maximum(0.0, 1.0 - z * z))
    return np.stack([radius * np.cos(phi), radius * np.sin(phi), z])


def cell_and_pdf(tree: SDTree, leaf: Indices, wi: Array) -> tuple[NDArray[np.int64], Array]:
    """Cells in which directions (3, n) lie, as 4 times the node plus the quarter; and the density of `sample_direction`."""
    x = np.clip(0.5 * (wi[2] + 1.0), 0.0, BELOW_ONE)
    y = np.arctan2(wi[1], wi[0]) / (2.0 * np.pi)
    y = np.clip(np.where(y < 0.0, y + 1.0, y), 0.0, BELOW_ONE)
    node, cell, pdf = leaf.astype(np.int64), np.zeros(leaf.size, np.int64), np.full(leaf.size, 1.0 / (4.0 * np.pi))
    inside = np.arange(leaf.size)
    while inside.size:
        x[inside], y[inside] = 2.0 * x[inside], 2.0 * y[inside]
        right, high = x[inside] >= 1.0, y[inside] >= 1.0
        x[inside] -= right
        y[inside] -= high
        cell[inside] = 4 * node[inside] + right + 2 * high
        pdf[inside] *= tree.densities.reshape(-1)[cell[inside]]
        node[inside] = tree.quarters.reshape(-1)[cell[inside]]
        inside = inside[node[inside] >= 0]
    return cell, pdf


def _chosen(u: Array, share: Array) -> tuple[Indices, Array]:
    """Whether `u` chooses the second of two, whose first has this share, as 1 or 0; and the rest of `u`."""
    second = u >= share
    with np.errstate(divide="ignore", invalid="ignore"):
        rest = np.where(second, (u - share) / (1.0 - share), u / share)
    return second.astype(np.int64), np.minimum(rest, BELOW_ONE)


def _opacity(at: SurfaceInteraction) -> Array | float:
    return 1.0 if at.wrapped is None else at.wrapped.opacity

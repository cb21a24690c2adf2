"""What integrators choose a light by, where they do not choose evenly (docs/transport.md)."""

from __future__ import annotations

import numpy as np

from engines.kernels.flatten.scene import FlatScene
from engines.kernels.layout import SceneTable
from engines.light_cells import SIDES, STEPS, LightCells, unlearned_cells
from engines.scene import EnvironmentLight, Scene
from engines.scene.light_bounds import light_shares
from engines.scene.light_hierarchy import LightHierarchy, light_hierarchy, lit_through

NODE_NUMBERS = 88
"""Numbers of a node of the hierarchy, of eight children each: center, radius, axis, cosine and sine of the spread, cosine of
the reach, power."""


def bind_light_sampler(flat: FlatScene, scene: Scene, name: str) -> None:
    """Adds the tables of the light sampler `name`, and the feature that compiles it; none where there is no choice."""
    flat.bind(SceneTable.lit_through, int(lit_through(scene)))
    if name == "uniform" or not flat.features.many_lights:
        return
    environment = (j for j, light in enumerate(scene.lights) if isinstance(light, EnvironmentLight))
    flat.bind(SceneTable.environment_light, next(environment, 0))
    if name == "power":
        _bind_power(flat, scene)
    elif name == "spatial":
        flat.features = flat.features._replace(light_cells=True)
        bind_light_cells(flat, unlearned_cells(scene))
    else:
        _bind_hierarchy(flat, light_hierarchy(scene))


def _bind_power(flat: FlatScene, scene: Scene) -> None:
    shares = light_shares(scene)
    sums = np.cumsum(shares)
    flat.bind(SceneTable.light_cumulative, sums / sums[-1])
    with np.errstate(divide="ignore"):
        flat.bind(SceneTable.light_inverse_pmf, (1.0 / shares).astype(flat.real))
    flat.features = flat.features._replace(power_lights=True)


def _bind_hierarchy(flat: FlatScene, tree: LightHierarchy) -> None:
    table, parts = SceneTable, tree.unbounded.size + int(tree.child.size > 0)
    if not parts:  # all lights are black
        return
    columns = [*(tree.center - flat.center).transpose(2, 0, 1), tree.radius, *tree.axis.transpose(2, 0, 1)]
    columns += [np.cos(tree.spread), np.sin(tree.spread), np.cos(tree.reach), tree.power]
    flat.bind(table.light_nodes, np.stack(columns, axis=1).reshape(-1).astype(flat.real))
    flat.bind(table.light_children, tree.child.reshape(-1).astype(np.int32))
    flat.bind(table.light_parents, tree.parent.astype(np.int32))
    flat.bind(table.light_places, tree.place.astype(np.int32))
    flat.bind(table.unbounded_lights, tree.unbounded.astype(np.int32))
    flat.bind(table.n_unbounded_lights, tree.unbounded.size)
    flat.bind(table.light_parts, parts)
    flat.bind(table.light_inverse_pmf, np.full(tree.place.size, parts, flat.real))
    flat.features = flat.features._replace(light_hierarchy=True)


def bind_light_cells(flat: FlatScene, cells: LightCells) -> None:
    """Adds the tables of cells, in place of those that are there."""
    table, shape = SceneTable, cells.row.shape[:3]
    flat.bind(table.light_grid, np.array([*(cells.low - flat.center), 1.0 / cells.size, *shape], flat.real))
    flat.bind(table.light_rows, cells.row.reshape(-1))
    flat.bind(table.light_bins, cells.bins.reshape(-1))
    flat.bind(table.n_light_bins, cells.bins.shape[1])
    with np.errstate(divide="ignore"):  # lights without power
        flat.bind(
            table.light_inverse_pmf, (STEPS / cells.bins[0, :, 2]).astype(flat.real)
        )  # an environment's are the same in all rows


__all__ = ["NODE_NUMBERS", "SIDES", "STEPS", "bind_light_cells", "bind_light_sampler"]

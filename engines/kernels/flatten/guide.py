"""An SD-tree in the flattened scene, as stages look it up."""

from __future__ import annotations

import numpy as np

from engines.kernels.flatten.scene import FlatScene
from engines.kernels.layout import SceneTable
from engines.kernels.rows import GuideRow
from engines.sd_tree import SDTree


def bind_guide(flat: FlatScene, tree: SDTree, bsdf_fraction: float) -> None:
    """Puts the tree, as it is now, in the place of the one before."""
    row = GuideRow.packed(corner=tree.corner - flat.center, size=tree.size, bsdf_fraction=bsdf_fraction)
    flat.bind(SceneTable.guide, np.array(row, flat.real))
    flat.bind(SceneTable.guide_root, tree.root)
    flat.bind(SceneTable.guide_halves, tree.halves.reshape(-1))
    flat.bind(SceneTable.guide_quarters, tree.quarters.reshape(-1))
    flat.bind(SceneTable.guide_densities, tree.densities.reshape(-1).astype(flat.real))
    flat.bind(SceneTable.guide_shares, tree.shares.reshape(-1).astype(flat.real))

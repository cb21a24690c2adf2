"""What integrators choose a light by, where they do not choose evenly (docs/transport.md)."""

from __future__ import annotations

import numpy as np

from engines.kernels.flatten.scene import FlatScene
from engines.kernels.layout import SceneTable
from engines.scene import EnvironmentLight, Scene
from engines.scene.light_bounds import light_shares


def bind_light_sampler(flat: FlatScene, scene: Scene, name: str) -> None:
    """Adds the tables of the light sampler `name`, and the feature that compiles it; nothing where there is no choice."""
    if name == "uniform" or not flat.features.many_lights:
        return
    shares = light_shares(scene)
    environment = (j for j, light in enumerate(scene.lights) if isinstance(light, EnvironmentLight))
    flat.bind(SceneTable.environment_light, next(environment, 0))
    sums = np.cumsum(shares)
    flat.bind(SceneTable.light_cumulative, sums / sums[-1])
    with np.errstate(divide="ignore"):
        flat.bind(SceneTable.light_choices, (1.0 / shares).astype(flat.real))
    flat.features = flat.features._replace(power_lights=True)

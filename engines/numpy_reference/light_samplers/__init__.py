"""How a shader chooses one light of many at a vertex."""

from __future__ import annotations

from engines.choices import Choice
from engines.light_cells import unlearned_cells
from engines.numpy_reference.light_samplers.cells import SpatialLightSampler
from engines.numpy_reference.light_samplers.hierarchy import HierarchicalLightSampler
from engines.numpy_reference.light_samplers.plain import ChosenLight, LightSampler, PowerLightSampler, UniformLightSampler
from engines.scene import Scene
from engines.scene.light_bounds import light_shares
from engines.scene.light_hierarchy import light_hierarchy

__all__ = ["ChosenLight", "LightSampler", "SpatialLightSampler", "light_sampler"]


def light_sampler(scene: Scene, shader: Choice, count: int) -> LightSampler:
    """What chooses among the `count` lights of a scene for a shader; evenly where it has no such option."""
    name = "uniform" if shader.plugin is not None else shader.options.get("light_sampler", "uniform")
    if name == "uniform" or count < 2:
        return UniformLightSampler(count)
    if name == "spatial":
        return SpatialLightSampler(unlearned_cells(scene))
    return PowerLightSampler(light_shares(scene)) if name == "power" else HierarchicalLightSampler(light_hierarchy(scene))

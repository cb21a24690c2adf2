"""The kinds of lights, one a module, and the registry through which the rest of the engine knows them."""

from engines.numpy_reference.lights.directional import DirectionalLights
from engines.numpy_reference.lights.environment import EnvironmentLights
from engines.numpy_reference.lights.interface import InfiniteLightSet, LightSample, LightSet
from engines.numpy_reference.lights.plugins import PluginLights
from engines.numpy_reference.lights.point import PointLights
from engines.numpy_reference.lights.spot import SpotLights
from engines.scene import CustomLight, DirectionalLight, EnvironmentLight, PointLight, SpotLight

LIGHTS: dict[type, type[LightSet]] = {
    PointLight: PointLights,
    SpotLight: SpotLights,
    DirectionalLight: DirectionalLights,
    EnvironmentLight: EnvironmentLights,
    CustomLight: PluginLights,
}
"""For each light of the scene model, the class that holds all of its kind. Area lights are shapes: see `AreaLights`."""

__all__ = ["LIGHTS", "InfiniteLightSet", "LightSample", "LightSet"]

"""The kinds of lights, one a module, and the registry through which the rest of the engine knows them."""

from engines.numpy_reference.lights.interface import InfiniteLightSet, LightSample, LightSet
from engines.numpy_reference.registry import collect

LIGHTS: dict[type, type[LightSet]] = collect("LIGHTS", __name__, __path__)
"""For each light of a scene, the class that holds all of its kind; from the tables `LIGHTS` of the modules. Area lights are
shapes: see `AreaLights`."""

__all__ = ["LIGHTS", "InfiniteLightSet", "LightSample", "LightSet"]

"""raybench's engines as a library: load a scene, choose an engine, render, trace."""

from engines.choices import Choice
from engines.errors import ConfigError, RaybenchError, SceneError, UnknownName, Unsupported
from engines.film import Film
from engines.interface import Engine, Hits, Renderer, Settings
from engines.registry import engine, engine_names, from_function
from engines.scene import Scene, load_scene, save_scene, scene_from
from engines.tonemap import register as register_tone_mapper

__all__ = [
    "Choice",
    "ConfigError",
    "Engine",
    "Film",
    "Hits",
    "RaybenchError",
    "Renderer",
    "Scene",
    "SceneError",
    "Settings",
    "UnknownName",
    "Unsupported",
    "engine",
    "engine_names",
    "from_function",
    "load_scene",
    "register_tone_mapper",
    "save_scene",
    "scene_from",
]


def __dir__() -> list[str]:
    return sorted(__all__)

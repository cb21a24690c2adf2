"""Scenes: what they hold (`model`), read from YAML files (`load_scene`) or Python mappings (`scene_from`)."""

from engines.scene.formats.raybench.scene import scene_schema
from engines.scene.load import load_scene, scene_from
from engines.scene.model import (
    BLACK,
    Camera,
    Conductor,
    CustomBSDF,
    CustomCamera,
    CustomLight,
    DirectionalLight,
    Disk,
    EnvironmentLight,
    Light,
    Material,
    Mesh,
    Orthographic,
    Perspective,
    PerspectiveArctan,
    Plane,
    PointLight,
    Scene,
    Shape,
    Sphere,
    SphereSet,
    SpotLight,
    Triangle,
    Triple,
)  # fmt: skip

__all__ = [
    "BLACK", "Camera", "Conductor", "CustomBSDF", "CustomCamera", "CustomLight", "DirectionalLight", "Disk",
    "EnvironmentLight", "Light", "Material", "Mesh", "Orthographic", "Perspective", "PerspectiveArctan", "Plane",
    "PointLight", "Scene", "Shape", "Sphere", "SphereSet", "SpotLight", "Triangle", "Triple", "load_scene",
    "scene_from", "scene_schema",
]  # fmt: skip

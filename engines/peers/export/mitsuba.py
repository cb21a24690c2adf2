"""A scene as Mitsuba's XML, with its meshes and images as files beside it."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from engines.choices import SHADERS
from engines.errors import Unsupported
from engines.peers.adapters.geometry import extent
from engines.peers.export.files import Beside, numbers
from engines.peers.mitsuba.cameras import sensor
from engines.peers.mitsuba.description import described, scene_lacks
from engines.peers.mitsuba.nodes import Placing
from engines.scene import Scene
from engines.scene.leaf_fields import LEAF_PLUGINS

VERSION = "3.0.0"
"""The version of the file format."""
_LEAVES = [name for leaf in LEAF_PLUGINS.values() for name in leaf.plugins]
_TAGS = {
    "sensor": ("perspective", "orthographic", "thinlens"),
    "film": ("hdrfilm",),
    "rfilter": ("box",),
    "integrator": ("path", "volpath"),
    "sampler": ("independent",),
    "texture": ("bitmap", "checkerboard", "mesh_attribute"),
    "bsdf": (*_LEAVES, "twosided", "mask", "blendbsdf", "bumpmap", "normalmap"),
    "shape": ("disk", "sphere", "cylinder", "ply"),
    "medium": ("homogeneous",),
    "phase": ("isotropic", "hg"),
    "emitter": ("area", "point", "spot", "projector", "directional", "constant", "envmap"),
}
_TAG_OF = {kind: tag for tag, kinds in _TAGS.items() for kind in kinds}


def write_mitsuba(scene: Scene, path: Path, max_depth: int = 6, spp: int = 64) -> None:
    """Writes `path` (.xml) and meshes and images into the folder `<name>_files` beside it.

    Raises `Unsupported` for what Mitsuba does not support.
    """
    if reason := scene_lacks(scene):
        raise Unsupported(reason)
    beside = Beside(path)
    nodes = described(scene, Placing(beside.mesh, beside.image)).nodes
    kind = "volpath" if scene.media else "path"
    rr_depth = (scene.shader or {}).get("rr_depth", SHADERS["path_tracer"]["rr_depth"].default)
    nodes["integrator"] = {"type": kind, "max_depth": max_depth, "rr_depth": rr_depth}
    width, height = scene.camera.resolution
    nodes["sensor"] = sensor(scene.camera, width, height, {"type": "independent", "sample_count": spp}, extent(scene))
    root = ElementTree.Element("scene", version=VERSION)
    for name, value in nodes.items():
        if name != "type":
            _write(root, name, value)
    ElementTree.indent(root)
    path.write_text(ElementTree.tostring(root, encoding="unicode") + "\n")


def _write(parent: ElementTree.Element, name: str, value: Any) -> None:
    """An element for a property or an object."""
    if isinstance(value, dict) and value["type"] == "rgb":
        ElementTree.SubElement(parent, "rgb", name=name, value=numbers(value["value"]))
    elif isinstance(value, dict) and value["type"] == "ref":
        ElementTree.SubElement(parent, "ref", name=name, id=value["id"])
    elif isinstance(value, dict):
        named = "name" if parent.tag != "scene" else "id"
        element = ElementTree.SubElement(parent, _TAG_OF[value["type"]], {"type": value["type"], named: name})
        for key, inner in value.items():
            if key != "type":
                _write(element, key, inner)
    elif isinstance(value, np.ndarray):
        element = ElementTree.SubElement(parent, "transform", name=name)
        ElementTree.SubElement(element, "matrix", value=numbers(value.ravel()))
    elif isinstance(value, list):
        tag = "vector" if name == "direction" else "point"
        ElementTree.SubElement(parent, tag, name=name, value=numbers(value))
    else:
        tag = {bool: "boolean", int: "integer", float: "float", str: "string"}[type(value)]
        text = str(value).lower() if isinstance(value, bool) else str(value)
        ElementTree.SubElement(parent, tag, name=name, value=text)

"""Mitsuba's own scene files as they are: film, sampler and integrator are replaced, and nothing else."""

from __future__ import annotations

import re
from typing import Any
from xml.etree import ElementTree

from engines.errors import ConfigError
from engines.mitsuba.library import SCALAR, activate, active
from engines.mitsuba.nodes import Node
from engines.scene import Scene

MOST_SHOWN = 300
"""Characters of a message of Mitsuba's."""
LOADING_THREADS = 2
"""At least: with one, Mitsuba 3.9 waits for ever where it decodes large EXR files."""
_NOISE = re.compile(r"\[\w+(\.\w+:\d+)?\] |(At|While loading) dictionary node \"root\": ")
_FILM = (
    ("string", "pixel_format", "rgb"), ("string", "component_format", "float32"), ("boolean", "sample_border", "false"),
)  # fmt: skip


def load(mi: Any, scene: Scene, size: tuple[int, int], sampler: Node, robust: bool) -> Any:
    """Mitsuba's scene of the file that `scene` came from. Raises RuntimeError where Mitsuba does not load it."""
    held: Any = scene.native

    def sensor(element: ElementTree.Element) -> None:
        film = ElementTree.SubElement(element, "film", type="hdrfilm")
        for name, side in zip(("width", "height"), size, strict=True):
            ElementTree.SubElement(film, "integer", name=name, value=str(side))
        for tag, name, value in _FILM:
            ElementTree.SubElement(film, tag, name=name, value=value)
        ElementTree.SubElement(film, "rfilter", type="box")
        made = ElementTree.SubElement(element, "sampler", type=sampler["type"])
        ElementTree.SubElement(made, "integer", name="sample_count", value=str(sampler["sample_count"]))

    xml = _with_robustness(held.xml(sensor), robust)
    try:
        loaded = mi.load_string(xml)
    except RuntimeError as problem:
        if "Mesh::merge()" not in str(problem):
            raise
        # Mitsuba 3.9 tries to make one mesh of those with one BSDF, and fails where flip_normals differs
        loaded = mi.load_string(xml, optimize=False)
    if not loaded.sensors():
        raise RuntimeError("no sensor")
    return loaded


def _with_robustness(xml: str, robust: bool) -> str:
    root = ElementTree.fromstring(xml)
    name = "embree_use_robust_intersections"
    for given in root.findall(f"boolean[@name='{name}']"):
        root.remove(given)
    ElementTree.SubElement(root, "boolean", name=name, value=str(robust).lower())
    return ElementTree.tostring(root, encoding="unicode")


_answers: dict[str, str | None] = {}


def file_lacks(scene: Scene) -> str | None:
    """Why Mitsuba does not load the file that a scene came from, in its own words, or None. Asked once of each content."""
    digest = scene.native.digest
    if digest not in _answers:
        with active(SCALAR, LOADING_THREADS):
            mi, _ = activate(SCALAR, LOADING_THREADS)
            try:
                load(mi, scene, (16, 16), {"type": "independent", "sample_count": 1}, robust=True)
                _answers[digest] = None
            except Exception as problem:
                _answers[digest] = f"Mitsuba does not load {scene.source}: {one_line(problem)}"
    return _answers[digest]


def integrator_node(options: Any) -> Node:
    """Mitsuba's integrator of a shader `mitsuba`: its options are the plugin's properties."""
    return {key: value for key, value in options.items() if value is not None}


def require_integrator(options: Any) -> bool:
    """Whether such an integrator estimates the radiance along single rays. Raises `ConfigError` in Mitsuba's words where it
    makes none."""
    with active(SCALAR, 1):
        mi, _ = activate(SCALAR, 1)
        try:
            made = mi.load_dict(integrator_node(options))
        except Exception as problem:
            raise ConfigError(f"shader mitsuba: {one_line(problem)}") from problem
        if not isinstance(made, mi.Integrator):
            raise ConfigError(f"shader mitsuba.type = {options['type']!r}: is no integrator of Mitsuba's")
        return isinstance(made, mi.SamplingIntegrator)


def one_line(problem: BaseException) -> str:
    text = " ".join(_NOISE.sub("", str(problem)).split())
    return text if len(text) <= MOST_SHOWN else f"{text[:MOST_SHOWN]}..."

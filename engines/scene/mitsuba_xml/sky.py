"""Sun and sky, baked to an image by Mitsuba in a process of its own."""

from __future__ import annotations

import io
import json
import subprocess
import sys
from importlib import util
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from engines.packages import install_extra
from engines.scene.frames import nearest_orthogonal
from engines.scene.mitsuba_xml.colors import REFLECTANCE, color
from engines.scene.mitsuba_xml.context import Importer
from engines.scene.mitsuba_xml.properties import Plugin
from engines.scene.mitsuba_xml.transforms import similarity

SECONDS = 120.0
NUMBERS = {
    "turbidity": (1.0, 10.0),
    "latitude": (-90.0, 90.0),
    "longitude": (-180.0, 180.0),
    "timezone": (-14.0, 14.0),
    "hour": (0.0, 24.0),
    "minute": (0.0, 60.0),
    "second": (0.0, 60.0),
    "sun_aperture": (0.01, 45.0),
}
WHOLE = {"year": (1, 9999), "month": (1, 12), "day": (1, 31)}
HARMLESS = ("resolution", "extend", "stretch", "sun_radius_scale", "complex_sun")
Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
"""From the axes of Mitsuba 3's sky, z up, to those of 0.x, y up."""


def baked(importer: Importer, plugin: Plugin) -> NDArray[np.float32]:
    """(h, w, 3) the light of `sunsky`, `sky` or `sun`, with rows from pole to pole. Raises `SceneError`."""
    request = _request(plugin)
    if util.find_spec("mitsuba") is None:
        raise plugin.refuse(f"is baked to an image by Mitsuba, which is not installed: {install_extra('mitsuba')}")
    program = [sys.executable, str(Path(__file__).with_name("bake_sky.py"))]
    try:
        done = subprocess.run(program, input=json.dumps(request).encode(), capture_output=True, timeout=SECONDS, check=False)
        image = np.load(io.BytesIO(done.stdout), allow_pickle=False)
    except (OSError, ValueError, EOFError, subprocess.TimeoutExpired) as problem:
        raise plugin.refuse(f"Mitsuba could not bake it: {_reason(problem, locals().get('done'))}") from problem
    old = f", with the model of Mitsuba 3 for {plugin.type} of 0.x" if plugin.element.source.old else ""
    importer.notes.add(f"{plugin.type} is baked to an image of {image.shape[1]} x {image.shape[0]} texels{old}", plugin.element)
    return image


def _reason(problem: Exception, done: Any) -> str:
    lines = done.stderr.decode(errors="replace").strip().splitlines() if done is not None else []
    return (lines[-1] if lines else str(problem))[:200]


def _request(plugin: Plugin) -> dict[str, Any]:
    numbers: dict[str, Any] = {}
    for name, (low, high) in NUMBERS.items():
        if plugin.has(name):
            numbers[name] = plugin.number(name, default=low, low=low, high=high)
    for name, (low, high) in WHOLE.items():
        if plugin.has(name):
            numbers[name] = plugin.integer(name, default=low, low=low, high=high)
    scale = plugin.number("scale", default=1.0, low=0.0)
    for part in ("sun", "sky"):
        own = plugin.number(f"{part}_scale", default=1.0, low=0.0)
        numbers[f"{part}_scale"] = scale * own if plugin.type in (part, "sunsky") else 0.0
    element = plugin.spectrum("albedo")
    if element is not None:
        numbers["albedo"] = {"type": "rgb", "value": list(color(element, REFLECTANCE))}
    linear = plugin.transform()[:3, :3]
    if similarity(linear) is None:
        raise plugin.refuse("to_world of a sky must be a rotation")
    linear = nearest_orthogonal(linear)
    sun = plugin.point("sun_direction")
    old = plugin.element.source.old
    if old:
        linear = linear @ Y_UP
    if sun is not None:
        numbers["sun_direction"] = list(sun)  # in the scene's axes, whatever to_world
        if not any(sun):
            raise plugin.refuse_property("sun_direction", "must not be zero")
    plugin.read.update(HARMLESS)
    to_world = np.eye(4)
    to_world[:3, :3] = linear
    return {"numbers": numbers, "to_world": to_world.tolist()}

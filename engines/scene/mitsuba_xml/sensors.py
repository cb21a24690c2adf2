"""Sensors and their films: cameras of the scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from engines.scene.cameras import LARGEST_SIDE, Camera, Orthographic, Perspective, ThinLens
from engines.scene.mitsuba_xml.context import Importer
from engines.scene.mitsuba_xml.media import medium_around
from engines.scene.mitsuba_xml.properties import Plugin
from engines.scene.mitsuba_xml.transforms import RIGID, Matrix, similarity
from engines.scene.triple import triple

NEAR, FAR = 1e-2, 1e4
"""Clipping planes of Mitsuba's cameras where a file gives none."""
DEFAULT_SIZE = (768, 576)
"""Of a film that does not say."""
DIAGONAL = math.hypot(36.0, 24.0)
"""Of 35 mm film, in millimetres: what focal lengths refer to."""
AXES = ("x", "y", "smaller", "larger", "diagonal")
HARMLESS_SENSOR = ("shutter_open", "shutter_close", "focus_distance", "srf", "apply_motion")
HARMLESS_FILM = (
    "filename",
    "file_format",
    "pixel_format",
    "component_format",
    "gamma",
    "banner",
    "high_quality_edges",
    "sample_border",
    "exposure",
    "key",
    "burn",
    "tonemap_method",
    "label",
    "attach_log",
    "compensate",
    "digits",
    "variable",
)


def camera(importer: Importer, plugin: Plugin) -> Camera:
    """The camera of a sensor. Raises `SceneError`."""
    make = SENSORS.get(plugin.type)
    if make is None:
        raise plugin.refuse(REFUSED.get(plugin.type, f"unknown sensor: known: {', '.join(SENSORS)}"))
    for sampler in importer.taken(plugin, "sampler"):
        importer.notes.drop(f"sampler {sampler.type}")
    size = _film(importer, plugin)
    made = replace(make(importer, plugin, size), **medium_around(importer, plugin))
    plugin.read.update(HARMLESS_SENSOR)
    importer.finish(plugin)
    return made


def _film(importer: Importer, plugin: Plugin) -> tuple[int, int]:
    films = importer.taken(plugin, "film")
    if not films:
        return DEFAULT_SIZE
    film = films[0]
    if film.type == "specfilm":
        raise film.refuse("spectral films are not supported")
    size = film_size(film)
    for rfilter in importer.taken(film, "rfilter"):
        importer.notes.drop(f"filter {rfilter.type}")
    importer.notes.drop(f"film {film.type} but its size")
    film.read.update(HARMLESS_FILM)
    importer.finish(film)
    return size


def film_size(film: Plugin) -> tuple[int, int]:
    """Width and height in pixels. Raises `SceneError`, for a film that is cropped, too."""
    sides = (("width", DEFAULT_SIZE[0]), ("height", DEFAULT_SIZE[1]))
    width, height = (film.integer(name, default=side, low=1, high=LARGEST_SIDE) for name, side in sides)
    for name, whole in (("offset_x", 0), ("offset_y", 0), ("width", width), ("height", height)):
        if film.integer(f"crop_{name}", default=whole, low=0, high=LARGEST_SIDE) != whole:
            raise film.refuse("a crop of the film is not supported: leave crop_ out")
    return width, height


# ---- frames ----------------------------------------------------------------------------------------------------------


def _frame(matrix: Matrix) -> dict[str, Any]:
    """eye, target, up and mirror of a camera-to-world matrix: +z forward, +y up, +x to the left."""
    left, up, forward, eye = (matrix[:3, column] for column in range(4))
    reach = float(np.linalg.norm(forward))
    # a target as far away as the eye is from the origin: the direction keeps its digits
    target = eye + forward / reach * max(1.0, float(np.abs(eye).max()))
    mirror = bool(np.dot(np.cross(up, forward), left) < 0.0)
    return {"eye": triple(eye), "target": triple(target), "up": triple(up / np.linalg.norm(up)), "mirror": mirror}


def _clip(plugin: Plugin) -> tuple[float, float]:
    near, far = (plugin.positive(name, default=default) for name, default in (("near_clip", NEAR), ("far_clip", FAR)))
    if near >= far:
        raise plugin.refuse_property("near_clip", f"must be less than far_clip, which is {far:g}")
    return near, far


def _principal_point(plugin: Plugin) -> tuple[float, float]:
    """Mitsuba shifts the film against the axis, we the axis on the film."""
    x, y = (plugin.number(f"principal_point_offset_{axis}", default=0.0) for axis in "xy")
    return 0.0 - x, 0.0 - y


def _field_of_view(plugin: Plugin, size: tuple[int, int]) -> tuple[float, str]:
    """Degrees, and the axis of the film along which they are."""
    axis = plugin.text("fov_axis", default="x", known=AXES) or "x"
    if plugin.has("fov"):
        if plugin.has("focal_length"):
            raise plugin.refuse("either fov or focal_length")
        fov = plugin.number("fov", default=0.0)
        if not 0.0 < fov < 180.0:
            raise plugin.refuse_property("fov", "must lie in (0, 180) degrees")
    else:
        fov, axis = 2.0 * math.degrees(math.atan(DIAGONAL / 2.0 / _focal_length(plugin))), "diagonal"
    width, height = size
    if axis == "diagonal":
        half = math.tan(math.radians(fov) / 2.0) * width / math.hypot(width, height)
        return 2.0 * math.degrees(math.atan(half)), "x"
    if axis in ("smaller", "larger"):
        axis = "y" if (width > height) == (axis == "smaller") else "x"
    return fov, axis


def _focal_length(plugin: Plugin) -> float:
    """Millimetres."""
    text = (plugin.text("focal_length", default="50mm") or "").removesuffix("mm").strip()
    try:
        millimetres = float(text)
    except ValueError:
        millimetres = -1.0
    if not 1e-3 <= millimetres <= 1e6:
        raise plugin.refuse_property("focal_length", "must be millimetres, such as 50mm")
    return millimetres


# ---- sensors ---------------------------------------------------------------------------------------------------------


def _rigid(plugin: Plugin) -> dict[str, Any]:
    matrix = plugin.transform()
    scale = similarity(matrix[:3, :3])
    if scale is None:
        raise plugin.refuse("to_world of this sensor must not stretch or shear")
    if not plugin.element.source.old and abs(scale - 1.0) > 1e-3:
        raise plugin.refuse("to_world of this sensor must not scale")
    return _frame(matrix)


def _lens(plugin: Plugin, size: tuple[int, int]) -> dict[str, Any]:
    fov, axis = _field_of_view(plugin, size)
    shared = {"fov": fov, "fov_axis": axis, "resolution": size, "clip": _clip(plugin)}
    return {**_rigid(plugin), **shared, "principal_point": _principal_point(plugin)}


def _perspective(importer: Importer, plugin: Plugin, size: tuple[int, int]) -> Camera:
    return Perspective(**_lens(plugin, size))


def _thin_lens(importer: Importer, plugin: Plugin, size: tuple[int, int]) -> Camera:
    for name in ("aperture_radius", "focus_distance"):
        if not plugin.has(name):
            raise plugin.refuse(f"the property '{name}' is missing")
    radius = plugin.number("aperture_radius", default=0.0, low=0.0)
    lens, focus = _lens(plugin, size), plugin.positive("focus_distance", default=1.0)
    if radius == 0.0:
        return Perspective(**lens)
    return ThinLens(**lens, aperture_radius=radius, focus_distance=focus)


def _orthographic(importer: Importer, plugin: Plugin, size: tuple[int, int]) -> Camera:
    """The window is two wide, and its pixels are square, before `to_world`, whose scale along x and y it takes. The scale along
    z moves the near plane; between the planes lie `far_clip` - `near_clip` metres, whatever the scale."""
    matrix = plugin.transform()
    x, y, z = (float(length) for length in np.linalg.norm(matrix[:3, :3], axis=0))
    if min(x, y, z) <= 0.0 or similarity(matrix[:3, :3] / [x, y, z]) is None:
        raise plugin.refuse("to_world of a sensor must not shear, or flatten")
    near, far = _clip(plugin)
    height = None if abs(x / y - 1.0) <= RIGID else 2.0 * y * size[1] / size[0]
    return Orthographic(**_frame(matrix), height=height, resolution=size, clip=(near * z, near * z + far - near), width=2.0 * x)


SENSORS: dict[str, Callable[[Importer, Plugin, tuple[int, int]], Camera]] = {
    "perspective": _perspective,
    "thinlens": _thin_lens,
    "orthographic": _orthographic,
}
REFUSED = {
    "batch": "several cameras in one are not supported",
    "distant": "is not supported: use orthographic",
    "irradiancemeter": "measures no image",
    "radiancemeter": "measures no image",
    "fluencemeter": "measures no image",
    "perspective_rdist": "distorted lenses are not supported: use perspective",
    "spherical": "is not supported: use perspective",
    "telecentric": "is not supported: use orthographic",
}

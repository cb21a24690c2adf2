"""Sensors and their films: cameras of the scene."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from engines.scene.cameras import LARGEST_SIDE, MOST_SHIFT, Camera, Orthographic, Perspective, ThinLens
from engines.scene.frames import Matrix
from engines.scene.mitsuba_xml.context import Importer
from engines.scene.mitsuba_xml.media import medium_around
from engines.scene.mitsuba_xml.properties import Plugin
from engines.scene.mitsuba_xml.transforms import RIGID, similarity
from engines.scene.triple import triple

NEAR, FAR = 1e-2, 1e4
"""Clipping planes of Mitsuba's cameras where a file gives none."""
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


class Film(NamedTuple):
    """The pixels of a whole film, and those of them that are rendered: the crop, with its upper left corner."""

    width: int = 768
    height: int = 576
    crop_offset_x: int = 0
    crop_offset_y: int = 0
    crop_width: int = width
    crop_height: int = height

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of the image in pixels."""
        return self.crop_width, self.crop_height

    @property
    def is_whole(self) -> bool:
        """Whether the crop is the whole film."""
        return self.size == (self.width, self.height)


def camera(importer: Importer, plugin: Plugin) -> Camera:
    """The camera of a sensor. Raises `SceneError`."""
    make = SENSORS.get(plugin.type)
    if make is None:
        raise plugin.refuse(REFUSED.get(plugin.type, f"unknown sensor: known: {', '.join(SENSORS)}"))
    for sampler in importer.taken(plugin, "sampler"):
        importer.notes.drop(f"sampler {sampler.type}")
    film = _film(importer, plugin)
    made = replace(make(importer, plugin, film), **medium_around(importer, plugin))
    plugin.read.update(HARMLESS_SENSOR)
    importer.finish(plugin)
    return made


def _film(importer: Importer, plugin: Plugin) -> Film:
    films = importer.taken(plugin, "film")
    if not films:
        return Film()
    if films[0].type == "specfilm":
        raise films[0].refuse("spectral films are not supported: use hdrfilm")
    film = film_of(films[0])
    for rfilter in importer.taken(films[0], "rfilter"):
        importer.notes.drop(f"filter {rfilter.type}")
    importer.notes.drop(f"film {films[0].type} but its size")
    films[0].read.update(HARMLESS_FILM)
    importer.finish(films[0])
    return film


def film_of(plugin: Plugin) -> Film:
    """The film of a plugin. Raises `SceneError`, for a crop that does not lie within it, too."""
    whole = [plugin.integer(name, default=Film._field_defaults[name], low=1, high=LARGEST_SIDE) for name in ("width", "height")]
    starts, sides = [], []
    for axis, side, most in zip("xy", ("width", "height"), whole, strict=True):
        starts.append(plugin.integer(f"crop_offset_{axis}", default=0, low=0, high=most - 1))
        sides.append(plugin.integer(f"crop_{side}", default=most, low=1, high=most))
        if starts[-1] + sides[-1] > most:
            raise plugin.refuse(f"crop_offset_{axis} + crop_{side} = {starts[-1] + sides[-1]}: must be at most {side}, {most}")
    return Film(*whole, *starts, *sides)


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


def _middle(film: Film, x: float = 0.0, y: float = 0.0) -> tuple[float, float]:
    """Where the axis of view meets the crop, from its middle in shares of its sides; (x, y) is the same of the whole film."""
    width, height = film.size
    across = x * (film.width / width) + ((film.width - width) / 2.0 - film.crop_offset_x) / width
    down = y * (film.height / height) + ((film.height - height) / 2.0 - film.crop_offset_y) / height
    return across, down


def _principal_point(plugin: Plugin, film: Film) -> tuple[float, float]:
    """Mitsuba shifts the film against the axis, we the axis on the film."""
    x, y = (plugin.number(f"principal_point_offset_{axis}", default=0.0) for axis in "xy")
    middle = _middle(film, -x, -y)
    if max(map(abs, middle)) > MOST_SHIFT:
        raise plugin.refuse(f"the axis of view misses the image by more than {MOST_SHIFT:,.0f} of its sides")
    return middle


def field_of_view(plugin: Plugin, film: Film) -> tuple[float, str]:
    """Degrees that the crop takes of those of the whole film, and the axis along which they are."""
    axis = plugin.text("fov_axis", default="x", known=AXES) or "x"
    if plugin.has("fov"):
        if plugin.has("focal_length"):
            raise plugin.refuse("either fov or focal_length")
        fov = plugin.number("fov", default=0.0)
        if not 0.0 < fov < 180.0:
            raise plugin.refuse_property("fov", "must lie in (0, 180) degrees")
    else:
        fov, axis = 2.0 * math.degrees(math.atan(DIAGONAL / 2.0 / _focal_length(plugin))), "diagonal"
    width, height, share = film.width, film.height, 1.0
    if axis == "diagonal":
        axis, share = "x", width / math.hypot(width, height)
    if axis in ("smaller", "larger"):
        axis = "y" if (width > height) == (axis == "smaller") else "x"
    share *= film.crop_width / width if axis == "x" else film.crop_height / height
    if share == 1.0:
        return fov, axis
    return 2.0 * math.degrees(math.atan(math.tan(math.radians(fov) / 2.0) * share)), axis


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


def _lens(plugin: Plugin, film: Film) -> dict[str, Any]:
    fov, axis = field_of_view(plugin, film)
    shared = {"fov": fov, "fov_axis": axis, "resolution": film.size, "clip": _clip(plugin)}
    return {**_rigid(plugin), **shared, "principal_point": _principal_point(plugin, film)}


def _perspective(importer: Importer, plugin: Plugin, film: Film) -> Camera:
    return Perspective(**_lens(plugin, film))


def _thin_lens(importer: Importer, plugin: Plugin, film: Film) -> Camera:
    for name in ("aperture_radius", "focus_distance"):
        if not plugin.has(name):
            raise plugin.refuse(f"the property '{name}' is missing")
    radius = plugin.number("aperture_radius", default=0.0, low=0.0)
    lens, focus = _lens(plugin, film), plugin.positive("focus_distance", default=1.0)
    if radius == 0.0:
        return Perspective(**lens)
    return ThinLens(**lens, aperture_radius=radius, focus_distance=focus)


def _orthographic(importer: Importer, plugin: Plugin, film: Film) -> Camera:
    """The window is two wide, and its pixels are square, before `to_world`, whose scale along x and y it takes. The scale along
    z moves the near plane; between the planes lie `far_clip` - `near_clip` metres, whatever the scale."""
    matrix = plugin.transform()
    x, y, z = (float(length) for length in np.linalg.norm(matrix[:3, :3], axis=0))
    if min(x, y, z) <= 0.0 or similarity(matrix[:3, :3] / [x, y, z]) is None:
        raise plugin.refuse("to_world of a sensor must not shear, or flatten")
    near, far = _clip(plugin)
    width, height = (2.0 * side * crop / film.width for side, crop in zip((x, y), film.size, strict=True))
    return Orthographic(
        **_frame(matrix),
        height=None if abs(x / y - 1.0) <= RIGID else height,
        resolution=film.size,
        principal_point=_middle(film),
        clip=(near * z, near * z + far - near),
        width=width,
    )


SENSORS: dict[str, Callable[[Importer, Plugin, Film], Camera]] = {
    "perspective": _perspective,
    "thinlens": _thin_lens,
    "orthographic": _orthographic,
}
REFUSED = {
    "batch": "several cameras in one are not supported: put one of its sensors in its place",
    "distant": "is not supported: use orthographic",
    "irradiancemeter": "measures no image: use perspective or orthographic",
    "radiancemeter": "measures no image: use perspective or orthographic",
    "fluencemeter": "measures no image: use perspective or orthographic",
    "perspective_rdist": "distorted lenses are not supported: use perspective",
    "spherical": "is not supported: use perspective",
    "telecentric": "is not supported: use orthographic",
}

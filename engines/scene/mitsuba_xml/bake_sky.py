"""A program of its own: reads parameters of Mitsuba's `sunsky` as JSON, writes its light as an array (h, w, 3) float32.

It runs apart from whoever imports a scene, as the variant of Mitsuba that is in use belongs to a whole process. The image is
latitude-longitude, +y up, its first and last row on the poles, as `EnvironmentLight` has it with `rows` "poles".
"""

import io
import json
import math
import sys
from typing import Any

import mitsuba
import numpy as np

SKY = (512, 257)
"""Columns and rows at which the sky is evaluated."""
FINE = 4
"""By how much columns and rows are finer in an image with a sun: a texel is 0.18 degrees wide, the sun 0.53."""
SUN_APERTURE = 0.5358
"""Degrees; Mitsuba's default."""
SUN_SAMPLES = 96
"""Across the sun's disk."""


def directions(u: Any, v: Any) -> Any:
    """(..., 3) unit directions of texture coordinates, u around +y and v from +y to -y, both in [0, 1]."""
    phi, theta = 2.0 * math.pi * u, math.pi * v
    return np.stack([np.sin(theta) * np.sin(phi), np.cos(theta), -np.sin(theta) * np.cos(phi)], axis=-1)


def radiance(emitter: Any, rows: Any) -> Any:
    """(n, 3) for directions (n, 3)."""
    interaction: Any = mitsuba.SurfaceInteraction3f()
    found = np.empty((len(rows), 3))
    for index, row in enumerate(rows.tolist()):
        interaction.wi = [-row[0], -row[1], -row[2]]
        value = emitter.eval(interaction)
        found[index] = value[0], value[1], value[2]
    return np.maximum(found, 0.0)


def sky(parameters: dict[str, Any]) -> Any:
    """(h, w, 3) radiance of a `sunsky` without its sun, of the size `SKY`."""
    width, height = SKY
    u, v = np.meshgrid((np.arange(width) + 0.5) / width, np.arange(height) / (height - 1))
    emitter = mitsuba.load_dict({**parameters, "sun_scale": 0.0})
    return radiance(emitter, directions(u, v).reshape(-1, 3)).reshape(height, width, 3)


def finer(image: Any) -> Any:
    """The same function of direction on a grid of `FINE` times the columns and rows."""
    height, width = image.shape[:2]
    x = (np.arange(FINE * width) + 0.5) / FINE - 0.5
    left = np.floor(x).astype(int)
    share = (x - left)[None, :, None]
    image = image[:, left % width] * (1.0 - share) + image[:, (left + 1) % width] * share
    y = np.arange(FINE * (height - 1) + 1) / FINE
    top = np.minimum(y.astype(int), height - 2)
    share = (y - top)[:, None, None]
    return image[top] * (1.0 - share) + image[top + 1] * share


def add_sun(image: Any, emitter: Any, towards: Any, aperture: float) -> None:
    """Adds the sun's energy to the texels around it, each sample to its four nearest."""
    half = math.tan(math.radians(aperture / 2.0))
    grid = ((np.arange(SUN_SAMPLES) + 0.5) / SUN_SAMPLES * 2.0 - 1.0) * half
    a, b = (axis.reshape(-1, 1) for axis in np.meshgrid(grid, grid))
    helper = np.eye(3)[np.argmin(np.abs(towards))]
    s = np.cross(helper, towards)
    s /= np.linalg.norm(s)
    rows = towards + a * s + b * np.cross(towards, s)
    length = np.linalg.norm(rows, axis=1, keepdims=True)
    rows /= length
    energy = radiance(emitter, rows) * (2.0 * half / SUN_SAMPLES) ** 2 / length**3
    energy[rows @ towards < math.cos(math.radians(aperture / 2.0))] = 0.0
    height, width = image.shape[:2]
    x = (np.arctan2(rows[:, 0], -rows[:, 2]) / (2.0 * math.pi) % 1.0) * width - 0.5
    y = np.arccos(np.clip(rows[:, 1], -1.0, 1.0)) / math.pi * (height - 1)
    left, top = np.floor(x).astype(int), np.minimum(y.astype(int), height - 2)
    fx, fy = (x - left)[:, None], (y - top)[:, None]
    step = math.pi / (height - 1)
    theta = step * np.arange(height)
    # the integral of the function that is 1 at a row and falls to 0 at the next
    area = 2.0 * math.pi / width * 2.0 * np.sin(theta) * (1.0 - math.cos(step)) / step
    area[[0, -1]] = 2.0 * math.pi / width * (1.0 - math.sin(step) / step)
    for columns, wx in ((left % width, 1.0 - fx), ((left + 1) % width, fx)):
        for lines, wy in ((top, 1.0 - fy), (top + 1, fy)):
            np.add.at(image, (lines, columns), energy * wx * wy / area[lines][:, None])


def main() -> None:
    """Reads parameters from the standard input, and writes the image to the standard output."""
    mitsuba.set_variant("scalar_rgb")
    mitsuba.set_log_level(mitsuba.LogLevel.Error)
    given = json.load(sys.stdin)
    parameters = {"type": "sunsky", **given["numbers"]}
    if "sun_direction" in parameters:
        parameters["sun_direction"] = mitsuba.ScalarVector3f(parameters["sun_direction"])
    matrix = np.array(given["to_world"])
    parameters["to_world"] = mitsuba.ScalarTransform4f(matrix)
    image = sky(parameters)
    if parameters["sun_scale"] > 0.0:
        sun = mitsuba.load_dict({**parameters, "sky_scale": 0.0})
        local = np.array(mitsuba.traverse(sun)["sun_direction"], np.float64).reshape(3)
        towards = [rotation @ local / np.linalg.norm(local) for rotation in (matrix[:3, :3], np.eye(3))]
        brightest = max(towards, key=lambda one: float(radiance(sun, one[None]).sum()))
        image = finer(image)
        add_sun(image, sun, brightest, parameters.get("sun_aperture", SUN_APERTURE))
    written = io.BytesIO()
    np.save(written, image.astype(np.float32))
    sys.stdout.buffer.write(written.getbuffer())  # np.save asks a file for its position, which a pipe may refuse


if __name__ == "__main__":
    main()

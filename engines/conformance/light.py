"""Claims about images whose every pixel is known without rendering."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from engines.conformance.stage import inward_box, plane, rectangle, scene, sphere
from engines.conformance.subject import Declined, Subject, expect
from engines.interface import Renderer
from engines.scene import Scene

EMISSION_ALONE = tuple({"name": "path_tracer", "max_depth": depth} for depth in (1, 2))
"""Of a scene where nothing reflects: not every renderer has paths of one segment."""
STANDARD_ERRORS = 5.0
"""A mean this far from the truth happens by chance once in 1.7 million."""


def _first(subject: Subject, held: Scene, shaders: tuple[Any, ...], **changes: Any) -> list[Renderer]:
    """Renderers of `held`, one for each shader that the engine accepts: the first alone when quick."""
    renderers, reasons = [], []
    for shader in shaders:
        try:
            renderers.append(subject.renderer(held, shader=shader, **changes))
        except Declined as declined:
            reasons.append(declined)
        if renderers and subject.quick:
            break
    if not renderers:
        raise reasons[0]
    return renderers


def the_furnace_is_uniform(subject: Subject) -> None:
    """In a closed box that emits 1/2 and reflects 1/2, paths of four segments carry 15/16, within the noise."""
    shader, truth = {"name": "path_tracer", "max_depth": 4}, 15 / 16
    held = scene([inward_box("furnace")], eye=[0, 0, 0.5], target=[0.1, 0.2, -1])
    (renderer,) = _first(subject, held, (shader,))
    # In four calls, for of some engines variance is known between calls alone.
    film = [renderer.render(16 if subject.quick else 64) for _ in range(4)][-1]
    image, count = film.mean(), film.width * film.height
    # Channels are alike and share their samples: the mean of their variances is that of the grey image.
    error = math.sqrt(float(film.variance_of_mean().mean()) / count)
    off = float(image.mean()) - truth
    expect(error < 0.01, f"the noise of the mean is {error:.4f}: too much to say anything")
    expect(abs(off) < STANDARD_ERRORS * error + 1e-5, f"the mean is {truth + off:.5f} +- {error:.5f}, expected {truth}")


def _lit_floor(*shapes: dict[str, Any]) -> Scene:
    """A floor of albedo 1/2 with a point light of 10 W/sr two metres above its middle, seen in that point."""
    floor = plane((0, 0, 0), (0, 1, 0), "half")
    light = {"point": {"position": [0, 2, 0], "intensity": 10}}
    return scene([floor, *shapes], [light], eye=[3, 3, 0], target=[0, 0, 0], fov=0.01)


DIRECT = ({"name": "path_tracer", "max_depth": 2}, {"name": "whitted", "ambient": 0.0}, {"name": "no_shadows", "ambient": 0.0})


def a_point_light_falls_off_with_the_square(subject: Subject) -> None:
    """Under a point light a diffuse floor has radiance kd/pi I/d2."""
    truth = 0.5 / math.pi * 10 / 2**2
    for renderer in _first(subject, _lit_floor(), DIRECT, width=2, height=2):
        image = renderer.render(2).mean()
        expect(np.allclose(image, truth, rtol=1e-4), f"radiance {image.min():.6g} to {image.max():.6g}, expected {truth:.6g}")


def what_is_in_shadow_is_black(subject: Subject) -> None:
    """Direct light does not pass through what stands between."""
    blocker = {"mesh": {"vertices": [[-1, 1, -1], [1, 1, -1], [0, 1, 1]], "faces": [[0, 1, 2]]}, "material": "half"}
    for renderer in _first(subject, _lit_floor(blocker), DIRECT[:2], width=2, height=2):
        image = renderer.render(2).mean()
        expect(image.max() == 0, f"radiance {image.max():.6g} in the shadow")


def images_are_upright(subject: Subject) -> None:
    """Row 0 is the top, column 0 the left of the camera's view, and colours keep their channels."""
    colours = {(-9, 1): "red", (0, 1): "green", (-9, 0): "blue", (0, 0): "grey"}
    quarters = [rectangle((x, x + 9), (9 * y - 8, 9 * y + 1), 0, name) for (x, y), name in colours.items()]
    shaders = (*EMISSION_ALONE, "whitted", "no_shadows", "albedo")
    for renderer in _first(subject, scene(quarters), shaders, width=16, height=12):
        image = renderer.render(1).mean()
        for rows, columns, name, colour in (
            (slice(0, 5), slice(0, 7), "upper left", (1, 0, 0)),
            (slice(0, 5), slice(9, 16), "upper right", (0, 1, 0)),
            (slice(7, 12), slice(0, 7), "lower left", (0, 0, 1)),
            (slice(7, 12), slice(9, 16), "lower right", (0.5, 0.5, 0.5)),
        ):
            seen = image[rows, columns].mean(axis=(0, 1))
            expect(np.allclose(seen, colour, atol=1e-6), f"the {name} quarter shows {seen}, in the scene it is {colour}")


def _arctan(x: float) -> float:
    """The map of `PerspectiveArctan`, for |x| <= 1."""
    return math.copysign(math.pi / 4 * abs(x) + abs(x) * (1 - abs(x)) * (0.2447 + 0.0663 * abs(x)), x)


def _lamp_behind(row: int, column: int, place: Callable[[float], float]) -> dict[str, Any]:
    """A lamp in the plane z = 0 that fills all but the rim of a pixel of 16 x 12; `place` maps shares of the half height."""
    x0, x1 = (place((2 * (column + i) / 16 - 1) * 16 / 12) for i in (0.02, 0.98))
    y0, y1 = (place(1 - 2 * (row + i) / 12) for i in (0.98, 0.02))
    return rectangle((x0, x1), (y0, y1), 0, "grey")


def cameras_show_what_lies_along_their_rays(subject: Subject) -> None:
    """A pixel of every kind of camera shows what its formula says lies behind it, and its neighbours do not."""
    half = math.radians(40)
    kinds: dict[str, tuple[dict[str, Any], Callable[[float], float]]] = {
        "perspective": ({"fov": 80}, lambda share: 4 * math.tan(half) * share),
        "perspective_arctan": ({"fov": 80}, lambda share: 4 * _arctan(half * share)),
        "orthographic": ({"height": 3}, lambda share: 1.5 * share),
    }
    declined = []
    for kind, (opening, place) in kinds.items():
        held = scene([_lamp_behind(2, 3, place)], type=kind, eye=[0, 0, 4], target=[0, 0, 0], **opening)
        try:
            renderers = _first(subject, held, (*EMISSION_ALONE, "whitted"))
        except Declined as reason:
            declined.append(reason)
            continue
        for renderer in renderers:
            image = renderer.render(8).mean()
            expect(image[2, 3].min() > 0.25, f"{kind}: the pixel shows {image[2, 3]}, a lamp of 0.5 is there")
            image[2, 3] = 0
            expect(image.max() == 0, f"{kind}: a pixel beside the lamp shows {image.max():.4g}")
    if len(declined) == len(kinds):
        raise declined[0]


def lossless_glass_is_invisible_in_a_furnace(subject: Subject) -> None:
    """A ball of lossless glass in a uniform environment of radiance 1 shows 1 in every pixel."""
    held = scene([sphere((0, 1, 0), 1.5, "glass")], [{"environment": {"radiance": 1}}])
    shader = {"name": "path_tracer", "max_depth": 1000, "rr_depth": 1000}
    (renderer,) = _first(subject, held, (shader,))
    image = renderer.render(2).mean()
    expect(np.allclose(image, 1, atol=1e-3), f"radiance runs from {image.min():.5g} to {image.max():.5g}")


CLAIMS = (
    the_furnace_is_uniform,
    a_point_light_falls_off_with_the_square,
    what_is_in_shadow_is_black,
    images_are_upright,
    cameras_show_what_lies_along_their_rays,
    lossless_glass_is_invisible_in_a_furnace,
)

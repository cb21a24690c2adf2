"""The engine under test in one precision and with one accelerator: how cases get hits and images from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engines.choices import UNBIASED, own_samplers, shaders_and_samplers
from engines.errors import RaybenchError
from engines.interface import Engine, Hits, Renderer, Settings
from engines.scene import HomogeneousMedium, Light, Material, Scene, Shape
from harness.verify.scenes import FRONT_CAMERA, UNIT_TRIANGLE, sphere
from harness.verify.scenes import scene as scene_of
from harness.verify.tolerances import tracing_precision

Array = NDArray[np.float64]
T = TypeVar("T")


class Skipped(Exception):
    """The engine lacks what a case needs; the message is the answer of `why_not`."""


@dataclass(frozen=True)
class Subject:
    """`precision` is the setting; `tracing` the precision in which the engine intersects; `dtype` its scalar type."""

    engine: Engine
    precision: str
    accelerator: str = "auto"
    quick: bool = True

    @property
    def tracing(self) -> str:
        return tracing_precision(self.engine, self.precision)

    @property
    def dtype(self) -> Any:
        return np.dtype(self.tracing).type

    @property
    def eps(self) -> float:
        return float(np.finfo(self.dtype).eps)

    def count(self, many: int) -> int:
        """The number of rays or trials: a quarter of `many` in a quick run."""
        return max(many // 4, 1) if self.quick else many

    def subset(self, values: Sequence[T], quick: int) -> Sequence[T]:
        """All parameters of a case, or the first `quick` of them in a quick run."""
        return values[:quick] if self.quick else values

    def cast(self, values: ArrayLike) -> Array:
        """The values rounded to the tracing precision, so that this rounding is no error of the engine."""
        with np.errstate(over="ignore"):
            return np.asarray(values, np.float64).astype(self.dtype).astype(np.float64)

    def cast_point(self, values: ArrayLike) -> tuple[float, float, float]:
        """A point or direction of three floats, rounded likewise."""
        x, y, z = self.cast(values)
        return float(x), float(y), float(z)

    def renderer(self, scene: Scene, **settings: Any) -> Renderer:
        """A renderer; without a sampler in `settings`, with the first unbiased sampler of the engine.

        Raises `Skipped` where `why_not` refuses the scene.
        """
        samplers = [settings["sampler"]] if "sampler" in settings else [*UNBIASED, *own_samplers(self.engine)]
        return self._first(scene, [{**settings, "sampler": sampler} for sampler in samplers])

    def tracer(self, *shapes: Shape, **settings: Any) -> Renderer:
        """A renderer for single rays of shapes of material 0, with any shader and sampler that the engine has."""
        choices = [{**choice, **settings} for choice in shaders_and_samplers(self.engine)]
        return self._first(scene_of(shapes, camera=FRONT_CAMERA), choices)

    def _first(self, scene: Scene, choices: Sequence[dict[str, Any]]) -> Renderer:
        """A renderer with the first of these settings that the engine accepts. Raises `Skipped` where it accepts none."""
        reasons = []
        for choice in choices:
            settings = Settings(**{"precision": self.precision, "accelerator": self.accelerator, **choice})
            reason = refusal(self.engine, scene, settings)
            if reason is None:
                return self.engine.prepare(scene, settings)
            reasons.append(reason)
        raise Skipped(reasons[0])

    def accepted(self, samplers: Sequence[Any], scene: Scene, shader: Any) -> list[Any]:
        """Those of these samplers that the engine has. Raises `Skipped` where it has none."""
        base = {"precision": self.precision, "accelerator": self.accelerator, "shader": shader}
        reasons = [refusal(self.engine, scene, Settings(sampler=sampler, **base)) for sampler in samplers]
        if None not in reasons:
            raise Skipped(reasons[0] or "")
        return [sampler for sampler, reason in zip(samplers, reasons, strict=True) if reason is None]

    def trace(self, shapes: Sequence[Shape], origins: ArrayLike, directions: ArrayLike, t_max: Any = np.inf) -> Hits:
        return self.tracer(*shapes).trace(origins, directions, t_max)

    def image(
        self,
        shapes: Sequence[Shape],
        materials: Sequence[Material],
        lights: Sequence[Light],
        camera: Any,
        shader: Any,
        spp: int = 1,
        media: Sequence[HomogeneousMedium] = (),
        **settings: Any,
    ) -> Array:
        """(height, width) red channel of the mean; infinite everywhere where the film holds a bad sample."""
        film = self.renderer(scene_of(shapes, materials, lights, camera, media), shader=shader, **settings).render(spp)
        seen = film.mean()[:, :, 0]
        return np.full_like(seen, np.inf) if film.bad_samples else seen

    def radiance(
        self, shapes: Sequence[Shape], materials: Sequence[Material], lights: Sequence[Light], view: Any, shader: Any
    ) -> float:
        """The red channel of the first pixel of an image, by one ray through its centre."""
        return float(self.image(shapes, materials, lights, view, shader, sampler="constant")[0, 0])


def accelerator_names(engine: Engine) -> list[str]:
    """The names of the accelerators without `auto`; `auto` where there is no other."""
    return [name for name in engine.accelerators() if name != "auto"] or ["auto"]


def refusal(engine: Engine, scene: Scene, settings: Settings) -> str | None:
    """The answer of `why_not`; a name that the engine does not know is a refusal, too."""
    try:
        return engine.why_not(scene, settings)
    except RaybenchError as error:
        return str(error)


def precisions(engine: Engine) -> list[str]:
    """The precisions that the engine has, float64 first. Raises `Skipped` where it renders nothing at all.

    A precision counts where `why_not` accepts an empty scene, one triangle or one sphere with any shader and sampler.
    """
    scenes = [scene_of(shapes, camera=FRONT_CAMERA) for shapes in ([], [UNIT_TRIANGLE], [sphere()])]
    accepted, reason = [], ""
    for name in ("float64", "float32"):
        for scene, choice in product(scenes, shaders_and_samplers(engine)):
            answer = refusal(engine, scene, Settings(precision=name, **choice))
            if answer is None:
                accepted.append(name)
                break
            reason = reason or answer
    if not accepted:
        raise Skipped(reason)
    return accepted

"""The engine under examination in one of its precisions and accelerators, and how cases ask it for hits and images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engines.choices import SAMPLERS, SHADERS
from engines.errors import RaybenchError
from engines.interface import Engine, Hits, Renderer, Settings
from engines.scene import Light, Material, Scene, Shape
from harness.verify.promises import tracing_precision
from harness.verify.stage import AHEAD, UNIT, scene, sphere

Array = NDArray[np.float64]
T = TypeVar("T")
UNBIASED = ("random", "sobol", "halton")
"""Samplers by any of which an image of few samples has the right mean, the best for statistics first."""


class Declined(Exception):
    """The engine lacks what a case needs; the message is what `why_not` answered."""


@dataclass(frozen=True)
class Subject:
    """`precision` is the setting; `kind` the scalar type in which the engine traces, and to which inputs are cast."""

    engine: Engine
    precision: str
    accelerator: str = "auto"
    quick: bool = True

    @property
    def tracing(self) -> str:
        return tracing_precision(self.engine, self.precision)

    @property
    def kind(self) -> Any:
        return np.dtype(self.tracing).type

    @property
    def eps(self) -> float:
        return float(np.finfo(self.kind).eps)

    def count(self, many: int) -> int:
        """How many rays or trials: a quarter in a quick run."""
        return max(many // 4, 1) if self.quick else many

    def some(self, values: Sequence[T], quick: int) -> Sequence[T]:
        """All parameters of a case; the first `quick` of them in a quick run."""
        return values[:quick] if self.quick else values

    def cast(self, values: ArrayLike) -> Array:
        """The values rounded to the tracing precision, so that this rounding is not charged to the engine."""
        with np.errstate(over="ignore"):
            return np.asarray(values, np.float64).astype(self.kind).astype(np.float64)

    def place(self, values: ArrayLike) -> tuple[float, float, float]:
        """A point or direction, cast."""
        x, y, z = self.cast(values)
        return float(x), float(y), float(z)

    def prepared(self, given: Scene, **settings: Any) -> Renderer:
        """A renderer, with the first unbiased sampler that the engine has where none is asked for.

        Raises `Declined` where `why_not` objects.
        """
        samplers = [settings["sampler"]] if "sampler" in settings else [*UNBIASED, *own_samplers(self.engine)]
        return self._first(given, [{**settings, "sampler": sampler} for sampler in samplers])

    def tracer(self, *shapes: Shape, **settings: Any) -> Renderer:
        """A renderer of shapes of material 0, to trace rays with: whatever shader and sampler the engine has."""
        return self._first(scene(shapes, camera=AHEAD), [{**chosen, **settings} for chosen in every_choice(self.engine)])

    def _first(self, given: Scene, choices: Sequence[dict[str, Any]]) -> Renderer:
        """A renderer with the first of these settings that the engine accepts; raises `Declined` where there is none."""
        reasons = []
        for choice in choices:
            asked = Settings(**{"precision": self.precision, "accelerator": self.accelerator, **choice})
            reason = objection(self.engine, given, asked)
            if reason is None:
                return self.engine.prepare(given, asked)
            reasons.append(reason)
        raise Declined(reasons[0])

    def accepted(self, samplers: Sequence[Any], given: Scene, shader: Any) -> list[Any]:
        """Those of these samplers that the engine has; raises `Declined` where it has none."""
        base = {"precision": self.precision, "accelerator": self.accelerator, "shader": shader}
        reasons = [objection(self.engine, given, Settings(sampler=sampler, **base)) for sampler in samplers]
        if None not in reasons:
            raise Declined(reasons[0] or "")
        return [sampler for sampler, reason in zip(samplers, reasons, strict=True) if reason is None]

    def trace(self, shapes: Sequence[Shape], origins: ArrayLike, directions: ArrayLike, t_max: Any = np.inf) -> Hits:
        return self.tracer(*shapes).trace(origins, directions, t_max)

    def image(self, shapes: Sequence[Shape], materials: Sequence[Material], lights: Sequence[Light], camera: Any,
              shader: Any, spp: int = 1, **settings: Any) -> Array:  # fmt: skip
        """(height, width) red channel of the mean; infinite everywhere where the film holds a bad sample."""
        film = self.prepared(scene(shapes, materials, lights, camera), shader=shader, **settings).render(spp)
        seen = film.mean()[:, :, 0]
        return np.full_like(seen, np.inf) if film.bad_samples else seen

    def others(self) -> Iterator[Subject]:
        """The same with the engine's other accelerators."""
        for name in accelerators(self.engine):
            if name != self.accelerator:
                yield replace(self, accelerator=name)


def accelerators(engine: Engine) -> list[str]:
    """The accelerators by their own names; `auto` where there is no other."""
    return [name for name in engine.accelerators() if name != "auto"] or ["auto"]


def own_samplers(engine: Engine) -> list[str]:
    """Names of samplers that this engine alone has."""
    return list(getattr(engine, "samplers", dict)())


def every_choice(engine: Engine) -> list[dict[str, Any]]:
    """Every shader with every sampler, the ones that most engines have first."""
    shaders = ["path_tracer", *(name for name in SHADERS if name != "path_tracer")]
    samplers = dict.fromkeys([*UNBIASED, *SAMPLERS, *own_samplers(engine)])
    return [{"shader": shader, "sampler": sampler} for shader, sampler in product(shaders, samplers)]


def objection(engine: Engine, given: Scene, asked: Settings) -> str | None:
    """What `why_not` answers; a name that the engine does not know is an objection too."""
    try:
        return engine.why_not(given, asked)
    except RaybenchError as error:
        return str(error)


def precisions(engine: Engine) -> list[str]:
    """The precisions that the engine has, float64 first; raises `Declined` where it renders nothing at all.

    It is asked for a scene that is empty, and for one triangle or sphere, with every shader and sampler.
    """
    scenes = [scene(shapes, camera=AHEAD) for shapes in ([], [UNIT], [sphere()])]
    found, reason = [], ""
    for name in ("float64", "float32"):
        for given, choice in product(scenes, every_choice(engine)):
            answer = objection(engine, given, Settings(precision=name, **choice))
            if answer is None:
                found.append(name)
                break
            reason = reason or answer
    if not found:
        raise Declined(reason)
    return found

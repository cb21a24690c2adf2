"""The engine under examination in one of its precisions and accelerators, and how cases ask it for hits and images."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from engines.interface import Engine, Hits, Renderer, Settings
from engines.scene import Light, Material, Scene, Shape
from harness.verify.promises import tracing_precision
from harness.verify.stage import AHEAD, scene

Array = NDArray[np.float64]
T = TypeVar("T")


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
        """A renderer; raises `Declined` where `why_not` objects."""
        chosen = {"precision": self.precision, "accelerator": self.accelerator, "sampler": "random", **settings}
        asked = Settings(**chosen)
        reason = self.engine.why_not(given, asked)
        if reason is not None:
            raise Declined(reason)
        return self.engine.prepare(given, asked)

    def tracer(self, *shapes: Shape, **settings: Any) -> Renderer:
        """A renderer of shapes of material 0, to trace rays with."""
        return self.prepared(scene(shapes, camera=AHEAD), **settings)

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


def precisions(engine: Engine) -> list[str]:
    """The precisions that `why_not` accepts for an empty scene, float64 first."""
    empty = scene([], camera=AHEAD)
    return [name for name in ("float64", "float32") if engine.why_not(empty, Settings(precision=name)) is None]

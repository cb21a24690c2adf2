"""The engine under examination, and the ways in which claims ask it for renderers.

A claim is a function of a `Subject`: it returns where the claim holds, raises `Broken` with what was seen where it does
not, and lets `Declined` pass where the engine's own `why_not` says that it lacks what the claim needs.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from engines.conformance.stage import ROOM, TRIANGLES
from engines.interface import Engine, Renderer, Settings
from engines.scene import Scene

BASE: dict[str, Any] = {"width": 16, "height": 12, "sampler": "random", "seed": 7}
SHADERS: tuple[Any, ...] = ({"name": "path_tracer", "max_depth": 4}, "whitted", "no_shadows", "albedo", "depth_map")
SAMPLERS = ("random", "sobol", "halton", "stratified", "constant")


class Broken(Exception):
    """A claim does not hold; the message says what was seen."""


class Declined(Exception):
    """The engine lacks what a claim needs; the message is what `why_not` answered."""


def expect(condition: object, seen: str) -> None:
    """Raises `Broken` with `seen` unless `condition` is true."""
    if not condition:
        raise Broken(seen)


@dataclass(frozen=True)
class Subject:
    """An engine, and how closely to look: `quick` leaves out accelerators and precisions but the default."""

    engine: Engine
    quick: bool = True

    def renderer(self, scene: Scene, **changes: Any) -> Renderer:
        """A renderer of `scene` with the base settings, `changes` made; raises `Declined` where `why_not` objects."""
        settings = Settings(**{**BASE, **changes})
        reason = self.engine.why_not(scene, settings)
        if reason is not None:
            raise Declined(reason)
        return self.engine.prepare(scene, settings)

    @cached_property
    def easiest(self) -> tuple[Scene, Mapping[str, Any]]:
        """The first scene and settings that the engine accepts, the most demanding tried first."""
        reason = None
        for scene in (ROOM, TRIANGLES):
            for shader in SHADERS:
                for sampler in SAMPLERS:
                    changes = {"shader": shader, "sampler": sampler}
                    reason = self.engine.why_not(scene, Settings(**{**BASE, **changes}))
                    if reason is None:
                        return scene, changes
        raise Broken(f"no scene is accepted with any shader and sampler; for one triangle: {reason}")

    def usual(self, **changes: Any) -> Renderer:
        """A renderer of the easiest scene and settings, `changes` made."""
        scene, accepted = self.easiest
        return self.renderer(scene, **{**accepted, **changes})

    def tracers(self, scene: Scene) -> Iterator[tuple[str, Renderer]]:
        """Renderers of `scene` to trace rays with, each with a label; raises `Declined` where there is none."""
        variants: list[dict[str, Any]] = [{}]
        if not self.quick:
            variants += [{"accelerator": name} for name in self.engine.accelerators()]
            variants += [{"precision": name} for name in ("float64", "float32")]
        reasons, accepted = [], 0
        for variant in variants:
            try:
                renderer = self.renderer(scene, **{**self.easiest[1], **variant})
            except Declined as declined:
                reasons.append(declined)
                continue
            accepted += 1
            yield " ".join(variant.values()) or "as it comes", renderer
        if not accepted:
            raise reasons[0]

"""The engine under examination, and the ways in which claims ask it for renderers.

A claim is a function of a `Subject`: it returns where the claim holds, raises `Broken` with what was seen where it does
not, and lets `Declined` pass where the engine itself says that it lacks what the claim needs: by `why_not`, or by raising
`Unsupported` from `trace` or `occluded`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, cast

from numpy.typing import NDArray

from engines.conformance.stage import ROOM, TRIANGLES, in_file
from engines.errors import Unsupported
from engines.interface import Engine, Hits, Renderer, Settings
from engines.scene import Scene

BASE: dict[str, Any] = {"width": 16, "height": 12, "sampler": "random", "seed": 7}
SHADERS: tuple[Any, ...] = ({"name": "path_tracer", "max_depth": 4}, "whitted", "no_shadows", "albedo", "depth_map")
SAMPLERS = ("random", "sobol", "halton", "stratified", "constant")


class Broken(Exception):
    """A claim does not hold; the message says what was seen."""


class Declined(Exception):
    """The engine lacks what a claim needs; the message is the engine's."""


def expect(condition: object, seen: str) -> None:
    """Raises `Broken` with `seen` unless `condition` is true."""
    if not condition:
        raise Broken(seen)


class Answering:
    """A renderer that declines single rays where it raises `Unsupported`, and is itself in all else."""

    def __init__(self, renderer: Renderer) -> None:
        self._renderer = renderer

    def __getattr__(self, name: str) -> Any:
        return getattr(self._renderer, name)

    def trace(self, *rays: Any, **more: Any) -> Hits:
        return self._asked(self._renderer.trace, rays, more)

    def occluded(self, *rays: Any, **more: Any) -> NDArray[Any]:
        return self._asked(self._renderer.occluded, rays, more)

    def _asked(self, answer: Any, rays: Any, more: Any) -> Any:
        try:
            return answer(*rays, **more)
        except Unsupported as reason:
            raise Declined(str(reason)) from reason


@dataclass(frozen=True)
class Subject:
    """An engine, and how closely to look: `quick` leaves out accelerators and precisions but the default.

    Use it as a context: the files that scenes are written into end with it.
    """

    engine: Engine
    quick: bool = True
    _folder: Any = field(default_factory=lambda: tempfile.TemporaryDirectory(prefix="raybench-"), repr=False)

    def __enter__(self) -> Subject:
        return self

    def __exit__(self, *_: object) -> None:
        self._folder.cleanup()

    @property
    def listed(self) -> Mapping[str, Any]:
        """What the engine says there is to choose from, for one that takes not all of raybench's names."""
        return getattr(self.engine, "listed", {})

    def given(self, scene: Scene) -> Scene:
        """The scene as the engine can be given it: in a file for one that reads files."""
        return in_file(scene, Path(self._folder.name)) if getattr(self.engine, "reads_files", False) else scene

    def renderer(self, scene: Scene, **changes: Any) -> Renderer:
        """A renderer of `scene` with the base settings, `changes` made; raises `Declined` where `why_not` objects."""
        listed = {key: values[0] for key, values in self.listed.items() if key != "shader"}
        settings, held = Settings(**{**BASE, **listed, **changes}), self.given(scene)
        reason = self.engine.why_not(held, settings)
        if reason is not None:
            raise Declined(reason)
        return cast(Renderer, Answering(self.engine.prepare(held, settings)))

    @cached_property
    def easiest(self) -> tuple[Scene, Mapping[str, Any]]:
        """The first scene and settings that the engine accepts, the most demanding tried first."""
        known: dict[str, Any] = {"shader": SHADERS, "sampler": SAMPLERS, **self.listed}
        reason = None
        for scene in map(self.given, (ROOM, TRIANGLES)):
            for values in product(*known.values()):
                changes = dict(zip(known, values, strict=True))
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

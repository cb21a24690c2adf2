"""The renderer: one scene of Blender's, of which every call takes the next samples."""

from __future__ import annotations

from typing import Any

from engines.film import Image
from engines.interface import Settings
from engines.peers.adapters import ImageRenderer
from engines.peers.cycles.blender import MOST_SAMPLES, BlenderScene
from engines.scene import Scene

PASS = 1 << 19
"""Paths of a pass, after which `stop` is heard: Cycles has no way to end a render from outside."""


class Renderer(ImageRenderer):
    """Persistent data are on: Cycles keeps the scene and its BVH from call to call, and a call costs half a millisecond
    besides its samples. Building takes a first sample, since Cycles builds in the first render."""

    _blender: BlenderScene | None = None

    @property
    def samples_a_pass(self) -> int:  # type: ignore[override]
        return max(1, PASS // (self.film.width * self.film.height))

    def build(self, scene: Scene, settings: Settings) -> None:
        self._free()
        self._blender = BlenderScene(scene, settings)
        self._blender.render(1, 0, self.seed)

    def image(self, spp: int, offset: int, seed: int) -> tuple[Image, int]:
        assert self._blender is not None
        samples = min(spp, MOST_SAMPLES - offset)
        if samples < 1:
            raise RuntimeError(f"Cycles takes at most {MOST_SAMPLES} samples per pixel")
        return self._blender.render(samples, offset, seed).astype(float), samples

    def counters(self) -> dict[str, float]:
        """With `native_seconds`, those that Cycles' own render function took since the scene was built."""
        return {**super().counters(), "native_seconds": self._blender.seconds if self._blender else 0.0}

    def _free(self) -> None:
        if self._blender is not None:
            self._blender.free()
            self._blender = None

    def __del__(self) -> Any:
        self._free()

"""The references that cells need, and the second engines that are to certify them."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from harness.config.settings import SceneFile
from harness.hashing import digest
from harness.metrics import DEFAULT_MARGINS, Margins
from harness.settings import CellSettings

REPLICATES = 8
"""Images that a certifier renders, each under a seed of its own."""


class Certifier(NamedTuple):
    """An engine of another lineage that is to make the same image: `REPLICATES` times `spp` samples, at 1 / `factor` of the
    reference's width and height. `settings` are those of such an image; `why_not` says why it cannot."""

    engine: str
    lineage: str
    version: str
    settings: CellSettings
    spp: int
    factor: int
    why_not: str | None


@dataclass(frozen=True, slots=True)
class PlannedReference:
    """A reference that cells need: `spec` is the preimage of its id, `settings` what the engine gets, `lineage` the engine's.

    The certifier's image counts as the same within `margins`. A spec with `until` has as many replicates as that asks for, from
    its `replicates` on, as far as they fit into `max_seconds` of rendering.
    """

    scene: SceneFile
    scene_hash: str
    spec: Mapping[str, Any]
    settings: CellSettings
    lineage: str = ""
    certifier: Certifier | None = None
    margins: Margins = DEFAULT_MARGINS
    max_seconds: float = field(default=math.inf, compare=False)

    @property
    def reference_id(self) -> str:
        return digest(self.spec)

    @property
    def family(self) -> str:
        """The same for references that differ in the number of replicates alone."""
        return digest({key: value for key, value in self.spec.items() if key not in ("replicates", "until")})

    @property
    def spp(self) -> int:
        """Samples per pixel; where the spec has `until`, the fewest."""
        return self.spec["replicates"] * self.spec["replicate_spp"]

    @property
    def until(self) -> Mapping[str, Any] | None:
        """`metric`, `epsilon` and the `target` that decide the number of samples; None where that is given."""
        return self.spec.get("until")

    def describe(self) -> str:
        """Scene, size and samples, where these are given, in a few words."""
        size = f"{self.scene.name} {self.spec['width']}x{self.spec['height']}"
        return size if self.until else f"{size} {self.spp} spp"

    def folder(self, root: Path) -> Path:
        return root / self.scene_hash[:16] / self.reference_id

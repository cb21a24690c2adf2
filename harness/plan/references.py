"""The references that cells need, and the second engines that are to certify them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from harness.config.settings import SceneFile
from harness.hashing import digest
from harness.settings import CellSettings
from harness.statistics.equivalence import DEFAULT_MARGINS, Margins

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

    The certifier's image counts as the same within `margins`.
    """

    scene: SceneFile
    scene_hash: str
    spec: Mapping[str, Any]
    settings: CellSettings
    lineage: str = ""
    certifier: Certifier | None = None
    margins: Margins = DEFAULT_MARGINS

    @property
    def reference_id(self) -> str:
        return digest(self.spec)

    @property
    def family(self) -> str:
        """The same for references that differ in the number of replicates alone."""
        return digest({key: value for key, value in self.spec.items() if key != "replicates"})

    @property
    def spp(self) -> int:
        return self.spec["replicates"] * self.spec["replicate_spp"]

    def describe(self) -> str:
        """Scene, size and samples in a few words."""
        return f"{self.scene.name} {self.spec['width']}x{self.spec['height']} {self.spp} spp"

    def folder(self, root: Path) -> Path:
        return root / self.scene_hash[:16] / self.reference_id

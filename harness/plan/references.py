"""The references that cells need, and the second engines that are to certify them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.hashing import digest


@dataclass(frozen=True, slots=True)
class Certifier:
    """A second engine that is to make the same image; `why_not` says why it cannot."""

    engine: str
    version: str
    settings: Mapping[str, Any]
    why_not: str | None


@dataclass(frozen=True, slots=True)
class ReferenceWanted:
    """A reference that cells need: `asked` is the preimage of its id, `settings` what the engine gets."""

    scene_name: str
    scene_path: str
    scene_hash: str
    asked: Mapping[str, Any]
    settings: Mapping[str, Any]
    certifier: Certifier | None = None

    @property
    def reference_id(self) -> str:
        return digest(self.asked)

    @property
    def family(self) -> str:
        """The same for references that differ in the number of replicates alone."""
        return digest({key: value for key, value in self.asked.items() if key != "replicates"})

    @property
    def spp(self) -> int:
        return self.asked["replicates"] * self.asked["replicate_spp"]

    def describe(self) -> str:
        """Scene, size and samples in a few words."""
        return f"{self.scene_name} {self.asked['width']}x{self.asked['height']} {self.spp} spp"

    def folder(self, root: Path) -> Path:
        return root / self.scene_hash[:16] / self.reference_id

"""Refuses what would not fit into memory before it is allocated."""

from __future__ import annotations

from engines.memory import lacking_memory
from engines.scene.yaml_file import Located


def refuse_above_memory(node: Located, needed: float, what: str) -> None:
    """Raises when `needed` bytes are more than the memory of this machine, or than this process may use."""
    if lacks := lacking_memory(needed):
        raise node.refuse(f"{what} {lacks}")

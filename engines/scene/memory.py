"""Refuses what would not fit into the machine's memory before it is allocated."""

from __future__ import annotations

import psutil

from engines.scene.yaml_file import Located


def refuse_above_memory(node: Located, needed: float, what: str) -> None:
    """Raises when `needed` bytes are more than the memory of this machine."""
    total = psutil.virtual_memory().total
    if needed > total:
        raise node.refuse(f"{what} would need {gibibytes(needed)}: this machine has {gibibytes(total)}")


def gibibytes(size: float) -> str:
    return f"{size / 2**30:.3g} GiB"

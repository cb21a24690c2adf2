"""Markdown of plain text and tables."""

import re
from collections.abc import Iterable, Sequence


def plain(text: str) -> str:
    """Text that Markdown leaves as it is, but for what stands in backticks."""
    pieces = re.split(r"(`[^`]*`)", " ".join(text.split()))
    return "".join(piece if piece.startswith("`") else re.sub(r"([\\*_<>\[\]${}|#~^])", r"\\\1", piece) for piece in pieces)


def code(text: object) -> str:
    """`text` as code, or nothing where it is empty."""
    shown = str(text).replace("|", "\\|")
    return f"`{shown}`" if shown else ""


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of cells that are Markdown already."""
    lines = [f"| {' | '.join(heads)} |", f"|{' --- |' * len(heads)}"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)]) + "\n"

"""Markdown of plain text, docstrings and tables, as code hosts and Sphinx read it."""

import inspect
import re
from collections.abc import Iterable, Sequence


def plain(text: str) -> str:
    """Text that Markdown leaves as it is, but for what stands in backticks."""
    pieces = re.split(r"(`[^`]*`)", " ".join(text.split()))
    return "".join(each if each.startswith("`") else re.sub(r"[\\*<|$~]|(?<!\w)_|_(?!\w)", r"\\\g<0>", each) for each in pieces)


def summary(found: object) -> str:
    """The first paragraph of a docstring."""
    return plain((inspect.getdoc(found) or "").split("\n\n")[0])


def code(text: object) -> str:
    """`text` as code, or nothing where it is empty."""
    shown = str(text).replace("|", "\\|")
    return f"`{shown}`" if shown else ""


def table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of cells that are Markdown already."""
    return "\n".join(f"| {' | '.join(row)} |" for row in (heads, ["---"] * len(heads), *rows))


def paragraphs(parts: Iterable[str]) -> str:
    """Headings, paragraphs and tables one below the other, without those that are empty."""
    return "\n\n".join(filter(None, parts))

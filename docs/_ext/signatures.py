"""Signatures as the sources have them: `ArrayLike` and `NDArray[float64]` for what Python makes of them, none for protocols."""

import re

from numpy.typing import ArrayLike
from sphinx.util.typing import stringify_annotation

LIKE = stringify_annotation(ArrayLike, "smart")
ARRAY = re.compile(r"~?numpy\.ndarray\[tuple\[~?typing\.Any, \.\.\.\], ~?numpy\.dtype\[~?(?:numpy\.)?([\w.~]+)\]\]")


def shorten(app, what, name, obj, options, signature, returned):
    if what == "class" and getattr(obj, "_is_protocol", False):
        return "", None
    if what == "function" and signature and signature.startswith("(typing, "):
        signature = "(" + signature.removeprefix("(typing, ")  # an intrinsic, which its caller calls without
    return tuple(text and ARRAY.sub(r"NDArray[\1]", text.replace(LIKE, "ArrayLike")) for text in (signature, returned))


def keep_code(app, what, name, obj, options, lines):
    """Makes literal blocks of what docstrings indent, as Markdown has it; an initial begins no list."""
    lines[:] = [re.sub(r"^([A-Z])\. ", r"\\\1. ", line) for line in lines]
    for at in range(len(lines) - 1, 0, -1):
        begins = lines[at].startswith("    ") and not lines[at - 1] and not "".join(lines[at - 2 : at - 1]).startswith(" ")
        if begins and not "".join(lines[:at]).endswith("::"):
            lines[at:at] = ["::", ""]


def leave_out(app, what, name, obj, skip, options):
    """Fields of named tuples that have no words but Python's own; the signature shows them already."""
    return True if (getattr(obj, "__doc__", "") or "").startswith("Alias for field number") else None


def setup(app):
    app.connect("autodoc-process-docstring", keep_code)
    app.connect("autodoc-skip-member", leave_out)
    app.connect("autodoc-process-signature", shorten)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}

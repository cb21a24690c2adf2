"""Words with placeholders: `spp={spp}`; `{{` and `}}` are braces. Nothing but names from a given list is replaced."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping

from engines.errors import suggestion
from engines.schema.yaml_file import Located

_PIECE = re.compile(r"\{\{|\}\}|\{([^{}]*)\}|[{}]")


def placeholders(text: str, known: Iterable[str], node: Located) -> Iterator[str]:
    """The names used in `text`; raises what `node` refuses where one is unknown or a brace stands alone."""
    known = list(known)
    for piece in _PIECE.finditer(text):
        if piece[0] in ("{", "}"):
            raise node.refuse(f"{text!r}: a brace stands alone; {{{{ and }}}} are braces")
        if piece[1] is not None:
            if piece[1] not in known:
                raise node.refuse(f"{text!r}: unknown placeholder {{{piece[1]}}}: {suggestion(piece[1], known)}")
            yield piece[1]


def filled(text: str, values: Mapping[str, object]) -> str:
    """`text` with every placeholder replaced; a value that is missing raises KeyError."""
    braces = {"{{": "{", "}}": "}"}
    return _PIECE.sub(lambda piece: braces.get(piece[0]) or str(values[piece[1]]), text)

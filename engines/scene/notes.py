"""What an importer approximates or leaves out, each thing once with the names that it is about."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from typing import Any

MAX_NAMED = 5
"""Names or lines that a note lists."""


@dataclass(slots=True)
class Notes:
    """Notes by what they say, each with the names that `name_of` gives what it is about, and names of what is dropped."""

    name_of: Callable[[Any], str] = str
    names: dict[str, dict[str, None]] = field(default_factory=dict)
    dropped: dict[str, None] = field(default_factory=dict)

    def add(self, text: str, about: Any) -> None:
        """A note about something."""
        self.names.setdefault(text, {})[self.name_of(about)] = None

    def drop(self, what: str) -> None:
        """Counts something that does not change the expected image."""
        self.dropped[what] = None

    def sentences(self) -> Iterator[str]:
        """Every note once."""
        for text, names in self.names.items():
            yield f"{enumeration(names)}: {text}"
        if self.dropped:
            yield f"dropped, as the expected image does not depend on them: {', '.join(self.dropped)}"


def enumeration(names: Collection[str]) -> str:
    """The first names, and how many more there are."""
    more = f" and {len(names) - MAX_NAMED} more" if len(names) > MAX_NAMED else ""
    return f"{', '.join(list(names)[:MAX_NAMED])}{more}"

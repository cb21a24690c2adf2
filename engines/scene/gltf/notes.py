"""What is approximated or left out, each thing once with the names that it is about."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

MAX_NAMED = 5
"""Names that a note lists."""


@dataclass(slots=True)
class Notes:
    """Notes by what they say, each with its names."""

    names: dict[str, dict[str, None]] = field(default_factory=dict)

    def add(self, text: str, name: str) -> None:
        """A note about something of this name."""
        self.names.setdefault(text, {})[name] = None

    def sentences(self) -> Iterator[str]:
        """Every note once."""
        for text, names in self.names.items():
            more = f" and {len(names) - MAX_NAMED} more" if len(names) > MAX_NAMED else ""
            yield f"{', '.join(list(names)[:MAX_NAMED])}{more}: {text}"

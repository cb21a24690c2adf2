"""The accuracy suite as runs see it: what they ask of it, and the name by which it is loaded."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import Any, NamedTuple, Protocol

from engines.interface import Engine

SUITE = "harness.verify.suite"
"""The module that is the suite; it is imported when a config has the key `verify`."""
JOB = f"{SUITE}:job"
"""What a measuring worker does for a case: see `harness.measure.worker`."""


class Check(NamedTuple):
    """A case for one engine: `case` is its id, `source` the text of the module that checks it."""

    case: str
    precision: str
    accelerator: str
    source: str


class Suite(Protocol):
    """A suite of cases that belong to sections."""

    def case_names(self) -> list[str]:
        """The names that a config may give: sections first, then ids of cases."""
        ...

    def checks(self, engine: Engine, names: Sequence[str]) -> Iterator[Check]:
        """The cases of these ids and sections in every precision of the engine, and with every accelerator where the case
        concerns these; none for an engine that renders nothing."""
        ...


def suite() -> Suite:
    """The suite of `raybench verify`."""
    found: Any = import_module(SUITE)
    return found

"""The cases that ids and section names choose."""

from __future__ import annotations

from collections.abc import Sequence

from harness.verify.battery import CASES
from harness.verify.case import Case


def chosen_cases(words: Sequence[str]) -> list[Case]:
    """The battery's cases of these ids and sections."""
    return [case for case in CASES if case.id in words or case.section in words]


def case_words() -> list[str]:
    """What may be asked for: sections first, then ids."""
    return [*dict.fromkeys(case.section for case in CASES), *(case.id for case in CASES)]

"""What `raybench verify` does."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from engines import registry
from engines.errors import ConfigError, UnknownName
from harness.commands import allow_here, consoles
from harness.examinations import case_words, chosen_cases
from harness.machine import usable_cores
from harness.progress import duration
from harness.settings import require_imports
from harness.verify import output, workers
from harness.verify.battery import BROKEN, CASES, Finding

OURS = ("numpy", "numba", "embree")
"""Who is asked when nobody is named."""
EVERY = "all"
MOST_JOBS = 8
"""Processes by default: each holds an engine and what it compiled, a gigabyte where that is everything."""


class Asked(NamedTuple):
    """The command line; `only` holds ids of cases and names of sections, all where there are none."""

    engines: Sequence[str] = ()
    quick: bool = False
    only: Sequence[str] = ()
    out: Path | None = None
    jobs: int | None = None
    allow_imports: bool = False


def verify(asked: Asked) -> int:
    """Runs the battery, prints and writes what it found; 1 where a promise is broken, 130 where it was interrupted."""
    stdout, stderr = consoles()
    allow_here(asked.allow_imports)
    for word in asked.only:
        if word not in case_words():
            raise UnknownName("case or section", word, case_words())
    cases = chosen_cases(asked.only) if asked.only else CASES
    folder = asked.out or Path("results") / "verify"
    _make(folder)
    parts = workers.parts(_engines(asked, stderr), asked.quick, cases)
    done: dict[int, workers.Done] = {}
    try:
        _examine(parts, asked.jobs or min(len(usable_cores()), MOST_JOBS), stderr, done)
    except KeyboardInterrupt:
        aside = folder / "interrupted"  # earlier results that are whole stay
        output.write(_in_order(done), aside, asked.quick)
        stderr.print(f"\nInterrupted after {len(done)} of {len(parts)} parts. What they found is in {aside}.", soft_wrap=True)
        return 130
    found = _in_order(done)
    output.show(found, stdout)
    output.write(found, folder, asked.quick)
    stdout.print(f"Written: {folder / 'verify.html'} (and .json, .csv, .tex)", soft_wrap=True)
    return int(any(finding.verdict == BROKEN for finding in found))


def _make(folder: Path) -> None:
    """Before the work, not after it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"--out {folder}: {error.strerror}: name a folder that can be written to") from error
    if not os.access(folder, os.W_OK):
        raise ConfigError(f"--out {folder}: cannot be written to")


def _engines(asked: Asked, stderr: Console) -> list[str]:
    """The engines' names; tells who else could be asked, and warns of installed ones that cannot be loaded."""
    names = list(dict.fromkeys(asked.engines))
    for name in names:
        require_imports(name, asked.allow_imports)
        if registry.is_file(name):
            raise ConfigError(f"{name}: a renderer by process answers no single rays: ask `raybench equivalence`")
    if names and EVERY not in names:
        return names
    installed = [engine.name for engine in registry.all_engines()]
    if names:
        return list(dict.fromkeys([*installed, *(name for name in names if name != EVERY)]))
    others = [name for name in installed if name not in OURS]
    if others:
        stderr.print(f"Asked: {', '.join(OURS)}. Installed besides: {', '.join(others)} (--engine NAME, or --engine all).",
                     markup=False, soft_wrap=True)  # fmt: skip
    return list(OURS)


def _examine(parts: Sequence[workers.Part], jobs: int, stderr: Console, done: dict[int, workers.Done]) -> None:
    """Fills `done`, parts by their numbers; on stderr a line a part, or on a terminal how far it is."""
    with stderr.status(f"verify: {len(parts)} parts, {jobs} at a time") as status:
        for each in workers.run(parts, jobs):
            done[each.number] = each
            told = output.counts(each.findings)
            words = (f"verify [{len(done)}/{len(parts)}] {each.part.words}: "
                     f"{output.counts_text(told)}, {duration(each.seconds)}")  # fmt: skip
            status.update(words)
            if not stderr.is_terminal or told[BROKEN]:
                stderr.print(words, markup=False, highlight=False, soft_wrap=True)


def _in_order(done: Mapping[int, workers.Done]) -> list[Finding]:
    return [finding for number in sorted(done) for finding in done[number].findings]

"""What `raybench verify` does."""

from __future__ import annotations

import os
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from engines import registry
from engines.errors import ConfigError, UnknownName
from harness.config.settings import require_imports
from harness.console import allow_here, consoles
from harness.measure.machine import usable_cores
from harness.run.progress import duration
from harness.verify import output, workers
from harness.verify.battery import BROKEN, CASES, DECLINED, Finding
from harness.verify.selection import case_words, chosen_cases

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
    """Runs the battery, prints and writes what it found.

    1 where a promise is broken, 2 where nothing was examined of an engine that was named, 130 where it was interrupted.
    """
    stdout, stderr = consoles()
    allow_here(asked.allow_imports)
    for word in asked.only:
        if word not in case_words():
            raise UnknownName("case or section", word, case_words())
    cases = chosen_cases(asked.only) if asked.only else CASES
    folder = asked.out or Path("results") / "verify"
    _make(folder)
    known = _engines(asked, stderr)
    parts = workers.parts(known, asked.quick, cases)
    done: dict[int, workers.Done] = {}
    try:
        _examine(parts, asked.jobs or min(len(usable_cores()), MOST_JOBS), stderr, done)
    except KeyboardInterrupt:
        aside = folder / "interrupted"  # earlier results that are whole stay
        output.write(_in_order(done), aside, asked.quick)
        stderr.print(f"\nInterrupted after {len(done)} of {len(parts)} parts. What they found is in {aside}.", soft_wrap=True)
        return 130
    found = _in_order(done)
    if found:
        output.show(found, stdout)
        output.write(found, folder, asked.quick)
        stdout.print(f"Written: {folder / 'verify.html'} (and .json, .csv, .tex)", soft_wrap=True)
    untested = _untested(known, found)
    for engine, reason in untested.items():
        stderr.print(f"raybench: {engine}: nothing was examined: {reason}", markup=False, highlight=False, soft_wrap=True)
    if any(finding.verdict == BROKEN for finding in found):
        return 1
    return 2 if untested and (EVERY not in asked.engines or len(untested) == len(known)) else 0


def _untested(known: Sequence[workers.Known], found: Sequence[Finding]) -> dict[str, str]:
    """Engines of which nothing was examined, with the reason."""
    reasons = {}
    for engine in known:
        mine = [finding for finding in found if (finding.engine, finding.version) == (engine.name, engine.version)]
        if all(finding.verdict == DECLINED for finding in mine):
            left_out = "a quick run leaves the chosen cases out"
            reasons[engine.asked] = engine.refusal or (f"it declines: {mine[0].note}" if mine else left_out)
    return reasons


def _make(folder: Path) -> None:
    """Before the work, not after it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"--out {folder}: {error.strerror}: name a folder that can be written to") from error
    if not os.access(folder, os.W_OK):
        raise ConfigError(f"--out {folder}: cannot be written to")


def _engines(asked: Asked, stderr: Console) -> list[workers.Known]:
    """The engines; one that was named must be one that can be loaded, of `all` the others are left out with a warning."""
    named = [name for name in dict.fromkeys(asked.engines) if name != EVERY]
    for name in named:
        require_imports(name, asked.allow_imports)
        if registry.is_file(name):
            raise ConfigError(f"{name}: a renderer by process answers no single rays: ask `raybench equivalence`")
        if ":" not in name and name not in registry.known_names():
            raise UnknownName("engine", name, registry.known_names())
    installed = registry.engine_names()
    others = [name for name in installed if name not in OURS]
    if not asked.engines and others:
        stderr.print(f"Asked: {', '.join(OURS)}. Installed besides: {', '.join(others)} (--engine NAME, or --engine all).",
                     markup=False, soft_wrap=True)  # fmt: skip
    names = dict.fromkeys([*(installed if EVERY in asked.engines else []), *named]) or OURS
    known = workers.known(list(names))
    for engine in known:
        if engine.problem and (engine.asked in named or EVERY not in asked.engines):
            raise ConfigError(engine.problem)
        if engine.problem:
            warnings.warn(f"{engine.problem}: it is left out", stacklevel=2)
    return [engine for engine in known if not engine.problem]


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

"""What `raybench verify` does."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from rich.console import Console

from engines import registry
from engines.errors import ConfigError, UnknownName
from harness.check_results import FAIL, SKIP, CheckResult, counts, counts_text
from harness.console import consoles
from harness.measure.machine import usable_cores
from harness.processes import allow_here
from harness.run.progress import duration
from harness.settings import require_imports
from harness.store import make_out
from harness.verify.commands import output
from harness.verify.parallel import EngineInfo, FinishedJob, Job, describe_engines, make_jobs, run_jobs
from harness.verify.suite import CASES, case_names, select_cases

DEFAULT_ENGINES = ("numpy", "numba", "embree")
ALL = "all"
MOST_JOBS = 8
"""Worker processes by default: each holds an engine and what it compiled, up to a gigabyte."""


class VerifyOptions(NamedTuple):
    """The command line; `only` holds case ids and names of sections, or nothing for all cases."""

    engines: Sequence[str] = ()
    quick: bool = False
    only: Sequence[str] = ()
    out: Path | None = None
    jobs: int | None = None
    allow_imports: bool = False


def verify(options: VerifyOptions) -> int:
    """Runs the suite, prints the results and writes them.

    Returns the exit code: 1 where a check fails, 2 where nothing was checked of an engine that was named, 130 where the run
    was interrupted.
    """
    stdout, stderr = consoles()
    allow_here(options.allow_imports)
    for name in options.only:
        if name not in case_names():
            raise UnknownName("case or section", name, case_names())
    cases = select_cases(options.only) if options.only else CASES
    folder = options.out or Path("results") / "verify"
    make_out(folder)
    engines = _engines(options, stderr)
    jobs = make_jobs(engines, options.quick, cases)
    done: dict[int, FinishedJob] = {}
    try:
        _run(jobs, options.jobs or min(len(usable_cores()), MOST_JOBS), stderr, done)
    except KeyboardInterrupt:
        aside = folder / "interrupted"  # complete results of an earlier run stay
        output.write(_in_order(done), aside, options.quick)
        stderr.print(f"\nInterrupted after {len(done)} of {len(jobs)} jobs. Their results are in {aside}.", soft_wrap=True)
        return 130
    results = _in_order(done)
    if results:
        output.show(results, stdout)
        output.write(results, folder, options.quick)
        stdout.print(f"Written: {folder / 'verify.html'} (and .json, .csv, .tex)", soft_wrap=True)
    unchecked = _unchecked(engines, results)
    for engine, reason in unchecked.items():
        stderr.print(f"raybench: {engine}: nothing was checked: {reason}", markup=False, highlight=False, soft_wrap=True)
    if any(result.outcome == FAIL for result in results):
        return 1
    return 2 if unchecked and (ALL not in options.engines or len(unchecked) == len(engines)) else 0


def _unchecked(engines: Sequence[EngineInfo], results: Sequence[CheckResult]) -> dict[str, str]:
    """Engines of which nothing was checked, with the reason."""
    reasons = {}
    for engine in engines:
        own = [result for result in results if (result.engine, result.version) == (engine.name, engine.version)]
        if all(result.outcome == SKIP for result in own):
            left_out = "a quick run leaves out the chosen cases"
            reasons[engine.spec] = engine.refusal or (f"all cases are skipped: {own[0].note}" if own else left_out)
    return reasons


def _engines(options: VerifyOptions, stderr: Console) -> list[EngineInfo]:
    """The engines to check. One that was named must load; `all` leaves out others that do not, with a warning."""
    named = [name for name in dict.fromkeys(options.engines) if name != ALL]
    for name in named:
        require_imports(name, options.allow_imports)
        if registry.is_file(name):
            raise ConfigError(f"{name}: an external renderer traces no single rays: use `raybench verify --against`")
        if not registry.is_known(name):
            raise UnknownName("engine", name, registry.known_names())
    installed = registry.engine_names()
    others = [name for name in installed if name not in DEFAULT_ENGINES]
    if not options.engines and others:
        stderr.print(
            f"Engines: {', '.join(DEFAULT_ENGINES)}. Also installed: {', '.join(others)} (--engine NAME, or --engine all).",
            markup=False,
            soft_wrap=True,
        )
    names = dict.fromkeys([*(installed if ALL in options.engines else []), *named]) or DEFAULT_ENGINES
    engines = describe_engines(list(names))
    for engine in engines:
        if engine.problem and (engine.spec in named or ALL not in options.engines):
            raise ConfigError(engine.problem)
        if engine.problem:
            warnings.warn(f"{engine.problem}: it is left out", stacklevel=2)
    return [engine for engine in engines if not engine.problem]


def _run(jobs: Sequence[Job], processes: int, stderr: Console, done: dict[int, FinishedJob]) -> None:
    """Fills `done`, job number -> finished job. Prints a line per job to stderr; a terminal shows the last one only."""
    with stderr.status(f"verify: {len(jobs)} jobs, {processes} at a time") as status:
        for finished in run_jobs(jobs, processes):
            done[finished.number] = finished
            counted = counts(finished.results)
            line = (
                f"verify [{len(done)}/{len(jobs)}] {finished.job.description}: "
                f"{counts_text(counted)}, {duration(finished.seconds)}"
            )
            status.update(line)
            if not stderr.is_terminal or counted[FAIL]:
                stderr.print(line, markup=False, highlight=False, soft_wrap=True)


def _in_order(done: Mapping[int, FinishedJob]) -> list[CheckResult]:
    return [result for number in sorted(done) for result in done[number].results]

"""`python -m tests.fuzz [KIND ...] [--seed 1] [--cases 1000] [--case 17] [--jobs 2] [--out results/fuzz]`, or `make fuzz`.

Reads damaged scenes, meshes, glTF files, images, configs and events, the same for the same seed. Each case must end well, or
in an error of raybench's own: one line that names the file. A traceback, a case that hangs, a process that dies and memory
above a limit are failures: printed with a command that repeats the case, its input kept. Exit code 1 where there is one.
"""

from __future__ import annotations

import argparse
import faulthandler
import importlib
import os
import shutil
import sys
import traceback
from pathlib import Path
from time import perf_counter

from tests.fuzz.runner import KINDS, Tally, run
from tests.fuzz.worker import run_case

HEADINGS = ("kind", "cases", "accepted", "refused", "failures", "worst [s]", "peak [MiB]")


def main() -> int:
    """The exit code."""
    options = _options()
    if options.case is not None:
        return _one(options)
    print(f"seed {options.seed}, {options.cases} cases of each kind")
    start = perf_counter()
    tallies = []
    for kind in options.kinds:
        folder = options.out / f"{kind}-{options.seed}"
        shutil.rmtree(folder, ignore_errors=True)
        tallies.append(run(kind, options.seed, 0, options.cases, folder, options.jobs, options.limit))
        _print_failures(tallies[-1], options.seed, folder)
    print(table(tallies))
    print(f"{perf_counter() - start:.0f} s with {options.jobs} processes")
    return 1 if any(tally.failures for tally in tallies) else 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description="Reads damaged files.")
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"of {', '.join(KINDS)} [default: all]")
    parser.add_argument("--seed", type=int, default=1, help="another seed, other damage")
    parser.add_argument("--cases", type=int, default=1000, help="of each kind")
    parser.add_argument("--case", type=int, help="this one alone, with its traceback")
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1), help="processes side by side")
    parser.add_argument("--limit", type=float, default=20.0, help="seconds after which a case counts as hanging")
    parser.add_argument("--out", type=Path, default=Path("results/fuzz"), help="where the inputs of failures are kept")
    options = parser.parse_args()
    options.kinds = options.kinds or list(KINDS)
    if unknown := sorted(set(options.kinds) - set(KINDS)):
        parser.error(f"unknown kind {unknown[0]}: known: {', '.join(KINDS)}")
    if options.case is not None and len(options.kinds) != 1:
        parser.error("--case wants one kind")
    return options


def _one(options: argparse.Namespace) -> int:
    """Repeats one case in this process; its input is kept."""
    (kind,) = options.kinds
    folder = options.out / f"{kind}-{options.seed}" / str(options.case)
    faulthandler.enable()
    faulthandler.dump_traceback_later(options.limit, exit=True)
    module = importlib.import_module(f"tests.fuzz.{kind}")
    outcome = run_case(module, options.seed, options.case, folder)
    print(f"{outcome.outcome} after {outcome.seconds:.2f} s with {outcome.mebibytes:.0f} MiB: {outcome.what}\ninput: {folder}")
    if outcome.outcome != "failed":
        return 0
    try:
        module.read(folder)
    except Exception:
        traceback.print_exc()
    return 1


def _print_failures(tally: Tally, seed: int, folder: Path) -> None:
    for failure in tally.failures:
        again = f"{Path(sys.executable).name} -m tests.fuzz {tally.kind} --seed {seed} --case {failure.case}"
        print(f"{tally.kind} {failure.case}: {failure.what[:300]!r}\n    again: {again}    input: {folder / str(failure.case)}")


def table(tallies: list[Tally]) -> str:
    """One row a kind."""
    rows = [HEADINGS] + [
        (t.kind, f"{t.cases}", f"{t.accepted}", f"{t.refused}", f"{len(t.failures)}", f"{t.seconds:.2f}", f"{t.mebibytes:.0f}")
        for t in tallies
    ]
    return "\n".join("  ".join(f"{cell:>10}" for cell in row) for row in rows)


if __name__ == "__main__":
    sys.exit(main())

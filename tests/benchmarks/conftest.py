"""Compares the benchmarks with `baseline.json` at the end: `make microbench`, or `make microbench ARGS='-k bvh'`.

The baseline holds no seconds but multiples of a fixed kernel's, timed in the same session, so that it can be
held against another machine, if roughly. Both are the least of all rounds: other programs only add time, and here nothing
is ranked. `RAYBENCH_BASELINE=update make microbench` lowers it to what is less now (remove the file first to begin anew);
`RAYBENCH_BASELINE=1.5` makes anything slower by that factor an error.
"""

import json
import os
from pathlib import Path
from time import perf_counter

import numpy as np
import pytest

BASELINE = Path(__file__).with_name("baseline.json")
MODE = os.environ.get("RAYBENCH_BASELINE", "")
NOTABLE = 1.3
"""Changes below this factor are the noise of a shared machine."""
yardsticks = []


def kernel_seconds():
    """Seconds of fixed work, some 30 ms: arithmetic within the cache, then memory. A change of it ends all comparisons."""
    small, large = np.arange(1 << 15, dtype=np.float64) / (1 << 15), np.ones(1 << 21)
    start = perf_counter()
    for _ in range(120):
        np.sqrt(np.add(np.multiply(small, small, out=small), 0.25, out=small), out=small)
    large[1:] += large[:-1]
    return perf_counter() - start


@pytest.fixture(autouse=True)
def yardstick():
    """The fixed kernel before every benchmark: its least of the session is the unit."""
    yardsticks.append(min(kernel_seconds() for _ in range(3)))


def ratios(config):
    """Name -> least time over yardstick, of what was measured in this session."""
    session = getattr(config, "_benchmarksession", None)
    found = [bench for bench in (session.benchmarks if session else []) if bench.stats.data]
    return {bench.name: bench.stats.min / min(yardsticks) for bench in sorted(found, key=lambda b: b.name)}


def changes(found):
    """(name, ratio, baseline's or None, factor or None), the most slowed first."""
    known = json.loads(BASELINE.read_text())["ratios"] if BASELINE.exists() else {}
    rows = [(name, ratio, known.get(name), ratio / known[name] if name in known else None) for name, ratio in found.items()]
    return sorted(rows, key=lambda row: -(row[3] or 0))


def pytest_terminal_summary(terminalreporter, config):
    found = ratios(config)
    if not found:
        return
    terminalreporter.section("against the baseline, in units of the fixed kernel")
    for name, ratio, before, factor in changes(found):
        word = "new" if factor is None else "slower" if factor > NOTABLE else "faster" if factor < 1 / NOTABLE else ""
        change = "" if factor is None else f"{before:10.3g} before  x {factor:.2f}"
        terminalreporter.line(f"{name:58} {ratio:10.3g}  {change} {word}")
    if MODE == "update":
        known = json.loads(BASELINE.read_text())["ratios"] if BASELINE.exists() else {}
        least = {name: min(ratio, known.get(name, ratio)) for name, ratio in found.items()}
        merged = {name: float(f"{ratio:.3g}") for name, ratio in sorted({**known, **least}.items())}
        text = {"unit": "least seconds over those of the fixed kernel in the same session", "ratios": merged}
        BASELINE.write_text(json.dumps(text, indent=2) + "\n")
        terminalreporter.line(f"{BASELINE} written")


def pytest_sessionfinish(session):
    """An error where a factor was given and something is slower by more."""
    try:
        limit = float(MODE)
    except ValueError:
        return
    if any(factor is not None and factor > limit for *_, factor in changes(ratios(session.config))):
        session.exitstatus = 1

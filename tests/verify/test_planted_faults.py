"""Every planted fault is caught by the case that is there for it; without it the case is kept.

The sources of the reference, or of the jitted engine, are copied and changed by text (`mutated.FAULTS`), and the copy is
examined as an engine of its own: what the battery finds, it finds through the interface.
"""

import os
import warnings

import pytest
from mutated import FAULTS, mutated

import engines
from harness.verify.battery import BROKEN, CASES, KEPT, examine
from harness.verify.subject import Subject

BY_ID = {case.id: case for case in CASES}


def _verdicts(engine, fault):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return {
            finding.verdict for finding in examine(BY_ID[fault.case], Subject(engine, "float64", fault.accelerator))
        }


DEAR = pytest.mark.skipif(
    "RAYBENCH_ALL_FAULTS" not in os.environ, reason="compiles for half a minute: RAYBENCH_ALL_FAULTS=1"
)
JITTED = [fault for fault in FAULTS if fault.jitted]


@pytest.mark.parametrize(
    "fault", [pytest.param(fault, id=fault.name, marks=[DEAR] if fault in JITTED[1:] else []) for fault in FAULTS]
)
def test_a_planted_fault_is_caught(fault, tmp_path):
    assert BROKEN in _verdicts(mutated(fault, tmp_path), fault)


@pytest.mark.parametrize(
    "fault", {(f.jitted, f.case, f.accelerator): f for f in FAULTS}.values(),
    ids=lambda fault: f"{'numba' if fault.jitted else 'numpy'} {fault.case} {fault.accelerator}",
)  # fmt: skip
def test_the_same_case_is_kept_without_it(fault):
    assert _verdicts(engines.engine("numba" if fault.jitted else "numpy"), fault) == {KEPT}

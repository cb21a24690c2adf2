"""Every planted fault is caught by the case that is there for it; without it the case is kept.

The reference's sources are copied and changed by text (`mutated.FAULTS`), and the copy is examined as an engine of its
own: what the battery finds, it finds through the interface.
"""

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


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_planted_fault_is_caught(fault, tmp_path):
    assert BROKEN in _verdicts(mutated(fault, tmp_path), fault)


@pytest.mark.parametrize("fault", {(f.case, f.accelerator): f for f in FAULTS}.values(), ids=lambda fault: fault.case)
def test_the_same_case_is_kept_without_it(fault):
    assert _verdicts(engines.engine("numpy"), fault) == {KEPT}

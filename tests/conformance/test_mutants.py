"""The conformance suite notices engines that do not conform: every claim has mutants that break it."""

import pytest

from engines import conformance
from engines.conformance import CLAIMS, check_engine, concurrency, rendering
from tests.conformance import mutant_answers, mutant_calls, mutant_rays, mutant_renders, mutants

MUTANTS = mutants.MUTANTS if all((mutant_answers, mutant_calls, mutant_rays, mutant_renders)) else []


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(("claim", "engine"), MUTANTS)
def test_a_mutant_is_noticed(claim, engine, monkeypatch):
    monkeypatch.setattr(conformance, "CLAIMS", (claim,))
    monkeypatch.setattr(rendering, "PATIENCE_SECONDS", 0.5)
    monkeypatch.setattr(concurrency, "HANG_SECONDS", 2.0)
    (finding,) = check_engine(engine())
    assert not finding.ok
    assert not finding.detail.startswith(("TypeError", "AttributeError", "NameError")), finding.detail


def test_every_claim_has_a_mutant():
    assert {parameters.values[0] for parameters in MUTANTS} == set(CLAIMS)

"""Every engine conforms, and the findings say what a reader needs."""

from typing import ClassVar

import numpy as np
import pytest

import engines
from engines import conformance
from engines.conformance import CLAIMS, Finding, assert_conforms, check_engine, hits, light, rendering, sentence_of
from tests.conformance.small_engine import Engine, Renderer


@pytest.mark.parametrize("name", engines.engine_names())
def test_the_engine_conforms_with_all_that_it_lists(name):
    if name.startswith("mitsuba"):
        pytest.importorskip("mitsuba", reason="the extra is not installed: pip install 'raybench[mitsuba]'")
    # Mitsuba compiles each of hundreds of scenes; embree has numba's kernels around its intersector, compiled once more
    assert_conforms(engines.engine(name), quick=name in ("mitsuba", "mitsuba_scalar", "embree"))


@pytest.mark.parametrize("quick", [True, False], ids=["quick", "whole"])
def test_the_smallest_engine_conforms(quick):
    assert_conforms(Engine(), quick)


def test_what_an_engine_declines_is_not_held_against_it():
    sentence = sentence_of(light.lossless_glass_is_invisible_in_a_furnace)
    assert Finding(sentence, True, "not examined: small knows diffuse surfaces only") in check_engine(Engine())


def test_what_an_engine_does_not_promise_is_quoted():
    class Careless(Renderer):
        def sphere(self, o, d, center, radius):
            nowhere = np.full(len(o), np.nan)
            return nowhere, nowhere, nowhere, np.zeros((len(o), 3))

    class Frank(Engine):
        renderer = Careless
        not_promised: ClassVar = {"spheres_are_hit_where_they_are": "spheres are not its thing"}

    findings = {finding.claim: finding for finding in check_engine(Frank())}
    excused = findings[sentence_of(hits.spheres_are_hit_where_they_are)]
    assert excused.ok
    assert "spheres are not its thing" in excused.detail


def test_an_engine_that_declines_everything_does_not_conform():
    class Idle(Engine):
        def why_not(self, scene, settings):
            return "today is Sunday"

    broken = [finding for finding in check_engine(Idle()) if not finding.ok]
    assert broken
    assert all("today is Sunday" in finding.detail for finding in broken)


def test_an_engine_that_crashes_is_a_finding_and_not_a_crash():
    class Crashing(Engine):
        def prepare(self, scene, settings):
            raise ZeroDivisionError("no lanes")

    broken = [finding for finding in check_engine(Crashing()) if not finding.ok]
    assert len(broken) > len(CLAIMS) / 2
    assert all("ZeroDivisionError" in finding.detail and "no lanes" in finding.detail for finding in broken)


def test_every_claim_says_in_a_sentence_what_must_hold():
    sentences = [sentence_of(claim) for claim in CLAIMS]
    assert len(set(sentences)) == len(sentences)
    assert all(sentence.endswith(".") and len(sentence) > 20 for sentence in sentences)


def test_all_that_is_broken_is_said_at_once(monkeypatch):
    class Broken(Renderer):
        def sphere(self, o, d, center, radius):
            nowhere = np.full(len(o), np.nan)
            return nowhere, nowhere, nowhere, np.zeros((len(o), 3))

        def random(self):
            return np.random.default_rng(self.done)

    class Mutant(Engine):
        renderer = Broken

    monkeypatch.setattr(conformance, "CLAIMS", (hits.spheres_are_hit_where_they_are, rendering.seeds_matter))
    with pytest.raises(AssertionError, match=r"'small' breaks 2 of 2 claims:\n.*\n.*by hand it is 4") as caught:
        assert_conforms(Mutant())
    assert sentence_of(rendering.seeds_matter) in str(caught.value)

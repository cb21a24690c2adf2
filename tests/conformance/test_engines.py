"""Every engine conforms, and the findings say what a reader needs."""

from typing import ClassVar

import numpy as np
import pytest

import engines
from engines import conformance
from engines.conformance import (
    CLAIMS,
    Finding,
    assert_conforms,
    check_engine,
    concurrency,
    hits,
    key_of,
    light,
    rendering,
    sentence_of,
)
from engines.errors import UnknownName
from tests.conformance.small_engine import Engine, Renderer
from tests.needs import marks_of

ELSEWHERE = ("cycles", "luxcore", "open3d")
"""Peers whose own tests examine them, where they are installed."""
SLOW = {"embree": [pytest.mark.slow]}
"""numba's kernels around another intersector, which tests/kernels/test_embree_hits.py and others examine by themselves."""
EXAMINED = [
    pytest.param(name, marks=[*marks_of(name), *SLOW.get(name, [])]) for name in engines.engine_names() if name not in ELSEWHERE
]


@pytest.mark.parametrize("name", EXAMINED)
def test_the_engine_conforms_with_all_that_it_lists(name):
    # whole, numba and embree compile each scene for every accelerator and precision, and Mitsuba hundreds of scenes
    assert_conforms(engines.engine(name), quick=name not in ("numpy", "embreex_batch"))


@pytest.mark.slow
def test_numba_conforms_with_every_accelerator_precision_shader_and_sampler():
    assert_conforms(engines.engine("numba"), quick=False)


def test_the_smallest_engine_conforms():
    assert_conforms(Engine(), quick=False)


def test_what_an_engine_declines_is_not_held_against_it(monkeypatch):
    claim = light.lossless_glass_is_invisible_in_a_furnace
    monkeypatch.setattr(conformance, "CLAIMS", (claim,))
    reason = "small knows diffuse surfaces only"
    declined = Finding(claim.__name__, sentence_of(claim), "declined", reason)
    assert check_engine(Engine()) == [declined] and declined.ok


def test_what_an_engine_does_not_promise_is_quoted(monkeypatch):
    claim = hits.spheres_are_hit_where_they_are
    monkeypatch.setattr(conformance, "CLAIMS", (claim,))

    class Careless(Renderer):
        def sphere(self, o, d, center, radius):
            nowhere = np.full(len(o), np.nan)
            return nowhere, nowhere, nowhere, np.zeros((len(o), 3))

    class Frank(Engine):
        renderer = Careless
        not_promised: ClassVar = {"spheres_are_hit_where_they_are": "spheres are not its thing"}

    (excused,) = check_engine(Frank())
    assert excused.ok and excused.claim == sentence_of(claim)
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


def test_an_engine_without_single_rays_declines_what_needs_them_and_is_held_to_all_else():
    class Raster(Renderer):
        """It traces for its own images alone."""

        rendering = False

        def samples(self):
            self.rendering = True
            try:
                return super().samples()
            finally:
                self.rendering = False

        def trace(self, origins, directions, t_max=np.inf):
            if not self.rendering:
                raise engines.Unsupported("a rasteriser has no rays")
            return super().trace(origins, directions, t_max)

    class Rasteriser(Engine):
        renderer = Raster

    found = {finding.key: finding for finding in check_engine(Rasteriser())}
    assert {finding.verdict for finding in found.values()} == {"holds", "declined"}
    for claim in hits.CLAIMS:
        assert (found[key_of(claim)].verdict, found[key_of(claim)].detail) == ("declined", "a rasteriser has no rays")
    assert found["update_of_the_shapes_starts_anew"].verdict == "holds"


def test_an_engine_that_cannot_render_what_it_accepted_is_not_excused_for_it(monkeypatch):
    monkeypatch.setattr(concurrency, "PASS_SECONDS", 0.5)  # no pass comes to be waited for

    class Late(Renderer):
        def render(self, spp, on_pass=None):
            raise engines.Unsupported("not today")

    class Promising(Engine):
        renderer = Late

    found = {finding.key: finding for finding in check_engine(Promising())}
    assert found["render_adds_to_the_film"].verdict == "broken" and "not today" in found["render_adds_to_the_film"].detail


def test_values_that_are_unknown_in_both_films_are_no_difference():
    class Halfless(Renderer):
        """It does not know its halves, as a renderer by process does not."""

        def render(self, spp, on_pass=None):
            film = super().render(spp, on_pass)
            film.even_sums[...] = np.nan
            return film

    class Frank(Engine):
        renderer = Halfless

    found = {finding.key: finding.verdict for finding in check_engine(Frank())}
    assert {key for key, verdict in found.items() if verdict == "broken"} == {"the_parts_of_the_film_belong_together"}


def test_two_images_that_are_not_known_are_not_taken_for_different_ones(monkeypatch):
    claims = rendering.seeds_matter, rendering.update_of_the_camera_starts_anew
    monkeypatch.setattr(conformance, "CLAIMS", claims)

    class Blank(Renderer):
        def samples(self):
            return np.nan * super().samples()

        def render(self, spp, on_pass=None):
            film = super().render(spp, on_pass)
            film.sums[...] = np.nan
            return film

    class Unseeing(Engine):
        renderer = Blank

    found = {finding.key: finding for finding in check_engine(Unseeing())}
    assert "give the same image" in found["seeds_matter"].detail
    assert "the image is the same" in found["update_of_the_camera_starts_anew"].detail


def test_keys_of_claims_stand_beside_their_results(monkeypatch):
    class Careless(Renderer):
        def random(self):
            return np.random.default_rng(self.done)

    class Mutant(Engine):
        renderer = Careless
        not_promised: ClassVar = {"spheres_are_hit_where_they_are": "spheres are not its thing"}

    monkeypatch.setattr(conformance, "CLAIMS", (hits.spheres_are_hit_where_they_are, rendering.seeds_matter))
    printed = [str(finding) for finding in check_engine(Mutant())]
    assert printed[0].startswith("not promised spheres_are_hit_where_they_are: A sphere is hit")
    assert printed[0].endswith("spheres are not its thing")
    assert printed[1].startswith("broken       seeds_matter: A seed gives one image")
    with pytest.raises(AssertionError, match=r"\n  seeds_matter: A seed gives one image"):
        assert_conforms(Mutant())


def test_an_unknown_key_of_what_is_not_promised_is_refused_with_the_nearest_and_all():
    class Mistaken(Engine):
        not_promised: ClassVar = {"seeds_mater": "all images are one"}

    meant = r"engine 'small'.*'seeds_mater': did you mean 'seeds_matter'\? known: a_point"
    with pytest.raises(UnknownName, match=meant) as said:
        check_engine(Mistaken())
    assert all(key_of(claim) in str(said.value) for claim in CLAIMS)

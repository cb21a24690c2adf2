"""A renderer by process is asked what its description says that it can do, in scenes that reach it."""

import os
import sys
from pathlib import Path

import pytest

import engines
from engines import conformance
from engines.conformance import asking, check_engine, hits, key_of, light, rendering
from engines.scene import Perspective
from tests.external.describing import described

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    """What is found of a program that shows grey noise, whatever the scene."""
    shaders = [{"name": "path_tracer", "max_depth": 6}, "albedo"]
    file = described(tmp_path_factory.mktemp("described"), shaders=shaders, threads=2)
    return {finding.key: finding for finding in check_engine(engines.engine(str(file)))}


def test_what_a_process_can_hold_it_is_held_to(found):
    held = [
        *(asking.the_engine_says_what_it_is, asking.unknown_names_are_refused, asking.values_out_of_range_are_refused),
        *(asking.why_not_and_prepare_agree, rendering.film_has_the_size_asked_for, rendering.seeds_matter),
        *(rendering.warm_up_leaves_the_film_untouched, rendering.on_pass_sees_the_film_grow),
        rendering.stop_at_rest_does_nothing,
    ]
    assert {key: finding.verdict for key, finding in found.items() if key in map(key_of, held)} == {
        key_of(claim): "holds" for claim in held
    }


def test_what_no_process_can_answer_is_declined_in_its_words(found):
    for claim in (*hits.CLAIMS, rendering.update_of_the_camera_starts_anew, rendering.update_of_the_shapes_starts_anew):
        assert found[key_of(claim)].verdict == "declined", found[key_of(claim)]
    assert "answers no single rays" in found["spheres_are_hit_where_they_are"].detail
    assert "path_tracer with max_depth = 6 only" in found["the_furnace_is_uniform"].detail
    assert "always takes 2 threads" in found["threads_change_nothing"].detail


def test_a_picture_that_is_not_the_scenes_is_seen(found):
    broken = {key for key, finding in found.items() if finding.verdict == "broken"}
    assert broken == {key_of(light.images_are_upright)}
    unexamined = {key for key, finding in found.items() if finding.verdict == "not promised"}
    assert unexamined == set(engines.peers.external.engine.NOT_PROMISED)


def test_raybenchs_own_command_makes_right_images(monkeypatch):
    """Scenes reach it in files: nothing else would have it show what they hold."""
    monkeypatch.setenv("PATH", os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]]))
    monkeypatch.setattr(conformance, "CLAIMS", (light.images_are_upright, light.a_point_light_falls_off_with_the_square))
    engine = engines.engine(str(ROOT / "configs/renderers/raybench.yaml"))
    monkeypatch.setattr(engine, "not_promised", {})
    assert [(finding.verdict, finding.detail) for finding in check_engine(engine)] == [("holds", "")] * 2


def test_a_scene_that_was_changed_since_its_file_is_not_given_as_that_file(tmp_path):
    engine = engines.engine(str(described(tmp_path)))
    with conformance.Subject(engine) as subject:
        held = subject.given(conformance.subject.TRIANGLES)
        assert Path(held.source).is_file() and held.content_hash == conformance.subject.TRIANGLES.content_hash
        assert isinstance(held.camera, Perspective)
    assert not Path(held.source).exists()

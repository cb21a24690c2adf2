"""Engines from packages of their own, installed as a user would install them: one that works, and several that do not."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import engines
from engines import registry
from harness import store
from harness.verify.commands.verify import VerifyOptions, verify
from tests.harness import sweeping

ROOT = Path(__file__).resolve().parent.parent.parent
PACKAGES = ROOT / "tests" / "third_party"
BROKEN = {
    "broken_import": "the driver is from 1997",
    "broken_attribute": "NoSuchThing",
    "broken_class": "is no engine: it lacks name, version, why_not, prepare, accelerators",
    "broken_start": "no such device",
    "broken_property": "the licence has expired",
    "broken_lists": "trees",
}


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """A folder that both packages are installed into by pip, without a network."""
    folder = tmp_path_factory.mktemp("site")
    install = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--no-index"]
    install += ["--no-deps", "--no-build-isolation", "--no-cache-dir", "--target", str(folder)]
    done = subprocess.run([*install, PACKAGES / "cutout", PACKAGES / "broken"], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture
def installed(site, monkeypatch):
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(site), str(ROOT / "tests" / "harness")]))
    return site


def python(*words, folder):
    return subprocess.run([sys.executable, *words], cwd=folder, capture_output=True, text=True, check=False, timeout=300)


def test_an_engine_of_another_package_is_found_and_conforms(installed):
    assert "cutout" in engines.engine_names()
    found = engines.engine("cutout")
    assert (found.name, found.version) == ("cutout", "0.3")
    from engines.conformance import assert_conforms

    assert_conforms(found, quick=False)


def test_it_races_under_the_same_clock(installed, tmp_path):
    text = sweeping.EXPERIMENT.replace("['fake_engines:Steady', 'fake_engines:Other']", "[cutout, 'fake_engines:Steady']")
    scene = sweeping.SCENE.replace(
        "sphere: {center: [0, 1, 0], radius: 1}", "triangle: {a: [-1, 0, 0], b: [1, 0, 0], c: [0, 2, 0]}"
    )
    path = sweeping.write(tmp_path, text + "shader: albedo\nsampler: random\n")
    (tmp_path / "ball.yaml").write_text(scene)
    outcome, _ = sweeping.run(path, tmp_path / "out")
    assert outcome.states == {"done": 4}
    events = store.latest_cells(store.read_events(tmp_path / "out")).values()
    assert ["rays" in event.counters for event in events if event.engine == "cutout"] == [False, False]


def test_broken_ones_are_listed_with_what_is_wrong_and_the_others_work(installed, tmp_path):
    done = python("-m", "harness", "list", folder=tmp_path)
    assert done.returncode == 0 and "Traceback" not in done.stderr, done.stderr
    words = " ".join(done.stdout.split())
    for name, said in BROKEN.items():
        assert name in words and said in words
    assert "cutout version 0.3" in words and "embree version" in words


@pytest.mark.parametrize(("name", "said"), list(BROKEN.items())[:-1])
def test_a_broken_one_that_is_asked_for_is_an_error_that_names_it(installed, name, said):
    with pytest.raises(engines.ConfigError, match=f"'{name}'.*{said}"):
        engines.engine(name)


def test_who_asks_for_all_engines_is_warned_of_the_broken_ones(installed, monkeypatch, tmp_path):
    monkeypatch.setattr(registry, "engine_names", lambda: ["cutout", *BROKEN])
    with pytest.warns(UserWarning) as warned:
        assert verify(VerifyOptions(["all"], quick=True, only=["T1"], out=tmp_path)) == 0
    said = " ".join(str(warning.message) for warning in warned)
    assert all(words in said for words in BROKEN.values())
    outcomes = json.loads((tmp_path / "verify.json").read_text())["outcomes"]
    assert set(outcomes) == {"pass"}, "an engine without Sobol is checked, too"

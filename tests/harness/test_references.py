"""References: two honest halves, an honest variance, and refusal of what is not what it claims to be."""

import json
from dataclasses import replace

import fake_engines
import numpy as np
import pytest

from engines.errors import ConfigError
from engines.film import Film
from engines.image import read_film_layers
from engines.schema.yaml_file import locate
from harness import config, store
from harness.config.sections import REFERENCE
from harness.measure.pool import Pool
from harness.plan import planner
from harness.run import reference_samples, references
from harness.store import reference_files
from tests.harness import sweeping


@pytest.fixture
def made(tmp_path):
    """Makes a reference of some samples per pixel: (what was wanted, its metadata, replicates rendered)."""
    path = sweeping.write(tmp_path)

    def make(spp, reports=None):
        (wanted,) = planner.make(config.load(path, [f"reference.spp={spp}"]), True).references.values()
        rendered = [] if reports is None else reports
        with Pool(True, tmp_path / "log") as pool:
            meta = references.make(wanted, tmp_path / "refs", pool, lambda done, count: rendered.append(done))
        return wanted, meta, rendered[:-1]

    return make


def read(wanted, root):
    return reference_files.read(wanted.folder(root), wanted.reference_id, wanted.scene_hash)


@pytest.mark.parametrize(
    ("spp", "replicates"),
    [(2, (1, 2)), (8, (1, 8)), (32, (4, 8)), (100, (8, 14)), (2048, (256, 8)), (8192, (256, 32)), (10_000, (256, 40))],
)
def test_replicates_are_even_in_number_powers_of_two_and_enough(spp, replicates):
    each, count = REFERENCE.read(locate({"spp": spp})).replicates
    assert (each, count) == replicates
    assert each * count >= spp and count % 2 == 0


def test_halves_are_independent_and_the_variance_is_that_of_the_mean(made, tmp_path):
    wanted, _, _ = made(256)
    reference = read(wanted, tmp_path / "refs")
    assert reference.spp == 256
    assert np.allclose(reference.mean, (reference.half_1 + reference.half_2) / 2)
    truth = fake_engines.truth(12, 8)
    deviation = reference.mean - truth
    expected = fake_engines.NOISE**2 / 256
    # 288 values: the mean square has a relative standard deviation of 8 %, the mean of 7 degrees of freedom 3 %.
    assert np.mean(deviation**2) == pytest.approx(expected, rel=0.35)
    assert np.mean(reference.variance) == pytest.approx(expected, rel=0.2)
    correlation = np.corrcoef((reference.half_1 - truth).ravel(), (reference.half_2 - truth).ravel())[0, 1]
    assert abs(correlation) < 0.25


def test_a_reference_that_is_there_is_not_rendered_again(made, tmp_path):
    wanted, first, rendered = made(64)
    assert rendered == list(range(8)) and references.ready(wanted, tmp_path / "refs")
    _, second, rendered = made(64)
    assert rendered == [] and second.sha256 == first.sha256


def test_more_samples_extend_and_equal_those_made_at_once(made, tmp_path):
    made(2048)
    wanted, _, rendered = made(4096)
    assert rendered == list(range(8, 16)), "the first eight are reused"
    extended = read(wanted, tmp_path / "refs")
    for path in sorted((tmp_path / "refs").glob("*/*/*")):
        path.unlink()
    wanted, _, rendered = made(4096)
    assert rendered == list(range(16))
    at_once = read(wanted, tmp_path / "refs")
    for name in ("mean", "half_1", "half_2", "variance"):
        assert np.array_equal(getattr(extended, name), getattr(at_once, name))


def test_an_interrupted_reference_goes_on_where_it_was(made, tmp_path, monkeypatch):
    whole, _, _ = made(64)
    expected = read(whole, tmp_path / "refs").mean
    for path in sorted((tmp_path / "refs").glob("*/*/*")):
        path.unlink()
    monkeypatch.setattr(references, "SAVE_EVERY_SECONDS", 0.0)

    class Interrupt(list):
        def append(self, done):
            if done == 5:
                raise KeyboardInterrupt
            super().append(done)

    with pytest.raises(KeyboardInterrupt):
        made(64, Interrupt())
    assert not references.ready(whole, tmp_path / "refs")
    wanted, _, rendered = made(64)
    assert rendered == [5, 6, 7]
    assert np.array_equal(read(wanted, tmp_path / "refs").mean, expected)


class OneSecondEach:
    """Renders noise; says that each image took a second, and remembers the seeds."""

    def __init__(self):
        self.seeds = []

    def replicates(self, engine, request, seeds):
        for seed in seeds:
            self.seeds.append(seed)
            film = Film(request.settings.width, request.settings.height)
            film.add(1 + 0.4 * np.random.default_rng(seed).standard_normal((*film.counts.shape, 3)))
            yield film, 1.0


def test_more_time_extends_a_reference_that_less_time_cut_short(tmp_path):
    """By default the time is no part of its id: it is that of the cells, of which a later run may have more."""
    root, loaded = tmp_path / "refs", config.load(sweeping.write(tmp_path), ["reference.spp=auto", "quality.targets=[0.01]"])
    (wanted,) = planner.make(loaded, True).references.values()
    short, long = replace(wanted, max_seconds=12.0), replace(wanted, max_seconds=1e6)
    meta = references.make(short, root, images := OneSecondEach(), lambda done, count: None)
    assert (meta.done, meta.complete, meta.cut_short) == (12, True, True) and images.seeds == list(range(9000, 9012))
    assert references.ready(short, root) and not references.ready(long, root)
    found = reference_samples.sufficiency(short, root, loaded.quality)
    assert found.enough is False and "reference.max_time allows 384" in found.message
    assert reference_samples.sufficiency(long, root, loaded.quality).enough is None

    class Looks(OneSecondEach):
        def replicates(self, *asked):
            for each in super().replicates(*asked):
                assert read(wanted, root).spp >= 384, "other runs can use it meanwhile"
                yield each

    meta = references.make(long, root, images := Looks(), lambda done, count: None)
    assert meta.done > 12 and not meta.cut_short and images.seeds == list(range(9012, 9000 + meta.done))
    assert references.ready(long, root) and references.ready(short, root)
    assert reference_samples.sufficiency(short, root, loaded.quality).enough is True


def test_a_stale_reference_is_refused(made, tmp_path):
    wanted, _, _ = made(8)
    root = tmp_path / "refs"
    with pytest.raises(ConfigError, match="the scene has changed since this reference was made"):
        reference_files.read(wanted.folder(root), wanted.reference_id, "0" * 64)
    moved = replace(wanted, spec={**wanted.spec, "seed": 1})
    moved.folder(root).parent.mkdir(parents=True, exist_ok=True)
    wanted.folder(root).rename(moved.folder(root))
    with pytest.raises(ConfigError, match="stale: it holds another reference"):
        references.ready(moved, root)


def test_a_damaged_reference_is_refused_with_what_to_do(made, tmp_path):
    wanted, meta, _ = made(8)
    folder = wanted.folder(tmp_path / "refs")
    data = bytearray((folder / meta.file).read_bytes())
    data[len(data) // 2] ^= 1
    (folder / meta.file).write_bytes(data)
    with pytest.raises(ConfigError, match=f"its checksum is not the recorded one: remove {folder}"):
        read(wanted, tmp_path / "refs")
    (folder / "reference.json").write_text("{")
    with pytest.raises(ConfigError, match=f"remove {folder} to make it anew"):
        references.ready(wanted, tmp_path / "refs")


def test_results_find_their_references(tmp_path, monkeypatch):
    monkeypatch.setenv("RAYBENCH_REFERENCES", str(tmp_path / "kept"))
    path, out = sweeping.write(tmp_path), tmp_path / "results" / "small"
    sweeping.run(path, out, ["repeats=1"])
    (event,) = [e for e in store.read_events(out) if e.event == "reference"]
    assert event.spp == 64 and (event.width, event.height) == (12, 8) and event.seconds > 0
    folder = tmp_path / "kept" / event.scene_hash[:16] / event.reference_id
    reference = store.reference_arrays(out, event.reference_id)
    assert reference.mean.shape == (8, 12, 3)
    assert np.allclose(read_film_layers(folder / "reference.exr").mean, reference.mean, atol=1e-6)
    meta = json.loads((folder / "reference.json").read_text())
    assert meta["machine"]["cpu"] and meta["spec"]["seed"] == 9000
    with pytest.raises(ConfigError, match="no reference 'nothing' is named"):
        store.reference_arrays(out, "nothing")


def test_nothing_appears_beside_the_results_and_sibling_results_share_one_reference(tmp_path, monkeypatch):
    monkeypatch.setenv("RAYBENCH_REFERENCES", str(tmp_path / "kept"))
    path = sweeping.write(tmp_path)
    for name in ("a", "b"):
        sweeping.run(path, tmp_path / "results" / name, ["repeats=1"])
    assert sorted(place.name for place in (tmp_path / "results").iterdir()) == ["a", "b"]
    assert len(list((tmp_path / "kept").glob("*/*/reference.json"))) == 1


def test_references_beside_results_of_earlier_versions_are_still_read(tmp_path, monkeypatch):
    monkeypatch.setenv("RAYBENCH_REFERENCES", str(tmp_path / "results" / "references"))
    path, out = sweeping.write(tmp_path), tmp_path / "results" / "small"
    sweeping.run(path, out, ["repeats=1"])
    (event,) = [e for e in store.read_events(out) if e.event == "reference"]
    monkeypatch.setenv("RAYBENCH_REFERENCES", str(tmp_path / "empty"))
    assert store.reference_arrays(out, event.reference_id).spp == 64
    (tmp_path / "results" / "references").rename(tmp_path / "gone")
    with pytest.raises(ConfigError, match="name its folder with --references"):
        store.reference_arrays(out, event.reference_id)


def test_the_cache_folder_is_the_users_unless_one_is_named(tmp_path, monkeypatch):
    monkeypatch.delenv("RAYBENCH_REFERENCES")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert reference_files.cache_folder() == tmp_path / "raybench" / "references"
    monkeypatch.setenv("RAYBENCH_REFERENCES", str(tmp_path / "mine"))
    assert reference_files.cache_folder() == tmp_path / "mine"

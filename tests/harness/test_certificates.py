"""Certificates: an engine of another lineage that makes the same image certifies a reference, any other does not, and the
report says so. Seeds are fixed; 0.1 % of equal images are called different."""

import fake_engines
import numpy as np
import pytest

from engines.errors import ConfigError
from engines.registry import engine, lineage_of
from harness import config, store
from harness.analysis.certificates import certificate_text, certifies
from harness.measure.pool import Pool
from harness.plan import certifiers, planner
from harness.report import write_derived
from harness.run import certificates, references
from tests.harness import sweeping
from tests.harness.sweeping import raybench


def certified_by(engine, spp=4096):
    asked = f"engine: 'fake_engines:Steady', spp: {spp}, seed: 9000, certify: {engine}"
    return sweeping.EXPERIMENT.replace("engine: 'fake_engines:Steady', spp: 64, seed: 9000, certify: null", asked)


def fake(name):
    return f"'fake_engines:{name}'"


@pytest.fixture
def made(tmp_path):
    """(what was wanted, the certificate) of a reference and the engine that is to certify it."""

    def make(engine, spp=4096):
        path = sweeping.write(tmp_path, certified_by(fake(engine), spp))
        (wanted,) = planner.make(config.load(path), True).references.values()
        with Pool(True, tmp_path / "log") as pool:
            references.make(wanted, tmp_path / "refs", pool, lambda done, count: None)
            return wanted, certificates.make(wanted, tmp_path / "refs", pool, lambda done, count: None)

    return make


def test_an_engine_of_another_lineage_that_makes_the_same_image_certifies(made):
    _, found = made("Apart", spp=8192)
    assert found.verdict == "equivalent" and found.image_bound < 0.005 and found.tile_bound < 0.05
    assert found.difference != 0, "it draws other random numbers"
    assert (found.lineage, found.reference_lineage) == ("apart", "steady") and certifies(found)
    said = certificate_text(found)
    assert said.startswith("certified by fake_engines:Apart (12x8, 8192 spp): image means differ by at most 0.")


def test_one_that_draws_the_same_numbers_needs_few(made):
    _, found = made("Other", spp=64)
    assert found.verdict == "identical" and found.image_bound < 1e-12 and certifies(found)


def test_a_brighter_engine_does_not(made):
    _, found = made("Brighter")
    assert found.verdict == "different" and not certifies(found)
    assert found.difference == pytest.approx(fake_engines.Brighter.factor - 1, abs=0.004)
    assert "REFUTED" in certificate_text(found)


def test_few_samples_are_unresolved(made):
    _, found = made("Apart", spp=8)
    assert found.verdict == "unresolved" and not certifies(found)
    said = certificate_text(found)
    assert said.startswith("uncertified: ") and "more samples are needed" in said


def test_an_engine_that_cannot_says_why(made):
    _, found = made("Picky", spp=8)
    assert found.verdict == "impossible" and certificate_text(found) == "uncertified: it never feels like it"


def test_one_with_bad_samples_makes_no_certificate(made):
    with pytest.raises(certificates.WorkerFailed, match=r"Spotty, seed \d+: 1 samples are NaN or infinite: finite"):
        made("Spotty", spp=8)


def test_certifying_changes_no_id_and_a_certificate_is_found_again(made, tmp_path):
    wanted, found = made("Other", spp=64)
    (plain,) = planner.make(config.load(sweeping.write(tmp_path)), True).references.values()
    assert plain.reference_id == wanted.reference_id and plain.certifier is None
    again = certificates.existing(wanted, tmp_path / "refs")
    assert again is not None and again.certificate_id == found.certificate_id
    certificates.path_of(wanted, tmp_path / "refs").write_text("{")
    with pytest.raises(ConfigError, match="remove it to make it anew"):
        certificates.existing(wanted, tmp_path / "refs")


def test_the_engine_itself_is_no_witness(tmp_path):
    with pytest.raises(ConfigError, match=r"small\.yaml:9.*another engine than the reference's"):
        config.load(sweeping.write(tmp_path, certified_by(fake("Steady"))))


def test_an_engine_of_the_same_lineage_is_refused_with_one_line(tmp_path):
    text = certified_by("numba").replace("'fake_engines:Steady', spp", "embree, spp")
    with pytest.raises(ConfigError) as refused:
        planner.make(config.load(sweeping.write(tmp_path, text)), True)
    said = str(refused.value)
    assert "reference.certify = 'numba': is of the lineage raybench-kernels, as the reference's engine embree is" in said
    assert "\n" not in said
    with pytest.raises(ConfigError, match="is of the lineage steady"):
        planner.make(config.load(sweeping.write(tmp_path, certified_by(fake("Sibling")))), True)


def test_lineages_are_declared_or_the_name():
    lineages = {name: lineage_of(engine(name)) for name in ("numpy", "numba", "embree", "embreex_batch", "mitsuba_scalar")}
    assert lineages == {
        "numpy": "raybench-numpy",
        "numba": "raybench-kernels",
        "embree": "raybench-kernels",
        "embreex_batch": "raybench-numpy",
        "mitsuba_scalar": "mitsuba",
    }
    assert lineage_of(fake_engines.Steady()) == "steady" and lineage_of(fake_engines.Sibling()) == "steady"

    class Unspeakable(fake_engines.Steady):
        lineage = 3

    with pytest.raises(ConfigError, match="its lineage is 3: a line of text is expected"):
        engine(Unspeakable())


@pytest.mark.parametrize(("by", "expected"), [("embree", "numpy"), ("numpy", "embree")])
def test_the_default_certifier_is_of_another_lineage(tmp_path, by, expected):
    text = certified_by("auto", 64).replace("'fake_engines:Steady', spp", f"{by}, spp")
    (wanted,) = planner.make(config.load(sweeping.write(tmp_path, text)), True).references.values()
    assert wanted.certifier is not None and wanted.certifier.engine == expected and wanted.certifier.why_not is None
    assert wanted.certifier.lineage != wanted.lineage


def test_a_slow_lineage_makes_a_smaller_image_and_never_more_samples_than_the_reference():
    assert certifiers.share("raybench-numpy", 96, 96, 2048) == (1, 4)
    assert certifiers.share("raybench-numpy", 256, 256, 8192) == (2, 4)
    assert certifiers.share("raybench-numpy", 1920, 1080, 8192) == (12, 4)
    assert certifiers.share("mitsuba", 256, 256, 8192) == (1, 256)
    assert certifiers.share("mitsuba", 24, 24, 32) == (1, 4)
    assert certifiers.share("raybench-numpy", 997, 991, 8192) == (1, 1)
    assert certifiers.candidates(96, 96)[:2] == ("embree", "numpy") and certifiers.candidates(512, 512)[-1] == "numpy"


def test_where_no_engine_of_another_lineage_can_it_is_said_why(tmp_path):
    """An engine's own shader is known to nobody else."""
    text = certified_by("auto", 8)
    text = text.replace("scene: ball.yaml", "scene: ball.yaml\nshader: 'tests.harness.test_certificates:Unknown'")
    (wanted,) = planner.make(config.load(sweeping.write(tmp_path, text)), True).references.values()
    assert wanted.certifier is not None
    assert str(wanted.certifier.why_not).startswith("no engine of another lineage can: embree: ")


class Unknown:
    """A shader without code for any engine of ours."""

    name = "unknown"


def test_a_run_records_it_once_and_the_report_says_it_first(tmp_path):
    path, out = sweeping.write(tmp_path, certified_by(fake("Brighter"))), tmp_path / "results" / "small"
    _, listener = sweeping.run(path, out, ["repeats=1"])
    sweeping.run(path, out, ["repeats=1"])
    (event,) = [e for e in store.read_events(out) if e.event == "certificate"]
    assert event.verdict == "different" and not hasattr(event, "machine")
    assert any("REFUTED" in note for note in listener.notes)
    text = write_derived(out).read_text()
    said = "The reference of ball is in doubt. REFUTED: fake_engines:Brighter"
    assert said in text and text.index(said) < text.index('id="verdicts"')


def test_a_reference_without_a_certificate_is_uncertified_in_the_first_lines(tmp_path):
    sweeping.run(sweeping.write(tmp_path), tmp_path / "out", ["repeats=1"])
    text = write_derived(tmp_path / "out").read_text()
    assert '<a href="#references">ball</a> (12x8)' in text[text.index("Uncertified") : text.index("<table")]
    assert "uncertified: no engine of another lineage has made its image" in text


def test_a_certificate_of_the_references_own_lineage_certifies_nothing(made):
    _, found = made("Apart", spp=8192)
    assert certifies(found)
    own = found.replaced(lineage=found.reference_lineage)
    assert not certifies(own) and "own lineage" in certificate_text(own)


def test_the_command_certifies_and_refuses(tmp_path):
    for name, code, said in (("Other", 0, ": certified by"), ("Brighter", 1, "REFUTED")):
        done = raybench(
            "run", "--only", "references", sweeping.write(tmp_path, certified_by(fake(name))), "--allow-imports", cwd=tmp_path
        )
        assert done.returncode == code and said in done.stdout, done.stdout + done.stderr


def test_a_second_engine_that_crashes_is_one_line_and_the_reference_stays(tmp_path):
    path = sweeping.write(tmp_path, certified_by(fake("Crashing"), spp=8))
    done = raybench("run", "--only", "references", path, "--allow-imports", cwd=tmp_path)
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert "failed: the engine's process was killed by SIGSEGV" in done.stdout and "ball 12x8 8 spp: made" in done.stdout


def test_a_reference_with_bad_samples_is_refused_with_where_and_what(tmp_path):
    text = sweeping.EXPERIMENT.replace("reference: {engine: 'fake_engines:Steady'", "reference: {engine: 'fake_engines:Spotty'")
    outcome, listener = sweeping.run(sweeping.write(tmp_path, text), tmp_path / "out", ["repeats=1"])
    assert outcome.states == {"failed": 2}
    assert (
        "reference of ball by fake_engines:Spotty, seed 9000: 1 samples are NaN or infinite: finite radiance is expected"
        in (listener.notes[0])
    )


def test_a_stored_reference_with_bad_samples_is_refused(made, tmp_path):
    wanted, _ = made("Other", spp=8)
    folder = wanted.folder(tmp_path / "refs")
    meta = store.reference_files.meta_of(folder)
    with np.load(folder / meta.file) as parts:
        np.savez(folder / meta.file, **{**parts, "bad_samples": np.array(2)})
    store.reference_files.write_meta(folder, meta.replaced(sha256=store.reference_files.checksum(folder / meta.file)))
    with pytest.raises(ConfigError, match="2 of this reference's samples are NaN or infinite"):
        store.reference_files.read(folder, wanted.reference_id, wanted.scene_hash)


def test_a_certificate_takes_as_many_pairs_of_images_as_time_allowed(tmp_path, monkeypatch):
    text = certified_by(fake("Brighter"))
    (wanted,) = planner.make(config.load(sweeping.write(tmp_path, text)), True).references.values()
    counts, rng = iter((5, 3)), np.random.default_rng(1)
    monkeypatch.setattr(certificates, "_images", lambda *given: list(rng.uniform(size=(next(counts), 8, 12, 3))))
    event = certificates.make(wanted, tmp_path, None, lambda done, count: None)
    assert event.spp == 3 * wanted.certifier.spp and event.verdict in ("equivalent", "unresolved", "different")


@pytest.mark.parametrize(("spp", "first"), [(256, "stratified(strata=256)"), (128, "random"), (1, "random"), (4**8, "random")])
def test_a_certifier_without_the_reference_s_sampler_takes_whole_patterns(spp, first):
    found = [str(sampler) for sampler in certifiers.samplers(spp)]
    assert found[0] == first and found[-1] == "random"

"""Certificates: an engine that makes the same image certifies a reference, another one does not, and the report says so.

Seeds are fixed; false alarms are set to 0.1 % a scale.
"""

import fake_engines
import pytest

from engines.errors import ConfigError
from harness import config, store
from harness.measure.pool import Pool
from harness.plan import planner
from harness.report import write_derived
from harness.run import certificates, references
from tests.harness import sweeping
from tests.harness.sweeping import raybench


def certified_by(engine, spp=4096):
    asked = f"engine: 'fake_engines:Steady', spp: {spp}, certify: 'fake_engines:{engine}'"
    return sweeping.EXPERIMENT.replace("engine: 'fake_engines:Steady', spp: 64", asked)


@pytest.fixture
def made(tmp_path):
    """(what was wanted, the certificate) of a reference and the engine that is to certify it."""

    def make(engine, spp=4096):
        path = sweeping.write(tmp_path, certified_by(engine, spp))
        (wanted,) = planner.make(config.load(path), True).references.values()
        with Pool(True, tmp_path / "log") as pool:
            references.make(wanted, tmp_path / "refs", pool, lambda done, count: None)
            return wanted, certificates.make(wanted, tmp_path / "refs", pool, lambda done, count: None)

    return make


def test_an_equal_engine_certifies(made):
    _, found = made("Other")
    assert found["verdict"] == "equivalent" and -0.01 < found["low"] <= found["difference"] <= found["high"] < 0.01
    assert found["difference"] != 0, "the second engine draws other random numbers"
    assert found["spp"] == 2048 and certificates.words(found).startswith("certified by fake_engines:Other (2048 spp)")


def test_a_brighter_engine_does_not(made):
    _, found = made("Brighter")
    assert found["verdict"] == "different"
    assert found["difference"] == pytest.approx(fake_engines.Brighter.factor - 1, abs=0.004)
    assert "NOT certified" in certificates.words(found)


def test_few_samples_are_inconclusive(made):
    _, found = made("Other", spp=8)
    assert found["verdict"] == "inconclusive" and "more samples are needed" in certificates.words(found)


def test_an_engine_that_cannot_says_why(made):
    _, found = made("Picky", spp=8)
    assert found["verdict"] == "impossible" and certificates.words(found) == "not certified: it never feels like it"


def test_certifying_changes_no_id_and_a_certificate_is_found_again(made, tmp_path):
    wanted, found = made("Other", spp=64)
    (plain,) = planner.make(config.load(sweeping.write(tmp_path)), True).references.values()
    assert plain.reference_id == wanted.reference_id and plain.certifier is None
    again = certificates.existing(wanted, tmp_path / "refs")
    assert again is not None and again["certificate_id"] == found["certificate_id"]
    certificates.path_of(wanted, tmp_path / "refs").write_text("{")
    with pytest.raises(ConfigError, match="remove it to make it anew"):
        certificates.existing(wanted, tmp_path / "refs")


def test_the_engine_itself_is_no_witness(tmp_path):
    with pytest.raises(ConfigError, match=r"small\.yaml:9.*another engine than the reference's"):
        config.load(sweeping.write(tmp_path, certified_by("Steady")))


def test_a_run_records_it_once_and_the_report_says_it(tmp_path):
    path, out = sweeping.write(tmp_path, certified_by("Brighter")), tmp_path / "results" / "small"
    _, listener = sweeping.run(path, out, ["repeats=1"])
    sweeping.run(path, out, ["repeats=1"])
    (event,) = [e for e in store.read_events(out) if e["event"] == "certificate"]
    assert event["verdict"] == "different" and "machine" not in event
    assert any("NOT certified" in note for note in listener.notes)
    text = write_derived(out).read_text()
    assert "The reference of ball is in doubt. NOT certified: fake_engines:Brighter" in text


def test_the_command_certifies_and_refuses(tmp_path):
    for engine, code, said in (("Other", 0, ": certified by"), ("Brighter", 1, "NOT certified")):
        done = raybench("reference", sweeping.write(tmp_path, certified_by(engine)), "--allow-imports", cwd=tmp_path)
        assert done.returncode == code and said in done.stdout, done.stdout + done.stderr


def test_a_second_engine_that_crashes_is_one_line_and_the_reference_stays(tmp_path):
    path = sweeping.write(tmp_path, certified_by("Crashing", spp=8))
    done = raybench("reference", path, "--allow-imports", cwd=tmp_path)
    assert done.returncode == 1 and "Traceback" not in done.stderr
    assert "failed: the engine's process was killed by SIGSEGV" in done.stdout and "ball 12x8 8 spp: made" in done.stdout

"""Cases of the accuracy suite in an experiment: run in worker processes, stored as events, run once."""

import pytest

from engines.errors import ConfigError
from harness import config, store
from harness.analysis import analyse
from harness.plan import planner
from harness.report.html.assembly import report_html
from harness.report.plots import stability, write_files
from harness.report.tables import all_tables
from harness.store.results import load_results
from tests.harness import sweeping

TEXT = sweeping.EXPERIMENT.replace("['fake_engines:Steady', 'fake_engines:Other']", "['fake_engines:Steady', numpy]")
TEXT = TEXT.replace("repeats: 2", "repeats: 1") + "verify: {cases: [t/radius, leak/scale], quick: true}\n"


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    folder = tmp_path_factory.mktemp("examined")
    path = sweeping.write(folder, TEXT)
    outcome, _ = sweeping.run(path, folder / "out")
    return path, folder / "out", outcome


def events(out):
    return [event for event in store.read_events(out) if event.event == "verify_job"]


def test_every_case_is_asked_of_every_engine_in_every_precision_it_has(finished):
    path, out, outcome = finished
    wanted = planner.make(config.load(path), allow_imports=True).verify_jobs
    asked = {(e.spec["engine"], e.spec["precision"], e.spec["case"]) for e in events(out)}
    assert asked == {(each.spec["engine"], each.spec["precision"], each.spec["case"]) for each in wanted}
    assert {("numpy", "float64", "t/radius"), ("numpy", "float64", "leak/scale")} <= asked
    assert len(events(out)) == len(wanted) == len({each.verify_job_id for each in wanted})
    assert outcome.failed_verify_jobs == [] and {e.state for e in events(out)} == {"done"}


def test_the_numpy_engine_passes(finished):
    found = [f for f in store.check_results(events(finished[1])) if f.engine == "numpy"]
    assert len(found) == 11 + 3 * 7 and {f.outcome for f in found} == {"pass"}
    assert all(f.error < 1e-14 for f in found)


def test_a_second_run_asks_nothing_again_and_another_case_alone(finished):
    path, out, _ = finished
    before, made = (out / store.EVENTS).read_bytes(), len(events(out))
    sweeping.run(path, out)
    assert (out / store.EVENTS).read_bytes() == before
    sweeping.run(path, out, ["verify.cases=[t/radius, leak/scale, self/scale]"])
    added = events(out)[made:]
    assert {event.spec["case"] for event in added} == {"self/scale"}


def test_the_report_draws_them_and_has_their_table(finished, tmp_path, with_plots):
    analysis = analyse(load_results(finished[1]))
    plots = stability.plots(analysis.results.check_results)
    write_files(plots, tmp_path)
    assert [plot.name for plot in plots] == ["stability-of-t", "self-hits-and-leaks"]
    assert {path.name for path in tmp_path.iterdir()} == {"stability-of-t.svg", "self-hits-and-leaks.svg"}
    page = report_html(analysis, all_tables(analysis), plots)
    assert 'id="plot-stability-of-t"' in page and 'id="table-accuracy"' in page


def test_findings_no_longer_asked_for_are_left_out(finished):
    path, out, _ = finished
    sweeping.run(path, out, ["verify.cases=[leak/scale]"])
    assert {finding.case for finding in load_results(out).check_results} == {"leak/scale"}


def test_unknown_cases_are_refused_with_the_nearest(tmp_path):
    path = sweeping.write(tmp_path, TEXT.replace("t/radius", "t/radios"))
    with pytest.raises(ConfigError, match=r"small.yaml:\d+ verify.cases\[0\].*t/radius"):
        config.load(path)

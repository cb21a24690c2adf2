"""Engines that cheat are caught, each by a flag of its own, in a run beside honest ones, which earn none."""

from dataclasses import replace

import cheating_engines
import pytest

from harness import store
from harness.analysis import analyse
from harness.analysis.conduct import conduct_flags
from harness.analysis.model import FLAGS, OF_THE_TIME
from harness.store.records import Machine
from harness.store.results import load_results
from tests.harness import sweeping

HONEST = ("fake_engines:Steady", "fake_engines:Apart")
EXPERIMENT = """\
raybench_experiment: 1
name: cheats
scene: ball.yaml
resolution: [32, 32]
equivalence: {image: 0.05, tile: 0.5}
sampler: random
threads: 1
matrix: {engine: ENGINES}
baseline: steady
budget: {max_time: 20s, max_spp: 8, timeout: 60s}
checkpoints: {ratio: 2, start: 1}
repeats: 3
reference: {engine: 'fake_engines:Steady', spp: 256, seed: 9000, certify: null}
quality: {targets: [1.0, 0.1]}
images: some
remeasure: 0
"""


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """The folder of one run of all."""
    folder = tmp_path_factory.mktemp("cheats")
    cheats = (*cheating_engines.FLAGS, *cheating_engines.REFUSED)
    names = [*HONEST, *(f"cheating_engines:{name}" for name in cheats)]
    path = sweeping.write(folder, EXPERIMENT.replace("ENGINES", str(names)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(cheating_engines.CACHE, str(folder))
        patch.setenv("RAYBENCH_REFERENCES", str(folder / "out" / "references"))
        sweeping.run(path, folder / "out")
    return folder / "out"


@pytest.fixture(scope="module")
def analysis(swept):
    return analyse(load_results(swept))


@pytest.fixture(scope="module")
def verdicts(analysis):
    """Engine and label -> the verdict."""
    settings = [(v.contestant.settings, v) for v in analysis.verdicts]
    return {(each.engine, each.label): verdict for each, verdict in settings}


@pytest.mark.parametrize(("name", "flag"), cheating_engines.FLAGS.items())
def test_a_cheat_is_flagged_by_name_and_not_ranked(analysis, verdicts, name, flag):
    verdict = verdicts[getattr(cheating_engines, name).name, ""]
    assert flag in verdict.flags and FLAGS[flag] in " ".join(verdict.warnings)
    assert (
        flag not in OF_THE_TIME
        and verdict.disqualified
        and not any(analysis.at(verdict.contestant, target).possible_winner for target in analysis.results.targets)
    )


@pytest.mark.parametrize(("name", "words"), cheating_engines.REFUSED.items())
def test_a_cheat_is_refused_by_name(swept, name, words):
    events = store.latest_cells(store.read_events(swept)).values()
    cells = [event for event in events if event.engine == getattr(cheating_engines, name).name]
    assert len(cells) == 3
    assert all(cell.state == "failed" and words in cell.message for cell in cells)


def test_flags_need_no_images_and_blame_nobody_for_what_was_not_recorded(swept):
    """As in archives; the scene without noise has the same image under every seed."""

    def changed(contestant, change, **more):
        cells = [cell.replaced(points=tuple(map(change, cell.points)), **more) for cell in contestant.cells]
        return replace(contestant, cells=tuple(cells))

    def silenced(point):
        return point.replaced(film_variance=None, metrics={**point.metrics, "mse_corrected": point.metrics["mse"]})

    without_images = [changed(c, lambda point: point.replaced(image=None)) for c in load_results(swept).contestants]
    flags = {c.settings.engine: conduct_flags(c, None) for c in without_images}
    wanted = {"reference_copied", "fewer_samples", "ignores_seed", "stale_image", "works_between_calls", "too_many_threads"}
    assert wanted <= {flag for found in flags.values() for flag in found} and not flags["steady"]
    silent = next(c for c in without_images if c.settings.engine == "ignores_seed")
    assert conduct_flags(changed(silent, silenced, machine=Machine()), None) == []


def test_ten_cheats():
    assert len(cheating_engines.FLAGS) + len(cheating_engines.REFUSED) == 10


def test_the_honest_ones_beside_them_earn_no_flag(verdicts):
    honest = [verdicts["steady", ""], verdicts["steady", "A/A"], verdicts["apart", ""]]
    assert [set(verdict.flags) - OF_THE_TIME for verdict in honest] == [set()] * 3

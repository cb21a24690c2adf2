"""A sweep over a cluster: the same images as on one machine, one timed cell a machine at a time, nothing lost with a worker."""

import os
import signal
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import distributed
import numpy as np
import pytest

from engines.errors import ConfigError
from engines.image import read_film_layers
from harness import store
from harness.analysis.frames import open_results
from harness.config.settings import SceneFile
from harness.measure.requests import ReferenceRequest
from tests.harness import sweeping
from tests.harness.shared_references import SETTINGS

TEXT = sweeping.EXPERIMENT.replace("images: none", "images: last").replace(
    "'fake_engines:Other'", "'fake_engines:Phased', 'fake_engines:Broken'"
)
STATES = {"done": 5, "failed": 1}

NOWHERE = ReferenceRequest(SceneFile("nowhere", "nowhere.yaml"), "", SETTINGS, 1)


@pytest.fixture(scope="module")
def machines():
    """A scheduler and two workers, each a process that declares itself a machine; both are on this host."""
    from distributed import LocalCluster

    with LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=":0", resources={"machine": 1}, silence_logs=50
    ) as cluster:
        yield cluster


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """What the same sweep gives on one machine."""
    folder = tmp_path_factory.mktemp("alone")
    outcome, _ = sweeping.run(sweeping.write(folder, TEXT), folder / "out")
    assert outcome.states == STATES
    return folder


def cells(folder):
    return list(store.latest_cells(store.read_events(folder)).values())


def same_images(one, other):
    """Every last image and the reference, bit for bit."""
    found = {event.cell_id: event.points[-1].image for event in cells(one) if event.points}
    for event in (event for event in cells(other) if event.points):
        ours, theirs = (
            read_film_layers(f / image) for f, image in ((other, event.points[-1].image), (one, found[event.cell_id]))
        )
        assert all((a == b).all() or np.isnan(a).all() for a, b in zip(ours, theirs, strict=True))
    (reference,) = {event.reference_id for event in cells(one)}
    ours, theirs = (store.reference_arrays(folder, reference) for folder in (one, other))
    assert (ours.mean == theirs.mean).all() and (ours.half_1 == theirs.half_1).all()


def test_quality_alone_is_spread_over_all_machines_and_the_images_are_the_same(machines, alone, tmp_path):
    path = sweeping.write(tmp_path, TEXT + "timing: false\n")
    outcome, listener = sweeping.run(path, tmp_path / "out", cluster=machines.scheduler_address)
    assert outcome.states == STATES and len(listener.cells) == 6
    assert sweeping.rows(tmp_path / "out") == sweeping.rows(alone / "out")
    same_images(alone / "out", tmp_path / "out")
    found = cells(tmp_path / "out")
    workers = {event.worker for event in found}
    assert len(workers) == 2 and set(open_results(tmp_path / "out").cells["worker"]) == workers
    assert all(event.machine.contended for event in found), "they ran beside each other"
    (failed,) = [event for event in found if event.state == "failed"]
    assert failed.message == "ValueError: the tree fell over and more"
    assert "the tree fell over" in (tmp_path / "out" / "worker.log").read_text()
    environments = [e.env_id for e in store.read_events(tmp_path / "out") if e.event == "environment"]
    assert len(environments) == len(set(environments)) and {e.env_id for e in found} <= set(environments)


def test_timed_cells_run_in_order_one_at_a_time_on_a_host(machines, alone, tmp_path):
    path = sweeping.write(tmp_path, TEXT)
    outcome, _ = sweeping.run(path, tmp_path / "out", cluster=machines.scheduler_address)
    assert outcome.states == STATES
    found = cells(tmp_path / "out")
    assert len({event.worker for event in found}) == 1, "both workers are on this host: one is enough for it"
    assert [event.order for event in found] == [0, 1, 2, 3, 4, 5]
    events = [event.event for event in store.read_events(tmp_path / "out") if event.event in ("start", "cell")]
    assert events == ["start", "cell"] * 6
    assert sweeping.rows(tmp_path / "out") == sweeping.rows(alone / "out")
    again, _ = sweeping.run(path, tmp_path / "out", cluster=machines.scheduler_address)
    assert again.measured == 0, "resuming is the same as on one machine"


@pytest.mark.parametrize("timing", ["false", "true"])
def test_a_worker_that_is_killed_in_mid_cell_loses_nothing(machines, alone, tmp_path, timing):
    path, out, killed = (
        sweeping.write(tmp_path, TEXT.replace("repeats: 2", "repeats: 1") + f"timing: {timing}\n"),
        tmp_path / "out",
        [],
    )

    def kill():
        """The first worker seen at a cell, a moment into it."""
        with distributed.Client(machines.scheduler_address, set_as_default=False) as client:
            deadline = time.monotonic() + 300
            while not killed and time.monotonic() < deadline:
                busy = [w for w, keys in client.processing().items() if any("measure_cell" in str(k) for k in keys)]
                if busy:
                    pid = client.run(os.getpid, workers=busy[:1])[busy[0]]
                    os.kill(pid, signal.SIGKILL)
                    killed.append(busy[0])
                time.sleep(0.02)

    killer = threading.Thread(target=kill)
    killer.start()
    outcome, listener = sweeping.run(path, out, cluster=machines.scheduler_address)
    killer.join()
    assert killed and any("is gone" in note for note in listener.notes)
    assert outcome.states == {"done": 3}
    assert sweeping.rows(out).items() <= sweeping.rows(alone / "out").items()
    same_images(alone / "out", out)
    done = [event.cell_id for event in store.read_events(out) if event.event == "cell"]
    assert len(done) == len(set(done)) == 3


@pytest.mark.parametrize("what", ["measure_cell", "render_replicates"])
def test_what_a_machine_dies_of_or_fails_at_is_tried_again(machines, tmp_path, monkeypatch, what):
    """The first try kills its worker, the second raises an error, the third answers."""
    from harness.run.executors import dask

    tries = tmp_path / "tries"

    def third_time_lucky(*_):
        with tries.open("a") as file:
            file.write("x")
        number = len(tries.read_text())
        if number == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        if number == 2:
            raise OSError("No space left on device")
        return ["film"]

    monkeypatch.setattr(dask, what, third_time_lucky)
    request = NOWHERE
    cell = SimpleNamespace(engine="numpy", budget=SimpleNamespace(timeout_seconds=60))
    with dask.Cluster(machines.scheduler_address, False, Path()) as ours:
        if what == "measure_cell":
            assert ours.submit(cell, request, None, 1.0).result() == ["film"]
        else:
            assert list(ours.replicates("numpy", request, [1])) == ["film"]
    assert tries.read_text() == "xxx"


def test_a_cluster_that_is_not_there_is_one_message(tmp_path, monkeypatch):
    from harness.run.executors import dask

    monkeypatch.setattr(dask, "CONNECT_SECONDS", 0.5)
    with pytest.raises(ConfigError, match=r"--cluster tcp://127.0.0.1:9: no scheduler answers there"):
        sweeping.run(sweeping.write(tmp_path), tmp_path / "out", cluster="tcp://127.0.0.1:9")
    with pytest.raises(ConfigError, match=r"--cluster nowhere: the address of a scheduler is expected, as tcp://host:8786"):
        dask.connected("nowhere")


def test_workers_that_are_no_machines_are_refused(tmp_path):
    from distributed import LocalCluster

    with (
        LocalCluster(n_workers=1, processes=False, dashboard_address=":0") as cluster,
        pytest.raises(ConfigError, match="--resources machine=1"),
    ):
        sweeping.run(sweeping.write(tmp_path), tmp_path / "out", cluster=cluster.scheduler_address)


def test_a_cluster_that_loses_all_its_machines_is_given_up(tmp_path, monkeypatch):
    """What is under way then is not waited for without end."""
    from distributed import LocalCluster

    from harness.run.executors import dask

    monkeypatch.setattr(dask, "PATIENCE_SECONDS", 0.2)
    monkeypatch.setattr(dask, "LOOK_SECONDS", 0.1)
    one = {"n_workers": 1, "threads_per_worker": 1, "processes": False, "dashboard_address": ":0"}
    with (
        LocalCluster(**one, resources={"machine": 1}) as machines,
        dask.Cluster(machines.scheduler_address, True, Path()) as ours,
    ):
        machines.scale(0)
        deadline = time.monotonic() + 300
        while ours.machines() and time.monotonic() < deadline:
            time.sleep(0.05)
        with pytest.raises(ConfigError, match="no machine for"):
            list(ours.replicates("fake_engines:Steady", NOWHERE, [1, 2]))


def test_contended_cells_are_measured_again_where_they_were_measured(machines, tmp_path, monkeypatch):
    """The second of four cells is contended, and its first repetition, too."""
    from harness.run.recorder import Recorder

    marks, measured_as = iter("010010"), Recorder.measured_as

    def judged(self, record, messages):
        event = measured_as(self, record, messages)
        return event.replaced(machine=event.machine.replaced(contended=next(marks) == "1"))

    monkeypatch.setattr(Recorder, "measured_as", judged)
    path, out = sweeping.write(tmp_path, sweeping.EXPERIMENT.replace("remeasure: 0", "remeasure: 2")), tmp_path / "out"
    outcome, _ = sweeping.run(path, out, cluster=machines.scheduler_address)
    assert outcome.states == {"done": 4} and outcome.measured == 6
    found = sorted(cells(out), key=lambda event: event.order)
    assert [(event.attempt, event.machine.contended) for event in found] == [(1, 0), (3, 0), (1, 0), (1, 0)]
    again = [event for event in store.read_events(out) if event.event in ("cell", "attempt") and event.order == 1]
    assert [(event.event, event.attempt) for event in again] == [("cell", 1), ("attempt", 2), ("cell", 3)]
    assert len({event.worker for event in again}) == 1
    assert sweeping.run(path, out, cluster=machines.scheduler_address)[0].measured == 0


def test_a_cell_whose_machine_is_gone_is_not_measured_again():
    """Of two workers on a host either may; where the one that measured it is gone, the cell stays as it is."""
    from types import SimpleNamespace

    from harness.run.executors.dask import Blocks

    homes = {"0": "tcp://a:1", "1": "tcp://gone:1", "2": "tcp://b:1"}
    machines = {"tcp://a:1": {"host": "a"}, "tcp://a:9": {"host": "a"}, "tcp://b:1": {"host": "b"}}
    recorder = SimpleNamespace(
        stopped=False,
        listener=SimpleNamespace(note=print),
        plan=SimpleNamespace(experiment=SimpleNamespace(timing=True)),
        latest={cell_id: SimpleNamespace(worker=home) for cell_id, home in homes.items()},
    )
    given = [SimpleNamespace(cell_id=cell_id, block=0) for cell_id in homes]
    blocks = Blocks(recorder, SimpleNamespace(present=lambda: machines), given, again=True)
    started = []
    blocks._start = lambda cells, address: started.append((cells[0].cell_id, address))
    blocks._look()
    blocks._feed()
    assert sorted(started) == [("0", "tcp://a:9"), ("2", "tcp://b:1")] and not blocks.waiting


def test_a_host_gets_one_block_at_a_time_and_a_lost_machine_gives_its_block_back():
    """A host of two workers, another of one; then the worker at a block is gone."""
    from harness.run.executors.dask import MOST_LOSSES, Blocks

    class Pending:
        def done(self):
            return False

        def cancel(self): ...

    cells = [[SimpleNamespace(cell_id=f"{block}-{k}", block=block) for k in range(2)] for block in range(3)]
    machines = {"tcp://a:1": {"host": "a"}, "tcp://a:9": {"host": "a"}, "tcp://b:1": {"host": "b"}}
    notes, failed = [], []
    recorder = SimpleNamespace(
        stopped=False,
        listener=SimpleNamespace(note=notes.append),
        plan=SimpleNamespace(experiment=SimpleNamespace(timing=True)),
    )
    cluster = SimpleNamespace(present=lambda: dict(machines))
    blocks = Blocks(recorder, cluster, [cell for block in cells for cell in block])
    started = []

    def start(given, address):
        started.append((given[0].cell_id, address))
        made = Pending()
        blocks.tasks[made] = SimpleNamespace(cell=given[0], rest=given[1:], address=address, attempt=1)
        return made

    blocks._start, blocks._failed = start, lambda cell, message, attempt: failed.append((cell.cell_id, message))
    blocks._look()
    blocks._feed()
    blocks._feed()
    assert started == [("0-0", "tcp://a:9"), ("1-0", "tcp://b:1")], "one block a host"
    for _ in range(MOST_LOSSES):
        gone = next(task.address for task in blocks.tasks.values() if task.cell.block == 0)
        info = machines.pop(gone)
        blocks._look()
        assert notes[-1].startswith(f"{gone} is gone")
        blocks._feed()
        machines[gone] = info
        blocks._look()
        blocks._feed()
    assert [cell for cell, _ in failed] == ["0-0"] and f"{MOST_LOSSES} machines were lost" in failed[0][1]
    assert [each for each in started if each[0] == "0-1"], "the rest of its block is measured"


def test_the_block_of_a_lost_machine_is_measured_anew_by_one_machine():
    """The first of three cells has arrived when the machine goes."""
    from harness.run.executors.dask import Blocks, Task

    class Pending:
        status = "pending"

        def done(self):
            return self.status == "finished"

        def cancel(self): ...

    machines = {"tcp://a:1": {"host": "a"}, "tcp://b:1": {"host": "b"}}
    recorder = SimpleNamespace(
        stopped=False, listener=SimpleNamespace(note=print), plan=SimpleNamespace(experiment=SimpleNamespace(timing=True))
    )
    cells = [SimpleNamespace(cell_id=f"{k}", block=0) for k in range(3)]
    blocks = Blocks(recorder, SimpleNamespace(present=lambda: dict(machines)), cells)
    started = []

    def start(given, address):
        started.append((given[0].cell_id, address))
        made = Pending()
        blocks.tasks[made] = Task(given[0], list(given[1:]), address, 1)
        return made

    def record(task, result):
        del blocks.left[task.cell.cell_id]

    blocks._start, blocks._record = start, record
    Pending.result = lambda self: None
    blocks._look()
    (first,) = blocks._feed()
    first.status = "finished"
    blocks._finish(first)
    (home,) = {address for _, address in started}
    del machines[home]
    blocks._look()
    (again,) = blocks._feed()
    while again:
        again.status = "finished"
        again = next(iter(blocks._finish(again)), None)
    (other,) = machines
    assert started == [("0", home), ("1", home), ("0", other), ("1", other), ("2", other)] and not blocks.left

"""A sweep over several machines: Dask carries requests to them and films back, this process keeps events and references.

Every machine runs one Dask worker that declares itself, on a checkout or an installation of the same raybench:

    dask scheduler
    dask worker ADDRESS --nworkers 1 --nthreads 8 --resources machine=1

A timed cell takes a machine for itself, and the cells of a block, which are compared with one another, go to one machine
after the other in their order. Cells of an experiment with `timing: false`, and replicates of references, go to any that
has a place for them. Scenes are read from the same path there, or by bare name from the scenes of that installation.

Nothing is written on the machines. A cell is recorded when all of it has arrived; one whose machine dies is given to
another, and has failed when that has happened three times. Events carry the environment id of where they were measured.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from threading import Event
from time import monotonic
from typing import TYPE_CHECKING, Any

from engines.errors import ConfigError
from engines.temporary import TemporaryFolder
from harness.config import paths
from harness.hashing import digest
from harness.measure import machine, memory
from harness.measure.pool import Pool, WorkerFailed, WorkerMessage, WorkerTimeout
from harness.measure.sentinel import sentinel_seconds
from harness.plan.cells import Cell
from harness.plan.state import expected_seconds
from harness.run.recorder import CellRecord, Recorder

if TYPE_CHECKING:
    from distributed import Client, Future

    from engines.film import Film

RESOURCE = "machine"
CONNECT_SECONDS = 10.0
LOOK_SECONDS = 0.5
"""How often the list of machines is looked at while they work."""
PATIENCE_SECONDS = 60.0
"""How long a cluster may be without any machine before the run gives up."""
MOST_LOSSES = 3
LOG_BYTES = 1 << 16


# --- on the machines ------------------------------------------------------------------------------------------------


@dataclass(slots=True)
class CellResult:
    """What a machine sends back of a cell: its worker's messages with the films, and how it ended."""

    environment: Mapping[str, Any]
    sentinel: float = 0.0
    block_sentinel: float = 0.0
    messages: list[WorkerMessage] = field(default_factory=list)
    error: Exception | None = None
    wall_seconds: float = 0.0
    log: bytes = b""

    def again(self) -> Iterator[WorkerMessage]:
        """The messages, and the failure at their end."""
        yield from self.messages
        if self.error is not None:
            raise self.error


def measure_cell(
    engine: str, request: dict[str, Any], timeout: float, allow_imports: bool, first: bool, most_bytes: int | None,
    share: float,
) -> CellResult:  # fmt: skip
    """Measures a cell on the machine that runs this. `first` of a block takes the sentinel's median, too.

    Without a limit of memory, `most_bytes`, it gets that `share` of the machine's which its place has.
    """
    result = CellResult(machine.environment())
    if first:
        result.block_sentinel = median(sentinel_seconds() for _ in range(3))
    began, result.sentinel = monotonic(), sentinel_seconds()
    with TemporaryFolder() as folder:
        log = Path(folder) / "worker.log"
        with Pool(allow_imports, log, most_bytes or memory.default_limit(share)) as pool:
            try:
                for message in pool.cell(engine, request, timeout):
                    result.messages.append(message)
            except (WorkerFailed, WorkerTimeout) as error:
                result.error = error
        result.log = log.read_bytes()[-LOG_BYTES:] if log.exists() else b""
    result.wall_seconds = monotonic() - began
    return result


def render_replicates(
    engine: str, request: dict[str, Any], seeds: list[int], allow_imports: bool, most_bytes: int | None
) -> list[tuple[Film, float]] | str:
    """Replicates of a reference, on all cores of the machine that runs this; a sentence where the engine failed."""
    request = {**request, "settings": {**request["settings"], "threads": len(machine.usable_cores())}}
    with TemporaryFolder() as folder, Pool(allow_imports, Path(folder) / "log", most_bytes) as pool:
        try:
            return list(pool.replicates(engine, request, seeds))
        except WorkerFailed as error:
            return str(error)


# --- here -----------------------------------------------------------------------------------------------------------


@dataclass(slots=True)
class Task:
    """A cell under way on a machine."""

    cell: Cell
    address: str
    future: Future


class Cluster:
    """The machines behind a scheduler's address."""

    def __init__(self, address: str, allow_imports: bool, most_bytes: int | None = None) -> None:
        """`most_bytes` of memory are allowed to a cell's processes; None: a share of its machine's."""
        self._allow_imports, self._most_bytes = allow_imports, most_bytes
        self.client = connected(address)
        self._replicates: list[Future] = []
        self._alone_since: float | None = None

    def __enter__(self) -> Cluster:
        try:
            if not self.machines():
                raise ConfigError(
                    f"{self.client.scheduler_info()['address']}: no worker declares itself a machine: "
                    f"dask worker ADDRESS --nworkers 1 --resources {RESOURCE}=1"
                )
        except ConfigError:
            self.client.close()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.client.cancel(self._replicates)
        self.client.close()

    def present(self) -> dict[str, Mapping[str, Any]]:
        """The machines; raises `ConfigError` when there has been none for a while."""
        machines = self.machines()
        self._alone_since = None if machines else self._alone_since or monotonic()
        if self._alone_since is not None and monotonic() - self._alone_since > PATIENCE_SECONDS:
            raise ConfigError(f"--cluster: no machine for {PATIENCE_SECONDS:g} s; what was measured is kept")
        return machines

    def machines(self) -> dict[str, Mapping[str, Any]]:
        """What the scheduler knows of each worker that is a machine, by address."""
        try:
            workers = self.client.scheduler_info(n_workers=-1)["workers"]
        except OSError as error:
            raise ConfigError(f"--cluster: the scheduler is gone: {error}; what was measured is kept") from error
        return {address: info for address, info in workers.items() if info["resources"].get(RESOURCE, 0) >= 1}

    def replicates(self, engine: str, request: Mapping[str, Any], seeds: Sequence[int]) -> Iterator[tuple[Film, float]]:
        """Films in the order of their seeds, whatever the order in which machines deliver them."""
        size = max(1, min(8, -(-len(seeds) // max(1, len(self.machines())))))
        parts = [list(seeds[first : first + size]) for first in range(0, len(seeds), size)]
        self._replicates = [
            self.client.submit(
                render_replicates, engine, _there(request), part, self._allow_imports, self._most_bytes,
                resources={RESOURCE: 1}, retries=MOST_LOSSES, pure=False,
            )
            for part in parts
        ]  # fmt: skip
        for future in self._replicates:
            while not future.done():
                self.present()
                _wait_for(future)
            found = _result(future)
            if isinstance(found, str):
                raise WorkerFailed(found)
            yield from found

    def measure(self, recorder: Recorder) -> None:
        """Measures what a run has left to do."""
        Blocks(recorder, self).run()

    def submit(self, cell: Cell, request: Mapping[str, Any], address: str, share: float, first: bool) -> Task:
        """Gives a cell to a machine."""
        future = self.client.submit(
            measure_cell, cell.engine, _there(request), cell.budget.timeout_seconds, self._allow_imports, first,
            self._most_bytes, share, workers=[address], resources={RESOURCE: share}, pure=False, retries=0,
        )  # fmt: skip
        return Task(cell, address, future)


def _there(request: Mapping[str, Any]) -> dict[str, Any]:
    """A request as another machine understands it: shipped scenes by name. The scene's hash is checked there."""
    names = {str(path.resolve()): name for name, path in paths.shipped("scenes").items()}
    return {**request, "scene_path": names.get(request["scene_path"], request["scene_path"])}


def connected(address: str) -> Client:
    """A client of the scheduler; raises `ConfigError` where the package or the scheduler is missing."""
    try:
        from distributed import Client
    except ImportError as error:
        raise ConfigError("--cluster needs the package distributed: pip install 'raybench[cluster]'") from error
    try:
        return Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ConfigError(f"--cluster {address}: no scheduler answers there: {error}") from error


def _wait_for(future: Future) -> None:
    """Until the future is done, or it is time to look at the machines again."""
    news = Event()
    future.add_done_callback(lambda _: news.set())
    news.wait(LOOK_SECONDS)


def _result(future: Future) -> Any:
    """A future's result; what Dask itself reports becomes a `WorkerFailed`."""
    try:
        return future.result()
    except Exception as error:
        raise WorkerFailed(f"on the cluster: {type(error).__name__}: {' '.join(str(error).split())}") from error


class Blocks:
    """The cells of a sweep on their way through a cluster."""

    def __init__(self, recorder: Recorder, cluster: Cluster) -> None:
        self.recorder, self.cluster = recorder, cluster
        self.timed = recorder.plan.experiment.timing
        self.todo = recorder.ready()
        self.waiting = deque(_by_block(self.todo) if self.timed else [[cell] for cell in self.todo])
        self.queues: dict[str, deque[Cell]] = {}
        """What is left of the block that a machine is at."""
        self.running: list[Task] = []
        self.losses: dict[str, int] = {}
        self.begun: set[tuple[str, int]] = set()
        """(machine, block) whose sentinel is known."""
        self.news = Event()
        """Set when a cell has come back."""
        self.left = {cell.cell_id: cell for cell in self.todo}

    def run(self) -> None:
        """Until every cell has an event, or the run is to stop."""
        try:
            while self.waiting or self.running or any(self.queues.values()):
                machines = self.cluster.present()
                self._forget(machines)
                if not self.recorder.stopped:
                    for address, info in self._usable(machines).items():
                        self._feed(address, info)
                elif not self.running:
                    return
                self.news.wait(LOOK_SECONDS)
                self.news.clear()
                for task in [task for task in self.running if task.future.done()]:
                    self._finish(task)
        finally:
            self.cluster.client.cancel([task.future for task in self.running])

    def _usable(self, machines: Mapping[str, Mapping[str, Any]]) -> dict[str, Mapping[str, Any]]:
        """All of them, or where time counts one a host: two workers on a host would disturb each other."""
        if not self.timed:
            return dict(machines)
        at_work = {task.address for task in self.running} | {address for address, rest in self.queues.items() if rest}
        one: dict[str, str] = {}
        for address in sorted(machines, key=lambda address: (address not in at_work, address)):
            one.setdefault(machines[address]["host"], address)
        return {address: machines[address] for address in one.values()}

    def _feed(self, address: str, info: Mapping[str, Any]) -> None:
        """Gives a machine as many cells as it has places for: one where time counts."""
        while True:
            queue = self.queues.setdefault(address, deque())
            if not queue and self.waiting:
                queue.extend(self.waiting.popleft())
            if not queue:
                return
            threads = max(1, queue[0].settings["threads"])
            places = 1 if self.timed else max(1, info["nthreads"] // threads)
            if sum(task.address == address for task in self.running) >= places:
                return
            self._start(queue.popleft(), address, 1.0 / places)

    def _start(self, cell: Cell, address: str, share: float) -> None:
        recorder = self.recorder
        recorder.begin(cell)
        first = self.timed and (address, cell.block) not in self.begun
        self.begun.add((address, cell.block))
        request = cell.request(recorder.plan.experiment.checkpoints)
        task = self.cluster.submit(cell, request, address, share, first)
        task.future.add_done_callback(lambda _: self.news.set())
        self.running.append(task)

    def _forget(self, machines: Mapping[str, Any]) -> None:
        """Takes back what machines that are gone had: their cells go to others, the one under way too."""
        for task in [task for task in self.running if task.address not in machines and not task.future.done()]:
            self.running.remove(task)
            task.future.cancel()
            self._lost(task)
        for address in [address for address in self.queues if address not in machines]:
            rest = self.queues.pop(address)
            if rest:
                self.waiting.appendleft(list(rest))

    def _lost(self, task: Task) -> None:
        cell = task.cell
        self.losses[cell.cell_id] = self.losses.get(cell.cell_id, 0) + 1
        if self.losses[cell.cell_id] >= MOST_LOSSES:
            message = f"{MOST_LOSSES} machines were lost while they measured this cell"
            self._failed(cell, message)
            return
        self.recorder.listener.note(f"{task.address} is gone: its cell is measured elsewhere")
        self.begun.discard((task.address, cell.block))
        queue = self.queues.get(task.address)
        if queue is None:
            self.waiting.appendleft([cell])
        else:
            queue.appendleft(cell)

    def _failed(self, cell: Cell, message: str) -> None:
        del self.left[cell.cell_id]
        self.recorder.finish(cell, self.recorder.event(cell, "failed", message))

    def _finish(self, task: Task) -> None:
        """Records the result of a cell that a machine has sent."""
        recorder, cell = self.recorder, task.cell
        self.running.remove(task)
        try:
            result: CellResult = _result(task.future)
        except WorkerFailed as error:
            if task.future.status == "cancelled" or "KilledWorker" in str(error):
                self._lost(task)
            else:
                self._failed(cell, str(error))
            return
        env_id = digest(result.environment)
        recorder.record_environment(env_id, result.environment)
        if result.block_sentinel:
            recorder.append({
                "event": "sentinel", "block": cell.block, "seconds": result.block_sentinel, "env_id": env_id,
            })  # fmt: skip
        if result.log:
            with (recorder.folder / "worker.log").open("ab") as file:
                file.write(result.log)
        recorder.listener.cell(cell, len(self.todo) - len(self.left), len(self.todo), self._seconds_left())
        del self.left[cell.cell_id]
        event = recorder.measured_as(CellRecord(recorder, cell, env_id), result.again(), result.sentinel)
        if not self.timed:
            event["machine"] = {**event["machine"], "contended": True}
        recorder.finish(cell, {**event, "wall_seconds": result.wall_seconds, "worker": task.address})

    def _seconds_left(self) -> float:
        seconds = sum(seconds for seconds, _ in expected_seconds(self.left.values(), self.recorder.latest).values())
        return seconds / max(1, len({task.address for task in self.running}))


def _by_block(cells: Sequence[Cell]) -> list[list[Cell]]:
    found: dict[int, list[Cell]] = {}
    for cell in cells:
        found.setdefault(cell.block, []).append(cell)
    return list(found.values())

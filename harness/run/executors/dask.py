"""A sweep over several machines: Dask carries requests to them and films back, this process keeps events and references.

Every machine runs one Dask worker that declares itself, on a checkout or an installation of the same raybench:

    dask scheduler
    dask worker ADDRESS --nworkers 1 --nthreads 8 --resources machine=1

A timed cell takes a machine for itself, and the cells of a block, which are compared with one another, go to one machine
after the other in their order. Cells of an experiment with `timing: false`, and replicates of references, go to any that
has a place for them; places are counted on the machine with the fewest threads. Scenes are read from the same path there,
or by bare name from the scenes of that installation; so is code that an experiment names, beside it.

Nothing is written on the machines. A cell is recorded when all of it has arrived. One whose machine dies is given to
another: by Dask where any machine may have it, here with all of its block where that is measured on one. Events carry the
environment id of where they were measured.
"""

from __future__ import annotations

import re
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any

from engines.errors import ConfigError
from engines.packages import install_extra
from engines.temporary import TemporaryFolder
from harness.config import paths
from harness.hashing import digest
from harness.measure import machine, memory
from harness.measure.pool import Pool, WorkerFailed, WorkerMessage, WorkerTimeout
from harness.measure.requests import CellRequest, ReferenceRequest, Request
from harness.plan.cells import Cell
from harness.plan.state import expected_seconds
from harness.run.recorder import CellRecord, Recorder

if TYPE_CHECKING:
    from distributed import Client, Future, as_completed

    from engines.film import Film

RESOURCE = "machine"
CONNECT_SECONDS = 10.0
LOOK_SECONDS = 5.0
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
    address: str
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
    engine: str, request: CellRequest, timeout: float, allow_imports: bool, most_bytes: int | None, code: Path, share: float
) -> CellResult:
    """Measures a cell on the machine that runs this.

    Without a limit of memory, `most_bytes`, it gets that `share` of the machine's which its place has.
    """
    from distributed import get_worker

    result = CellResult(machine.environment(), get_worker().address)
    began = monotonic()
    with TemporaryFolder() as folder:
        log = Path(folder) / "worker.log"
        with Pool(allow_imports, log, most_bytes or memory.default_limit(share), code) as pool:
            try:
                for message in pool.cell(engine, request, timeout):
                    result.messages.append(message)
            except (WorkerFailed, WorkerTimeout) as error:
                result.error = error
        result.log = log.read_bytes()[-LOG_BYTES:] if log.exists() else b""
    result.wall_seconds = monotonic() - began
    return result


def render_replicates(
    engine: str, request: ReferenceRequest, seeds: list[int], allow_imports: bool, most_bytes: int | None, code: Path
) -> list[tuple[Film, float]] | str:
    """Replicates of a reference, on all cores of the machine that runs this; a sentence where the engine failed."""
    request = request._replace(settings=replace(request.settings, threads=len(machine.usable_cores())))
    with TemporaryFolder() as folder, Pool(allow_imports, Path(folder) / "log", most_bytes, code) as pool:
        try:
            return list(pool.replicates(engine, request, seeds))
        except WorkerFailed as error:
            return str(error)


# --- here -----------------------------------------------------------------------------------------------------------


@dataclass(slots=True)
class Task:
    """A cell under way, the cells that follow it on the same machine, and that machine; None: any."""

    cell: Cell
    rest: list[Cell]
    address: str | None
    attempt: int


class Cluster:
    """The machines behind a scheduler's address."""

    def __init__(self, address: str, allow_imports: bool, code: Path, most_bytes: int | None = None) -> None:
        """`most_bytes` of memory are allowed to a cell's processes; None: a share of its machine's. `code` is the folder, here
        and there, where code that files name is looked for first."""
        self._allow_imports, self._code, self._most_bytes = allow_imports, code, most_bytes
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

    def replicates(self, engine: str, request: ReferenceRequest, seeds: Sequence[int]) -> Iterator[tuple[Film, float]]:
        """Films in the order of their seeds, whatever the order in which machines deliver them."""
        size = max(1, min(8, -(-len(seeds) // max(1, len(self.machines())))))
        parts = [list(seeds[first : first + size]) for first in range(0, len(seeds), size)]
        self._replicates = [
            self.client.submit(
                render_replicates,
                engine,
                _there(request),
                part,
                self._allow_imports,
                self._most_bytes,
                self._code,
                resources={RESOURCE: 1},
                retries=MOST_LOSSES,
                pure=False,
            )
            for part in parts
        ]
        for future in self._replicates:
            while not future.done():
                self.present()
                with suppress(TimeoutError):
                    next(self.as_completed([future]))
            found = _result(future)
            if isinstance(found, str):
                raise WorkerFailed(found)
            yield from found

    def measure(self, recorder: Recorder) -> None:
        """Measures what a run has left to do, and contended cells again."""
        Blocks(recorder, self, recorder.ready()).run()
        known = {*self.machines()}
        for cells in recorder.contended_again(lambda event: event.worker in known):
            Blocks(recorder, self, cells, again=True).run()

    def submit(self, cell: Cell, request: CellRequest, address: str | None, share: float) -> Future:
        """Gives a cell to a machine, or with that share of it to any."""
        return self.client.submit(
            measure_cell,
            cell.engine,
            _there(request),
            cell.budget.timeout_seconds,
            self._allow_imports,
            self._most_bytes,
            self._code,
            share,
            workers=[address] if address else None,
            resources={RESOURCE: share},
            pure=False,
            retries=MOST_LOSSES,
        )

    def as_completed(self, futures: Sequence[Future]) -> as_completed:
        """The futures as they finish. Raises `TimeoutError` when it is time to look at the machines again."""
        from distributed import as_completed

        return as_completed(futures, loop=self.client.loop, timeout=LOOK_SECONDS)


def _there(request: Request) -> Request:
    """A request as another machine understands it: shipped scenes by name. The scene's hash is checked there."""
    names = {str(path.resolve()): name for name, path in paths.shipped("scenes").items()}
    path = request.scene.path
    return request._replace(scene=replace(request.scene, path=names.get(path, path)))


def connected(address: str) -> Client:
    """A client of the scheduler; raises `ConfigError` where the package or the scheduler is missing."""
    try:
        from distributed import Client
    except ImportError as error:
        raise ConfigError(f"--cluster needs the package distributed: {install_extra('cluster')}") from error
    if "://" not in address and not re.search(":[0-9]+$", address):  # Dask's client raises once more when it is deleted
        raise ConfigError(f"--cluster {address}: the address of a scheduler is expected, as tcp://host:8786")
    try:
        return Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ConfigError(f"--cluster {address}: no scheduler answers there: {error}") from error


def _result(future: Future) -> Any:
    """A future's result; what Dask itself reports becomes a `WorkerFailed`."""
    try:
        return future.result()
    except Exception as error:
        raise WorkerFailed(f"on the cluster: {type(error).__name__}: {' '.join(str(error).split())}") from error


class Blocks:
    """Cells of a sweep on their way through a cluster. Those that are measured `again` go to the machine that measured them,
    or stay as they are where it is gone."""

    def __init__(self, recorder: Recorder, cluster: Cluster, cells: Iterable[Cell], again: bool = False) -> None:
        self.recorder, self.cluster, self.again = recorder, cluster, again
        self.timed = recorder.plan.experiment.timing
        self.left = {cell.cell_id: cell for cell in cells}
        self.total = len(self.left)
        self.waiting = deque(self._together(self.left.values()) if self.timed else [[cell] for cell in self.left.values()])
        self.machines: Mapping[str, Mapping[str, Any]] = {}
        self.tasks: dict[Future, Task] = {}
        self.losses: Counter[str] = Counter()
        self.done: dict[int, list[Cell]] = {}
        """Of every block that is timed here, the cells that its machine has measured."""

    def _together(self, cells: Iterable[Cell]) -> list[list[Cell]]:
        """Cells that one machine measures one after the other: those of a block, and of one machine where it matters."""
        found: dict[tuple[int, str | None], list[Cell]] = {}
        for cell in cells:
            found.setdefault((cell.block, self._home(cell)), []).append(cell)
        return list(found.values())

    def _home(self, cell: Cell) -> str | None:
        """The machine that must measure a cell; None: any."""
        return self.recorder.latest[cell.cell_id].worker if self.again else None

    def run(self) -> None:
        """Until every cell has an event; where the run is to stop, until those under way have one."""
        try:
            while self.tasks or (self.waiting and not self.recorder.stopped):
                self._look()
                futures = [*self.tasks, *self._feed()]
                if not futures:
                    sleep(LOOK_SECONDS)
                finished = self.cluster.as_completed(futures)
                with suppress(TimeoutError):
                    for future in finished:
                        self._look()
                        if future in self.tasks:  # else it was cancelled, for its machine is gone
                            finished.update([*self._finish(future), *self._feed()])
        finally:
            self.cluster.client.cancel(list(self.tasks))

    def _look(self) -> None:
        """Sees which machines there are, and takes back the cells that only a machine that is gone was to measure."""
        before, self.machines = self.machines, self.cluster.present()
        for address in before.keys() - self.machines.keys():
            self.recorder.listener.note(f"{address} is gone: its cells are measured elsewhere")
        for future, task in list(self.tasks.items()):
            if task.address is not None and task.address not in self.machines and not future.done():
                future.cancel()
                self._lost(self.tasks.pop(future))
        if self.again:
            self.waiting = deque(cells for cells in self.waiting if self._home(cells[0]) in self.machines)

    def _lost(self, task: Task) -> None:
        self.losses[task.cell.cell_id] += 1
        cells = self.done.pop(task.cell.block, [])  # another machine measures all of the block
        self.left |= {cell.cell_id: cell for cell in cells}
        if self.losses[task.cell.cell_id] >= MOST_LOSSES:
            message = f"{MOST_LOSSES} machines were lost while they measured this cell"
            self._failed(task.cell, message, task.attempt)
        else:
            cells.append(task.cell)
        cells += task.rest
        if cells:
            self.waiting.appendleft(cells)

    def _feed(self) -> list[Future]:
        """Starts what may start now, and returns it.

        Timed: one block on every host that has none, for two workers on a host would disturb each other. Else as many cells
        as the machines have threads; Dask finds their places.
        """
        if self.timed:
            used = {task.address for task in self.tasks.values()}
            busy = {info["host"] for address, info in self.machines.items() if address in used}
            places = list({i["host"]: address for address, i in self.machines.items() if i["host"] not in busy}.values())
        else:
            places = [None] * (sum(info["nthreads"] for info in self.machines.values()) - len(self.tasks))
        if self.recorder.stopped:
            return []
        found = [(address, self._next(address)) for address in places]
        return [self._start(cells, address) for address, cells in found if cells]

    def _next(self, address: str | None) -> list[Cell]:
        """Takes the first waiting cells that the machine, or another worker on its host, may measure; none without any."""
        for cells in self.waiting:
            home = self._home(cells[0])
            if home is None or (address and self.machines[address]["host"] == self.machines[home]["host"]):
                self.waiting.remove(cells)
                return cells
        return []

    def _start(self, cells: Sequence[Cell], address: str | None) -> Future:
        cell, *rest = cells
        attempt = self.recorder.next_attempt(cell) if self.again else 1
        self.recorder.begin(cell, attempt)
        fewest = min((info["nthreads"] for info in self.machines.values()), default=1)
        share = 1.0 if self.timed else 1.0 / max(1, fewest // max(1, cell.settings.threads))
        future = self.cluster.submit(cell, cell.request(self.recorder.plan.experiment.checkpoints), address, share)
        self.tasks[future] = Task(cell, rest, address, attempt)
        return future

    def _failed(self, cell: Cell, message: str, attempt: int) -> None:
        del self.left[cell.cell_id]
        self.recorder.finish(cell, self.recorder.event(cell, "failed", message, attempt=attempt))

    def _finish(self, future: Future) -> list[Future]:
        """Records what a machine has sent, and goes on with the cell that follows there."""
        task = self.tasks.pop(future)
        if future.status in ("cancelled", "lost"):
            self._lost(task)
            return []
        try:
            self._record(task, _result(future))
            if self.timed and not self.again:
                self.done.setdefault(task.cell.block, []).append(task.cell)
        except WorkerFailed as error:
            self._failed(task.cell, str(error), task.attempt)
        if not task.rest or self.recorder.stopped:
            return []
        return [self._start(task.rest, task.address)]

    def _record(self, task: Task, result: CellResult) -> None:
        recorder, cell = self.recorder, task.cell
        env_id = digest(result.environment)
        recorder.record_environment(env_id, result.environment)
        if result.log:
            with (recorder.folder / "worker.log").open("ab") as file:
                file.write(result.log)
        recorder.listener.cell(cell, self.total - len(self.left), self.total, self._seconds_left())
        del self.left[cell.cell_id]
        event = recorder.measured_as(CellRecord(recorder, cell, env_id, task.attempt), result.again())
        if not self.timed:
            event = event.replaced(machine=event.machine.replaced(contended=True))
        recorder.finish(cell, event.replaced(wall_seconds=result.wall_seconds, worker=result.address))

    def _seconds_left(self) -> float:
        seconds = sum(seconds for seconds, _ in expected_seconds(self.left.values(), self.recorder.latest).values())
        return seconds / max(1, len(self.tasks) if self.timed else len(self.machines))

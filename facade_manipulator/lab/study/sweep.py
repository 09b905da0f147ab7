"""
Workspaces of many designs: measured by any executor, and kept in a file as they come.

The file has a line of JSON with what all its designs share, then one for each design. What was
measured is not measured again, in the next run either.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent import futures
from contextlib import contextmanager
from ctypes import CDLL
import json
from multiprocessing import active_children
import os
from pathlib import Path
import signal

import numpy as np

from facade_manipulator.errors import file_errors, ManipulatorError, ParameterError
from facade_manipulator.lab.study.requirements import Requirements
from facade_manipulator.lab.study.volume import measure, Workspace

CHUNK = 32  # designs in one task: some tenths of a second, so that handing over costs nothing
THETA_NODES, Y_CELLS = 512, 64  # the ratio to 2e-4, the volume far better
REGULAR_THETA_NODES = 128  # as exact where l >= b: no locus N = 0 bends the integrand
CONNECTION_TIMEOUT = 10.0  # s
PR_SET_PDEATHSIG = 1
SHARED = ('stroke_length', 'carriage_gap', 'threshold', 'characteristic_length')
Design = tuple[float, float]  # l and b [m]
Row = tuple[float, float, float, float, float]  # a design and its `Workspace`
Tick = Callable[[int], None]  # called with the number of designs done


def ignore(count: int) -> None:
    """Show no progress."""


class Sweep:
    """The workspaces of the designs that were asked for, each measured once."""

    def __init__(
        self, need: Requirements, executor: futures.Executor | None = None,
        path: Path | None = None,
    ) -> None:
        """Take what a file of earlier results has; raises a ParameterError if it has others."""
        self.need, self._executor, self._path = need, executor, path
        shared = {name: getattr(need, name) for name in SHARED}
        self._known = {} if path is None else _read(path, shared)

    def of(self, designs: np.ndarray, tick: Tick = ignore) -> list[Workspace]:
        """Return the workspaces of designs, of which l and b [m] are the first dimension."""
        wanted = [(float(length), float(half)) for length, half in designs.reshape(2, -1).T]
        missing = [design for design in dict.fromkeys(wanted) if design not in self._known]
        tick(len(wanted) - len(missing))
        for rows in self._measure(missing):
            self._keep(rows)
            tick(len(rows))
        return [self._known[design] for design in wanted]

    def _measure(self, designs: list[Design]) -> Iterator[list[Row]]:
        chunks = [designs[start:start + CHUNK] for start in range(0, len(designs), CHUNK)]
        if self._executor is None or len(chunks) < 2:
            yield from (measure_designs(chunk, self.need) for chunk in chunks)
            return
        for done in futures.as_completed([self._executor.submit(measure_designs, chunk, self.need)
                                  for chunk in chunks]):
            yield done.result()

    def _keep(self, rows: list[Row]) -> None:
        self._known |= {(length, half): Workspace(*of) for length, half, *of in rows}
        if self._path is not None:
            with file_errors(self._path), self._path.open('a', encoding='utf-8') as file:
                file.writelines(f'{json.dumps(row)}\n' for row in rows)


def measure_designs(designs: list[Design], need: Requirements) -> list[Row]:
    """Measure designs, in whichever process."""
    return [(length, half, *measure(
        need.geometry(length, half), need.threshold, need.characteristic_length,
        REGULAR_THETA_NODES if length >= half else THETA_NODES, Y_CELLS))
        for length, half in designs]


@contextmanager
def executor_of(scheduler: str | None) -> Iterator[futures.Executor]:
    """
    Lend the executor of a scheduler of dask.distributed, or a process for each processor.

    When the block ends in an error, what was not begun is not begun any more. Raises a
    ManipulatorError if the scheduler does not answer, or if processes died and nobody takes their
    work over.
    """
    if scheduler is None:
        pool = futures.ProcessPoolExecutor(initializer=_begin_process, initargs=(os.getpid(),))
        try:
            yield pool
        except futures.BrokenExecutor as error:
            for process in active_children():  # the pool waits for those that ignore its SIGTERM
                process.kill()
            raise ManipulatorError(f'a process that measures designs died: {error}') from error
        finally:
            pool.shutdown(cancel_futures=True)
        return
    from distributed import Client, KilledWorker

    try:
        client = Client(scheduler, timeout=CONNECTION_TIMEOUT)
    except (OSError, ValueError) as error:
        raise ManipulatorError(f'scheduler {scheduler}: {error}') from error
    try:
        with client:  # to close it cancels what is not begun
            yield client.get_executor()
    except (KilledWorker, futures.CancelledError) as error:
        raise ManipulatorError(f'scheduler {scheduler} lost the work: {error!r}') from error


def _begin_process(parent: int) -> None:
    """Leave Ctrl-C to the process that began this one, and end when that does, or has."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:
        os._exit(1)


def _read(path: Path, shared: dict[str, float]) -> dict[Design, Workspace]:
    """Return what a file has; begin it if there is none, and drop a line that was half written."""
    with file_errors(path):
        path.touch()
        content = path.read_bytes()
        if not content:
            path.write_text(f'{json.dumps(shared)}\n', encoding='utf-8')
            return {}
    whole = content[:content.rfind(b'\n') + 1]
    try:
        found, *rows = (json.loads(line) for line in whole.splitlines())
        known = {(float(length), float(half)): Workspace(*map(float, of))
                 for length, half, *of in rows}
        if not isinstance(found, dict):
            raise TypeError(f'it begins with {found!r}')
    except (ValueError, TypeError) as error:
        raise ParameterError(f'{path} is no file of results of this study: {error}') from error
    if found != shared:
        raise ParameterError(f'{path} has results for other inputs: ' + ', '.join(
            f'{name} = {found.get(name)}, not {value}' for name, value in shared.items()
            if found.get(name) != value))
    with file_errors(path):
        os.truncate(path, len(whole))
    return known

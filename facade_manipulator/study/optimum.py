"""
Optimum of section IV-C: a sweep of l and b over Table 1, with any executor.

The paper keeps l + b = 700 mm without stating it and gives 352/348 mm. Along this line the areas
peak at l = b, and the ratio peaks 1 mm before.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from concurrent import futures
from contextlib import contextmanager
from ctypes import CDLL
from dataclasses import replace
from functools import partial
from itertools import product
from multiprocessing import active_children
import os
import signal
from typing import Any, NamedTuple

import numpy as np

from facade_manipulator.errors import ManipulatorError, ParameterError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.study.paper import LENGTH_SUM, LINK_RANGE, PLATFORM_RANGE
from facade_manipulator.study.workspace_metrics import Good, measure, section_area

SWEEP_STEP = 0.001  # m: step of the sweep, as in the paper
LENGTH_ROUNDING = 1e-9  # m

Lengths = tuple[float, float]  # l and b [m]


class Merit(NamedTuple):
    """Merits of a design, and the share of its workspace volume beyond N = 0."""

    link_length: float  #: m
    platform_half_length: float  #: m
    area: float  #: at θ = 0 [m²]
    good_area: float  #: of the good poses at θ = 0 [m²]
    volume: float  #: over x, y and θ, before N = 0 [m² rad]
    ratio: float  #: good share of the volume
    beyond_share: float


# with their units
OBJECTIVES = {'area': 'm2', 'good_area': 'm2', 'volume': 'm2 rad', 'ratio': ''}


def designs(length_sum: float = LENGTH_SUM, step: float = SWEEP_STEP) -> list[Lengths]:
    """
    Return the designs of Table 1 in steps [m] with a given l + b [m]; 0 means any sum.

    Raises a ParameterError if Table 1 contains no design with this sum.
    """
    links = _steps(LINK_RANGE, step)
    if not length_sum:
        return list(product(links, _steps(PLATFORM_RANGE, step)))

    lower, upper = PLATFORM_RANGE
    line = []
    for length in links:
        half = round(length_sum - length, 9)
        if lower <= half <= upper:
            line.append((length, half))
    if not line:
        raise ParameterError(
            f'--sum rejected: l + b = {length_sum:g} m is outside Table 1; next: set --sum '
            'between 0.45 m and 0.95 m'
        )
    return line


def _steps(ends: tuple[float, float], step: float) -> list[float]:
    """Return lengths from the first to the last in equal steps [m]."""
    lower, upper = ends
    lengths: list[float] = np.round(
        np.arange(lower, upper + LENGTH_ROUNDING, step), 9
    ).tolist()
    return lengths


# number of cells of y and of θ: the ratio of a design is exact to 4e-4
SWEEP_CELLS = 128


def evaluate(lengths: Lengths, like: Geometry, good: Good) -> Merit:
    """Return the merits of a design with the rail of another design; runs in a worker process."""
    length, half = lengths
    geometry = replace(like, link_length=length, platform_half_length=half)
    volume, *shares = measure(geometry, good, SWEEP_CELLS)
    ratio, beyond_share = np.nan_to_num(shares).tolist()
    return Merit(
        link_length=length,
        platform_half_length=half,
        area=section_area(geometry),
        good_area=section_area(geometry, good),
        volume=volume * (1.0 - beyond_share),
        ratio=ratio,
        beyond_share=beyond_share,
    )


CHUNK = 32  # designs per task: some tenths of a second, so that transport costs little


def sweep(
    chosen: list[Lengths],
    like: Geometry,
    good: Good,
    executor: futures.Executor,
    progress: Callable[[Iterable[Any], int], Iterable[Any]] = lambda done, total: done,
) -> list[Merit]:
    """Compute and return the merits of designs with an executor; `progress` counts the designs."""
    merits = executor.map(
        partial(evaluate, like=like, good=good), chosen, chunksize=CHUNK
    )
    return list(progress(merits, len(chosen)))


def best(merits: list[Merit], objectives: Iterable[str]) -> list[dict[str, Any]]:
    """
    Return the best designs for each objective, for JSON: first with l ≥ b, then of all designs.

    A workspace with l ≥ b has no pose beyond N = 0.
    """
    regular = []
    for merit in merits:
        if merit.link_length >= merit.platform_half_length - LENGTH_ROUNDING:
            regular.append(merit)

    found = []
    for name, among in (('l >= b', regular), ('all', merits)):
        if not among:
            continue
        for objective in objectives:
            value, merit = max((getattr(one, objective), one) for one in among)
            row = {'objective': objective, 'designs': name, 'count': len(among)}
            found.append(row | {'value': value} | merit._asdict())
    return found


CONNECTION_TIMEOUT = 10.0  # s


@contextmanager
def executor_of(scheduler: str | None) -> Iterator[futures.Executor]:
    """
    Yield the executor of a dask.distributed scheduler, or of one process per processor.

    When the block ends in an error, pending tasks are cancelled. Raises a ManipulatorError if the
    scheduler does not answer, or if processes die and their work is lost.
    """
    if scheduler is None:
        pool = futures.ProcessPoolExecutor(
            initializer=_begin_process, initargs=(os.getpid(),)
        )
        try:
            yield pool
        except futures.BrokenExecutor as error:
            # the pool waits for processes that ignore its SIGTERM
            for process in active_children():
                process.kill()
            raise ManipulatorError(
                f'a process that measures designs died: {error}; next: start the study again'
            ) from error
        finally:
            pool.shutdown(cancel_futures=True)
        return
    from distributed import Client, KilledWorker

    try:
        client = Client(scheduler, timeout=CONNECTION_TIMEOUT)
    except (OSError, ValueError) as error:
        raise ManipulatorError(
            f'scheduler {scheduler} does not answer: {error}; next: check its address'
        ) from error
    try:
        with client:  # closing it cancels tasks that have not begun
            yield client.get_executor()
    except (KilledWorker, futures.CancelledError) as error:
        raise ManipulatorError(
            f'workers of {scheduler} failed: {error!r}; next: check its workers'
        ) from error


PR_SET_PDEATHSIG = 1


def _begin_process(parent: int) -> None:
    """Ignore Ctrl-C in a worker process; end the worker when its parent ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGTERM)
    if os.getppid() != parent:
        os._exit(1)

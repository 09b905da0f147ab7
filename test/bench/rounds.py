"""
Contenders timed in turns: each in a process of its own, all of them once in every round.

What disturbs the machine meets all contenders alike, and the median drops what meets one.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from functools import cached_property
import json
import os
from pathlib import Path
from statistics import median
import subprocess
import sys
from typing import NamedTuple, TypeVar

HERE = Path(__file__).resolve().parent
SOURCE = HERE.parents[1]
WHEEL_SETTINGS = ('_ROS_WHEELS_BOOTSTRAP_COMPLETE', 'LD_LIBRARY_PATH', 'AMENT_PREFIX_PATH')
AGREEMENT = 1e-6
PATIENCE = 30.0  # s, for a worker to end
T = TypeVar('T')
Times = dict[str, list[float]]  # by contender


class Contender(NamedTuple):
    """What is timed: a function of `module`."""

    name: str
    module: str


class Worker:
    """A contender in its own process, waiting for the word to run a round."""

    def __init__(self, contender: Contender, quick: bool) -> None:
        self.contender = contender
        self._process = subprocess.Popen(
            [sys.executable, str(HERE / 'worker.py'), contender.module, contender.name,
             'quick' if quick else 'full'],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=_environment())

    @cached_property
    def ready(self) -> dict:
        """Return its answer, or what it misses; waits for it."""
        return self._answer()

    def can_run(self) -> bool:
        """Return whether it misses nothing, or say what."""
        if 'missing' in self.ready:
            print(f'  skipped {self.contender.name}: {self.ready["missing"]}')
        return 'missing' not in self.ready

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_) -> None:
        self._process.stdin.close()
        self._process.wait(PATIENCE)

    def round(self) -> float:
        """Return the seconds of one item; raises a RuntimeError if the contender has failed."""
        self._process.stdin.write('round\n')
        self._process.stdin.flush()
        answer = self._answer()
        if 'seconds' not in answer:
            raise RuntimeError(f'{self.contender.name} {answer["missing"]}')
        return answer['seconds']

    def _answer(self) -> dict:
        line = self._process.stdout.readline()
        return json.loads(line) if line else {'missing': 'ended without a word'}


def _environment() -> dict[str, str]:
    """The wheels' settings are for the interpreter that made them; one thread for everybody."""
    kept = {name: value for name, value in os.environ.items() if name not in WHEEL_SETTINGS}
    threads = dict.fromkeys(
        ('OMP_NUM_THREADS', 'OPENBLAS_NUM_THREADS', 'NUMBA_NUM_THREADS'), '1')
    return {**kept, **threads, 'PYTHONPATH': str(SOURCE)}


def time_in_turns(
    contenders: Iterable[Contender], rounds: int, quick: bool
) -> dict[str, float]:
    """
    Return the median seconds of one item, by contender.

    A contender that cannot run is left out with a line, one whose answer differs from the first
    one's is named. All of them wait for their turn in processes that do nothing meanwhile; what
    cannot wait, because it has threads or uses a bus, takes `time_one_by_one`.
    """
    times: Times = defaultdict(list)
    with ExitStack() as stack:
        workers = [stack.enter_context(Worker(one, quick)) for one in contenders]
        workers = [worker for worker in workers if worker.can_run()]
        _compare_answers(workers)
        for worker in _in_turns(workers, rounds):
            times[worker.contender.name].append(worker.round())
    return {name: median(values) for name, values in times.items()}


def time_one_by_one(
    contenders: Iterable[Contender], rounds: int, quick: bool
) -> dict[str, float]:
    """Return the same of contenders that are started for each round and ended after it."""
    times: Times = defaultdict(list)
    for contender in _in_turns(list(contenders), rounds):
        with Worker(contender, quick) as worker:
            if worker.can_run():
                times[contender.name].append(worker.round())
    return {name: median(values) for name, values in times.items()}


def _in_turns(items: list[T], rounds: int) -> Iterator[T]:
    """Yield all items in every round, another one first in each."""
    for number in range(rounds):
        first = number % len(items)
        yield from items[first:] + items[:first]


def _compare_answers(workers: list[Worker]) -> None:
    """Name a contender that solves its problem, the part before the colon, otherwise."""
    wanted: dict[str, list[float]] = {}
    for worker in workers:
        name, answer = worker.contender.name, worker.ready['answer']
        expected = wanted.setdefault(name.partition(':')[0], answer) if answer else []
        if any(abs(a - b) > AGREEMENT for a, b in zip(answer, expected, strict=True)):
            print(f'  {name} answers {answer}, expected {expected}')

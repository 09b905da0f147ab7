"""
A time that is a number, for the controller and its worker.

It passes while the controller waits. The worker, which asks the drives by SDO, is a thread that
runs only then, until it waits itself: one thread runs at a time, always in the same order.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Executor, Future
import math
from threading import Event, Semaphore, Thread
from typing import Protocol

from facade_manipulator.canopen.clock import Clock

STEP = 1e-6  # s, by which time passes at least


class World(Protocol):
    """What lives in this time."""

    deadline: float  #: when something happens by itself [s]

    def advance(self) -> None:
        """Let it live until now."""


class Job(Thread):
    """Work of the driver's worker; it has the baton from `resume` until it waits or ends."""

    def __init__(self, clock: FakeClock, work: Callable[[], object], may_begin) -> None:
        super().__init__(daemon=True)
        self.future: Future[object] = Future()
        self._clock, self._work, self._gate = clock, work, Semaphore(0)
        self.condition, self.deadline = may_begin, math.inf
        self.start()

    def run(self) -> None:
        self._gate.acquire()
        try:
            self.future.set_result(self._work())
        except BaseException as error:
            self.future.set_exception(error)
        self._clock.jobs.remove(self)
        self._clock.gate.release()

    def resume(self) -> None:
        """Let it run, from the thread of the test, until it gives the baton back."""
        self._clock.present = self
        self._gate.release()
        self._clock.gate.acquire()
        self._clock.present = None

    def pause(self, condition: Callable[[], object], deadline: float) -> None:
        """Give the baton back until a condition holds, or the deadline has passed."""
        self.condition, self.deadline = condition, deadline
        self._clock.gate.release()
        self._gate.acquire()


class Workers(Executor):
    """A number of workers, each of which does one job after another."""

    def __init__(self, clock: FakeClock, number: int) -> None:
        self._clock, self._number, self._futures = clock, number, []

    def submit(self, function, /, *arguments) -> Future:
        earlier = self._futures[-self._number:][:1] if len(self._futures) >= self._number else []
        job = Job(self._clock, lambda: function(*arguments),
                  lambda: all(one.done() for one in earlier))
        self._clock.jobs.append(job)
        self._futures.append(job.future)
        return job.future

    def shutdown(self, wait: bool = True, **_: object) -> None:
        if wait:
            self._clock.wait_for(lambda: all(one.done() for one in self._futures), math.inf)


class FakeClock(Clock):
    """A time that is a number; it passes while the controller waits."""

    def __init__(self) -> None:
        self.now, self.offset = 100.0, 1.7e9  #: monotonic, and what the system clock is ahead [s]
        self.limit = math.inf  #: until when an idle controller waits [s]
        self.jobs: list[Job] = []
        self.present: Job | None = None
        self.gate = Semaphore(0)
        self.world: World

    def monotonic(self) -> float:
        return self.now

    def time(self) -> float:
        return self.now + self.offset

    def wait(self, event: Event, timeout: float) -> bool:
        is_main = self.present is None
        return self.wait_for(
            event.is_set, min(timeout, self.limit - self.now) if is_main else timeout)

    def workers(self, number: int, name: str) -> Workers:
        return Workers(self, number)

    def wait_for(self, condition: Callable[[], object], timeout: float) -> bool:
        """Wait until a condition holds, or a timeout has passed [s]; return whether it holds."""
        deadline = self.now + max(timeout, STEP)
        if self.present is not None:
            self.present.pause(condition, deadline)
        else:
            while not condition() and self.now < deadline:
                self.pass_time(deadline)
        return bool(condition())

    def pass_time(self, end: float) -> None:
        """Let a job run, or else time pass until something happens."""
        for job in self.jobs:
            if job.condition() or self.now >= job.deadline:
                job.resume()
                return
        wanted = min(self.world.deadline, *(job.deadline for job in self.jobs), end)
        self.now = max(self.now + STEP, wanted)
        self.world.advance()

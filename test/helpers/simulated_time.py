"""
A time of its own for the threads of a test: it steps when all of them wait.

Threads take turns, one at a time and always in the same order, and whoever waits gives his turn
away. So nothing waits for a clock, a busy machine changes nothing, and a run is the same each
time. Code that is to live in it needs no change: while a `SimulatedTime` is entered, the modules
of this project, of its tests and of the libraries that wait for it find its `time`, `threading`,
`queue` and `select` in the place of Python's.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
import concurrent.futures.thread  # noqa: F401
from contextlib import suppress
import functools
import math
from pathlib import Path
import queue
import select
import sys
import threading
import time
from types import SimpleNamespace

# those that would only be imported when it is too late for them
import can.interfaces.virtual  # noqa: F401
import canopen.sdo.client  # noqa: F401
import pytest

START = 100.0  # s, of the monotonic clock
WALL_CLOCK = 1.7e9  # s, of the system clock then
GLANCE = 1e-7  # s that it takes to look at a clock, so that who only looks comes to an end
SOCKET_STEP = 1e-3  # s, in which who waits for a socket looks at it again
PACKAGES = ('facade_manipulator.', 'can.', 'canopen.', 'durand.', 'concurrent.futures.')
TESTS = str(Path(__file__).resolve().parents[1])


class _Turn:
    """A thread's place among those that wait or are ready."""

    def __init__(self) -> None:
        self.deadline, self.subject = math.inf, None
        gate = threading.Lock()
        gate.acquire()
        self.give, self.take = gate.release, gate.acquire


class SimulatedTime:
    """The clocks, and the turns of the threads, of a test."""

    def __init__(self) -> None:
        self.now = START  #: on the monotonic clock [s]
        self.offset = WALL_CLOCK  #: what the system clock is ahead of it [s]; may be changed
        self._present = _Turn()  # the thread of the test
        self._ready: deque[_Turn] = deque()
        self._waiting: list[_Turn] = []
        self._is_over = False
        self._patches = pytest.MonkeyPatch()

    # --- clocks

    def monotonic(self) -> float:
        """Return the time [s] on a clock that nobody sets."""
        self.now += GLANCE
        return self.now

    def time(self) -> float:
        """Return the time [s] on the system's clock."""
        return self.monotonic() + self.offset

    def sleep(self, seconds: float) -> None:
        """Wait."""
        self.wait(bool, seconds)

    # --- turns

    def wait(
        self, condition: Callable[[], object], timeout: float | None = None,
        subject: object = None,
    ) -> bool:
        """Wait until a condition holds, which may change when the subject is notified."""
        deadline = math.inf if timeout is None else self.now + max(timeout, 0.0)
        while not (held := condition()) and self.now < deadline:
            turn = self._present
            turn.deadline, turn.subject = deadline, subject
            self._waiting.append(turn)
            self._give_turn(turn)
        return bool(held)

    def notify(self, subject: object) -> None:
        """Let those who wait for a subject look again."""
        ready = [turn for turn in self._waiting if turn.subject is subject]
        self._waiting = [turn for turn in self._waiting if turn.subject is not subject]
        self._ready.extend(ready)

    def add_thread(self) -> _Turn:
        """Return the turn of a new thread, which shall wait for it."""
        self._ready.append(turn := _Turn())
        return turn

    def begin(self, turn: _Turn) -> None:
        """Wait in a new thread for its first turn."""
        turn.take()
        self._check_end()

    def end(self, thread: object) -> None:
        """Let a thread end."""
        self.notify(thread)
        self._give_turn(None)

    def _give_turn(self, turn: _Turn | None) -> None:
        if self._ready:
            following = self._ready.popleft()
        else:
            following = min(self._waiting, key=lambda waiting: waiting.deadline)
            assert following.deadline < math.inf or self._is_over, 'every thread waits for another'
            self._waiting.remove(following)
            self.now = max(self.now, following.deadline)
        if following is turn:
            return
        self._present = following
        following.give()
        if turn is not None:
            turn.take()
            self._check_end()

    def _check_end(self) -> None:
        if self._is_over:
            raise SystemExit

    # --- from when to when

    def __enter__(self) -> SimulatedTime:
        replacements = self._replacements()
        for name, module in list(sys.modules.items()):
            file = getattr(module, '__file__', None) or ''
            if module is sys.modules[__name__] or not (
                    name.startswith(PACKAGES) or file.startswith(TESTS)):
                continue
            for key, value in list(vars(module).items()):
                with suppress(TypeError):  # what cannot be hashed is not one of them
                    if value in replacements:
                        self._patches.setattr(module, key, replacements[value])
        return self

    def __exit__(self, *details: object) -> None:
        self._patches.undo()
        self._is_over, mine = True, self._present
        while self._ready or self._waiting:  # threads that the test has left behind
            self._ready += *self._waiting, mine
            self._waiting.clear()
            with suppress(SystemExit):
                self._give_turn(mine)

    def _replacements(self) -> dict[object, object]:
        mine = {name: functools.partial(kind, self) for name, kind in {
            'Event': Event, 'Condition': Condition, 'Semaphore': Semaphore,
            'Lock': Semaphore}.items()}
        # of which one may ask whether something is an instance
        mine['Thread'] = type(
            'Thread', (Thread,), {'__init__': functools.partialmethod(Thread.__init__, self)})
        queues = {name: functools.partial(Queue, self) for name in ('Queue', 'SimpleQueue')}
        return {
            time: _Changed(
                time, monotonic=self.monotonic, perf_counter=self.monotonic, time=self.time,
                perf_counter_ns=lambda: round(1e9 * self.monotonic()), sleep=self.sleep),
            threading: _Changed(threading, **mine), queue: _Changed(queue, **queues),
            select: _Changed(select, poll=functools.partial(Poll, self)),
            time.time: self.time, time.monotonic: self.monotonic, time.sleep: self.sleep,
            **{getattr(threading, name): kind for name, kind in mine.items()}}


class _Changed(SimpleNamespace):
    """A module in which some names mean something else."""

    def __init__(self, module: object, **names: object) -> None:
        super().__init__(**names, _module=module)

    def __getattr__(self, name: str) -> object:
        return getattr(self._module, name)


class Thread(threading.Thread):
    """A `threading.Thread` that takes turns."""

    def __init__(self, time: SimulatedTime, *arguments: object, **details: object) -> None:
        super().__init__(*arguments, **details)
        self._time, self._has_ended = time, False

    def start(self) -> None:
        self._turn = self._time.add_thread()
        super().start()

    def run(self) -> None:
        try:
            with suppress(SystemExit):
                self._time.begin(self._turn)
                super().run()
        finally:
            self._has_ended = True
            self._time.end(self)

    def join(self, timeout: float | None = None) -> None:
        if self._time.wait(lambda: self._has_ended, timeout, self):
            super().join()


class Event:
    """A `threading.Event`."""

    def __init__(self, time: SimulatedTime) -> None:
        self._time, self._flag = time, False

    def is_set(self) -> bool:
        return self._flag

    def set(self) -> None:
        self._flag = True
        self._time.notify(self)

    def clear(self) -> None:
        self._flag = False

    def wait(self, timeout: float | None = None) -> bool:
        return self._time.wait(self.is_set, timeout, self)


class Semaphore:
    """A `threading.Semaphore`, and as good as any lock."""

    def __init__(self, time: SimulatedTime, value: int = 1) -> None:
        self._time, self._value = time, value

    def acquire(self, blocking: bool = True, timeout: float | None = None) -> bool:
        patience = None if timeout is None or timeout < 0.0 else timeout
        if not self._time.wait(lambda: self._value > 0, patience if blocking else 0.0, self):
            return False
        self._value -= 1
        return True

    def release(self) -> None:
        self._value += 1
        self._time.notify(self)

    def __enter__(self) -> bool:
        return self.acquire()

    def __exit__(self, *details: object) -> None:
        self.release()


class Condition:
    """A `threading.Condition`; a thread gives its turn away nowhere else, so it needs no lock."""

    def __init__(self, time: SimulatedTime, lock: object = None) -> None:
        self._time, self._notices = time, 0

    def __enter__(self) -> bool:
        return True

    def __exit__(self, *details: object) -> None:
        """Release nothing."""

    def notify_all(self) -> None:
        self._notices += 1
        self._time.notify(self)

    notify = notify_all

    def wait(self, timeout: float | None = None) -> bool:
        before = self._notices
        return self._time.wait(lambda: self._notices > before, timeout, self)

    def wait_for(self, condition: Callable[[], object], timeout: float | None = None) -> bool:
        return self._time.wait(condition, timeout, self)


class Poll:
    """A `select.poll`: what the kernel has is there at once, and looked for each millisecond."""

    def __init__(self, time: SimulatedTime) -> None:
        self._time, self._poll = time, select.poll()
        self.register = self._poll.register

    def poll(self, timeout: float | None = None) -> list[tuple[int, int]]:
        """Wait as long as `timeout` [ms]."""
        end = math.inf if timeout is None else self._time.now + 1e-3 * timeout
        while not (events := self._poll.poll(0)) and self._time.now < end:
            self._time.sleep(min(SOCKET_STEP, end - self._time.now))
        return events


class Queue:
    """A `queue.Queue`, and a `queue.SimpleQueue`."""

    def __init__(self, time: SimulatedTime, maxsize: int = 0) -> None:
        self._time, self._items, self._most = time, deque(), maxsize or math.inf

    def qsize(self) -> int:
        return len(self._items)

    def empty(self) -> bool:
        return not self._items

    def put(self, item: object, block: bool = True, timeout: float | None = None) -> None:
        if not self._time.wait(
                lambda: len(self._items) < self._most, timeout if block else 0.0, self):
            raise queue.Full
        self._items.append(item)
        self._time.notify(self)

    def get(self, block: bool = True, timeout: float | None = None) -> object:
        if not self._time.wait(lambda: self._items, timeout if block else 0.0, self):
            raise queue.Empty
        self._time.notify(self)
        return self._items.popleft()

    def get_nowait(self) -> object:
        return self.get(block=False)

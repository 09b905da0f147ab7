"""How late this machine wakes who sleeps: whether it can run what counts on its clock."""

from __future__ import annotations

from contextlib import suppress
import os
import threading
import time

import pytest

STEP = 0.01  # s
CALM = 0.3  # s, for which nobody may have been woken late
URGENCY = 70  # above all that is tested


class Lateness:
    """
    Watch from a thread of its own how late it is woken, of which the tests bear a bound [s].

    All together they have patience with a busy machine [s], which waiting and tests that failed
    on it use up; where nothing is left of it, no further test is tried.
    """

    def __init__(self, bound: float, patience: float) -> None:
        self.bound = bound
        self.worst = 0.0  #: the latest since it was set to 0 [s]
        self._patience, self._ended = patience, threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        with suppress(OSError):  # where that is not permitted, it is later, as those it speaks for
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(URGENCY))
        while not self._ended.is_set():
            due = time.monotonic() + STEP
            time.sleep(STEP)
            self.worst = max(self.worst, time.monotonic() - due)

    def report_failure(self, duration: float) -> None:
        """Count the time of a test that failed [s] as waited, if the machine was late."""
        if self.was_late:
            self._patience -= duration

    def require_calm(self) -> None:
        """Wait until the machine keeps its time; fail, with what was measured, if it does not."""
        if self._patience <= 0.0:
            pytest.fail('not tried: this machine was too busy for the tests before; run this '
                        'again with less beside it', pytrace=False)
        begin = now = time.monotonic()
        while True:
            self.worst = 0.0
            time.sleep(CALM)
            before, now = now, time.monotonic()
            if not self.was_late:
                return
            self._patience -= now - before
            if self._patience <= 0.0:
                pytest.fail(
                    f'this machine is too busy: it was up to {self.worst:.2f} s late within '
                    f'{now - before:.1f} s, bound {self.bound:g} s, and not better within '
                    f'{now - begin:.0f} s; run this again with less beside it', pytrace=False)

    @property
    def was_late(self) -> bool:
        """Return whether somebody was woken later than the tests bear."""
        return self.worst > self.bound

    def __str__(self) -> str:
        verdict = 'too busy for it' if self.was_late else 'not the reason'
        return (f'this machine was up to {self.worst:.2f} s late meanwhile, bound '
                f'{self.bound:g} s: {verdict}')

    def close(self) -> None:
        """Watch no longer."""
        self._ended.set()
        self._thread.join()

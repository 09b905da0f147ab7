"""Functions for tests of every kind."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
import signal
import time
import warnings

import pytest

DEADLINE = 20.0


class HangingTestError(BaseException):
    """A test took too long; `patiently` does not retry it."""


@contextmanager
def limited(name: str, seconds: float) -> Iterator[None]:
    """Raise an error after a time [s], wherever the main thread waits then."""

    def end(*_: object) -> None:
        raise HangingTestError(
            f'{name} takes over {seconds:g} s; it waits in the last line'
        )

    before = signal.signal(signal.SIGALRM, end)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def wait_until(
    condition: Callable[[], object],
    what: str,
    deadline: float = DEADLINE,
    step: Callable[[], None] = lambda: time.sleep(0.005),
) -> object:
    """Return the condition's first true value; fail with the awaited event at the deadline."""
    end = time.monotonic() + deadline
    while not (value := condition()):
        if time.monotonic() > end:
            pytest.fail(f'waited {deadline:g} s in vain for {what}')
        step()
    return value


def patiently(
    action: Callable[[], object],
    mend: Callable[[], object] = bool,
    errors: tuple[type[BaseException], ...] = (Exception, pytest.fail.Exception),
    tries: int = 3,
) -> object:
    """
    Return the result of an action; retry if the machine was too slow.

    The warnings at the end of a test run name each second try, so that no rare fault is hidden.
    """
    for _ in range(tries - 1):
        try:
            return action()
        except errors as error:
            warnings.warn(f'second try: {error}', stacklevel=2)
            mend()
    return action()


def children(pid: int) -> list[int]:
    """Return the process ids whose parent is `pid`."""
    found = []
    for stat in Path('/proc').glob('[0-9]*/stat'):
        with suppress(OSError):
            if int(stat.read_text().rsplit(')', 1)[1].split()[1]) == pid:
                found.append(int(stat.parent.name))
    return found

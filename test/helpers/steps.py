"""Steps of an SDO client without a bus; a client that waits by itself is accepted, too."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from inspect import isgenerator
from typing import Any

from facade_manipulator.canopen import sdo

HAS_STEPS = hasattr(sdo, 'Steps')


def result_of(steps: Any, wait: Callable[[], object] = bool) -> Any:
    """Return the result of steps, or a result itself; call a function at each wait."""
    if not isgenerator(steps):
        return steps
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value
        wait()


def answer(value: Any) -> Any:
    """Return what a read of an object returns: steps with a value as result, or the value."""
    return _steps(value) if HAS_STEPS else value


def _steps(value: Any) -> Iterator[None]:
    yield from ()
    return value

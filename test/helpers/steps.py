"""Steps of an SDO client, run without a bus."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from facade_manipulator.canopen.sdo import Steps


def result_of(steps: Steps[Any], wait: Callable[[], object] = bool) -> Any:
    """Return the result of steps; call a function at each wait."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value
        wait()


def answer(value: Any) -> Steps[Any]:
    """Return steps that have a value as their result, as a read of an object."""
    yield from ()
    return value

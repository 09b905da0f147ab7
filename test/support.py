"""What tests of every kind share."""

from __future__ import annotations

from collections.abc import Callable
import time

import pytest

DEADLINE = 20.0


def wait_until(
    condition: Callable[[], object], what: str, deadline: float = DEADLINE,
    step: Callable[[], None] | None = None,
) -> object:
    """Return the condition's first true value; fail, saying for what, at the deadline."""
    end = time.monotonic() + deadline
    while not (value := condition()):
        if time.monotonic() > end:
            pytest.fail(f'waited {deadline:g} s in vain for {what}')
        if step is None:
            time.sleep(0.005)
        else:
            step()
    return value

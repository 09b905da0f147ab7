"""What tests of ROS in this process share."""

from __future__ import annotations

import signal

import pytest

from facade_manipulator.ros import runtime


@pytest.fixture
def handlers():
    """Put back the signal handlers that a process of nodes has for itself."""
    before = {number: signal.getsignal(number) for number in runtime.STOP_SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)

"""The stack on vcan0, each part a process of its own: parameters, and an operator's ways."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import os
import re

import pytest
from support import patiently

from facade_manipulator.ros.client import ManipulatorClient, RequestRejectedError

PERIOD = 0.02
# a guest has one CPU, and its host may be busy: no timing verdicts beyond what drives guarantee
DRIVER = (
    '-p', 'bus.interface:=socketcan', '-p', 'bus.channel:=vcan0', '-p', 'controller.rate:=50',
    '-p', 'controller.max_missed_cycles:=10', '-p', 'stream.stale_after:=0.2',
    '-p', 'controller.realtime_priority:=60', '-p', 'controller.watchdog_timeout:=0.5',
    '-p', 'q1.home_position:=-0.1', '-p', 'q2.home_position:=0.1', '-p', 'q3.home_position:=0.0',
)
PATIENCE = ('controller.heartbeat_timeout:=1.0', 'controller.watchdog_timeout:=1.0')


def hurry() -> None:
    """Run as promptly as a drive does, where that is permitted."""
    with suppress(OSError):
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(50))


def bring_up(client: ManipulatorClient) -> None:
    """Power the drives on as an operator does; again where this machine was too slow for it."""
    def up() -> None:
        client.configure()
        client.home()
        client.activate()
    patiently(up, lambda: come_down(client), (RequestRejectedError,))


def go_on(client: ManipulatorClient) -> None:
    """Activate after a stop; from the beginning where this machine was too slow for it."""
    def begin_anew() -> None:
        come_down(client)
        client.configure()
        client.home()
    patiently(client.activate, begin_anew, (RequestRejectedError,))


def come_down(client: ManipulatorClient) -> None:
    """Leave the drives without power and the bus closed, whatever the driver is doing."""
    ways = {'active': client.deactivate, 'inactive': client.cleanup}

    def is_down() -> bool:
        state = client.driver_state()
        with suppress(RequestRejectedError):  # it has left that state by itself: look again
            ways.get(state, bool)()
        return state == 'unconfigured'
    client.wait_until(is_down, 'the driver to be unconfigured', 30.0)


def assert_says(client: ManipulatorClient, component: str, pattern: str) -> None:
    """Wait until the driver says something of a component in /diagnostics."""
    def says() -> bool:
        found = client.component(f'driver: {component}')
        return found is not None and re.search(pattern, found.status.message) is not None
    client.wait_until(says, f'{pattern} in /diagnostics', 20.0)


def assert_rejected(
    client: ManipulatorClient, request: Callable[[], object], pattern: str
) -> None:
    """Check that the driver rejects a request and says why."""
    with pytest.raises(RequestRejectedError):
        request()
    assert_says(client, 'operation', pattern)

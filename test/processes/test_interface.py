"""Driver and simulated drives on a CAN interface of the kernel that goes down and up."""

import time

from link import clear_flags, IFF_UP, set_flags
import pytest
from stack import bring_up, come_down, make_sure_of_power, wait_until_enabled
from test_kills import enables
from watcher import NODES

from facade_manipulator.errors import ManipulatorError
from facade_manipulator.topics import DIAGNOSTICS


def switch(interface, change, state):
    try:
        change(interface, IFF_UP)
    except PermissionError:
        pytest.skip(f'no permission to switch {interface} {state}')


def test_lost_interface_requires_configuration_and_homing(
    active, driver, watcher, vcan0
):
    messages = {}

    def store(array):
        for status in array.status:
            messages[status.name] = status.message

    qos = DIAGNOSTICS.subscription_qos
    active.node.create_subscription(DIAGNOSTICS.type, DIAGNOSTICS.name, store, qos)
    make_sure_of_power(active, watcher)
    switch(vcan0, clear_flags, 'down')
    try:
        active.wait_until(lambda: active.driver_state() == 'inactive', 'inactive', 20.0)
        active.wait_until(
            lambda: 'down' in messages.get('driver: bus', ''), 'the reason', 20.0
        )
    finally:
        switch(vcan0, set_flags, 'up')
    back = time.time()
    with pytest.raises(ManipulatorError):
        active.activate()
    come_down(active)
    assert [watcher.first(0x200 + node, back, enables) for node in NODES] == [None] * 3
    bring_up(active)
    wait_until_enabled(watcher)

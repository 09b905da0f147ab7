"""What an interface of the kernel that goes down does to the driver."""

from __future__ import annotations

import time

from stack import assert_says, go_on, make_sure_of_power, wait_until_enabled
from support import wait_until
from test_drive_simulator import switch
from test_kills import enables
from watcher import NODES

from facade_manipulator.errors import ManipulatorError


def test_interface_that_goes_leaves_the_driver_inactive(
        active, driver, watcher, vcan0):
    make_sure_of_power(active, watcher)
    switch(vcan0, up=False)
    try:
        active.wait_until(lambda: active.driver_state() == 'inactive', 'inactive', 20.0)
        assert_says(active, 'bus', 'down')
    finally:
        switch(vcan0, up=True)
    thawed = time.time()
    wait_until(lambda: cleared(active), 'clear_faults to be possible', 30.0,
               step=lambda: time.sleep(0.2))
    assert [watcher.first(0x200 + node, thawed, enables) for node in NODES] == [None] * 3
    go_on(active)
    wait_until_enabled(watcher)


def cleared(client) -> bool:
    try:
        client.clear_faults()
    except ManipulatorError:
        return False
    return True

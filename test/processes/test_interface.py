"""Driver on a CAN interface of the kernel that goes down."""

from __future__ import annotations

import time

import pytest
from stack import assert_says, bring_up, come_down, make_sure_of_power, wait_until_enabled
from test_drive_simulator import switch
from test_kills import enables
from watcher import NODES

from facade_manipulator.errors import ManipulatorError


def test_lost_interface_requires_configuration_and_homing(
        active, driver, watcher, vcan0):
    make_sure_of_power(active, watcher)
    switch(vcan0, up=False)
    try:
        active.wait_until(lambda: active.driver_state() == 'inactive', 'inactive', 20.0)
        assert_says(active, 'bus', 'down')
    finally:
        switch(vcan0, up=True)
    back = time.time()
    with pytest.raises(ManipulatorError):
        active.activate()
    come_down(active)
    assert [watcher.first(0x200 + node, back, enables) for node in NODES] == [None] * 3
    bring_up(active)
    wait_until_enabled(watcher)

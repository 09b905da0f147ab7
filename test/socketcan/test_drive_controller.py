"""The drive controller on a real SocketCAN bus: SYNC of the kernel, the interface down and up."""

from __future__ import annotations

from dataclasses import replace

from drive_rig import at_rest, moving, Rig, SETTINGS
from link import set_flags
import pytest
from support import wait_until
from test_drive_simulator import switch

from facade_manipulator.drives.cia402 import State
from facade_manipulator.drives.link import BusSettings, open_bus
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.errors import BusError

IFF_UP = 0x1
PERIOD = 0.02


@pytest.fixture
def rig(vcan0):
    settings = replace(SETTINGS, rate=50, reopen_after=0.3)
    made = Rig(vcan0, interface='socketcan', settings=settings)
    yield made
    set_flags(vcan0, IFF_UP)
    made.close()


def test_the_kernel_sends_sync_at_its_period(rig):
    at_rest(rig)
    rig.frames()
    rig.cycles(20)  # a socket keeps no more than some 250 frames
    stamps = [frame.timestamp for frame in rig.frames() if frame.arbitration_id == 0x080]
    steps = [b - a for a, b in zip(stamps, stamps[1:], strict=False)]
    assert len(steps) >= 15
    assert sum(steps) / len(steps) == pytest.approx(PERIOD, rel=0.05)  # one late frame in 20
    assert rig.controller.snapshot().cycle.skipped == 0


def test_a_day_on_a_real_bus(rig):
    moving(rig)
    assert 'activate to go on' in rig.do('halt')
    rig.do('deactivate')
    assert rig.drive_states == [State.SWITCH_ON_DISABLED] * 3
    rig.frames()
    rig.do('cleanup')
    assert rig.state is ControllerState.UNCONFIGURED


def test_sync_falls_silent_with_the_controller(rig):
    at_rest(rig)
    rig.controller.close()
    rig.frames()
    assert rig.listener.recv(3 * PERIOD) is None or all(
        frame.arbitration_id != 0x080 for frame in rig.frames())


def test_an_interface_that_goes_down_and_comes_back_leaves_the_drives_stopped(rig, vcan0):
    moving(rig)
    switch(vcan0, up=False)
    rig.until(ControllerState.BUS_LOST)
    assert 'down' in rig.controller.snapshot().bus_error
    wait_until(lambda: State.OPERATION_ENABLED not in rig.drive_states,
               'the drives to miss the heartbeat')
    switch(vcan0, up=True)
    rig.until(ControllerState.STOPPED)
    assert State.OPERATION_ENABLED not in rig.drive_states
    rig.do('clear_faults', 'activate')


def test_an_interface_that_is_down_at_the_start_is_said(vcan0):
    switch(vcan0, up=False)
    try:
        with pytest.raises(BusError, match='sudo ip link set vcan0 up'):
            open_bus(BusSettings(interface='socketcan', channel=vcan0))
    finally:
        switch(vcan0, up=True)
    open_bus(BusSettings(interface='socketcan', channel=vcan0)).shutdown()

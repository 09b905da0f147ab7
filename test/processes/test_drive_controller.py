"""The drive controller on a real SocketCAN bus."""

from __future__ import annotations

from dataclasses import replace
import time

from drive_rig import at_rest, moving, Rig, SETTINGS
from link import IFF_UP, set_flags
import pytest
from support import hear_much, wait_until
from test_drive_simulator import switch

from facade_manipulator.canopen.link import BusSettings, open_bus
from facade_manipulator.canopen.pdo import SYNC_COB_ID
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.drives.states import State
from facade_manipulator.errors import BusError

# Hz: the threads share the guest's one processor
SLOW = replace(SETTINGS, rate=25, reopen_after=0.3)


@pytest.fixture
def rig(vcan0):
    made = Rig(vcan0, interface='socketcan', settings=SLOW)
    hear_much(made.listener.socket)
    yield made
    set_flags(vcan0, IFF_UP)
    made.close()


def test_a_day_on_a_real_bus(rig):
    moving(rig)
    assert 'next: clear_faults' in rig.do('halt')
    rig.do('deactivate')
    assert rig.drive_states == [State.SWITCH_ON_DISABLED] * 3
    rig.frames()
    rig.do('cleanup')
    assert rig.state is ControllerState.UNCONFIGURED


def test_sync_falls_silent_with_the_controller(rig):
    at_rest(rig)
    rig.controller.close()
    rig.frames()
    end = time.monotonic() + 5.0 * SLOW.period
    while (left := end - time.monotonic()) > 0.0:
        heard = rig.listener.recv(left)
        assert heard is None or heard.arbitration_id != SYNC_COB_ID


def test_fault_of_one_drive_stops_all_on_a_real_bus(rig):
    moving(rig)
    with rig.simulator.access() as drives:
        drives[1].inject_fault(0x8611)
    rig.until_stopped()
    assert 'q2 (node 2): ' in rig.controller.snapshot().cause
    rig.do('clear_faults', 'activate')


def test_interface_that_goes_down_stops_all_and_can_be_used_again(rig, vcan0):
    moving(rig)
    switch(vcan0, up=False)
    rig.until(ControllerState.BUS_LOST)
    assert 'down' in rig.controller.snapshot().cause
    wait_until(lambda: State.OPERATION_ENABLED not in rig.drive_states, 'the drives to stop')
    switch(vcan0, up=True)
    rig.until(ControllerState.STOPPED)
    assert 'clear_faults' in rig.controller.snapshot().next_step


def test_an_interface_that_is_not_there_or_down_is_said(vcan0):
    with pytest.raises(BusError, match='vcan77'):
        open_bus(BusSettings(interface='socketcan', channel='vcan77'))
    switch(vcan0, up=False)
    try:
        with pytest.raises(BusError, match='sudo ip link set vcan0 up'):
            open_bus(BusSettings(interface='socketcan', channel=vcan0))
    finally:
        switch(vcan0, up=True)
    open_bus(BusSettings(interface='socketcan', channel=vcan0)).shutdown()

"""Whether a drive has power: never said to be off unless its own statusword confirms it."""

from __future__ import annotations

from dataclasses import replace
import re
import threading
from types import SimpleNamespace

from bus_world import SETTINGS
from drive_faults import at_rest, configured
import pytest

from facade_manipulator.canopen.clock import Clock
from facade_manipulator.canopen.nmt import NmtState
from facade_manipulator.canopen.sdo import SdoAbortError
from facade_manipulator.drives.axis_settings import AXIS_NAMES, DEFAULT_AXES
from facade_manipulator.drives.commissioning import Commissioning, Drive
from facade_manipulator.drives.monitor import AxisMonitor
from facade_manipulator.drives.profile import load_profile, ProfileObject
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.drives.states import Controlword, Power, State, UNPOWERED_STATES
from facade_manipulator.errors import DriveStateError, DriveTimeoutError

NO_STATE = 0x0005


def obey_nothing(drive):
    drive.axis.control = lambda controlword: None


def fall_silent(drive):
    drive.is_silent = True


def name_no_state(drive):
    drive.objects.readers[0x6041, 0] = lambda: NO_STATE


LIES = {'obeys nothing': obey_nothing, 'silent': fall_silent, 'names no state': name_no_state}


def stop_with_power(rig, lie):
    """Stop drives that stay in quick stop active, of which one lies from then on."""
    at_rest(rig)
    rig.controller.stop('enough')
    rig.until(lambda: rig.state is ControllerState.STOPPED)
    rig.until(lambda: rig.drive_states == [State.QUICK_STOP_ACTIVE] * 3)
    lie(rig.drives[1])


@pytest.mark.parametrize('lie', LIES.values(), ids=LIES)
@pytest.mark.parametrize(('request_', 'state'), [
    ('cleanup', ControllerState.UNCONFIGURED), ('close', ControllerState.CLOSED)])
def test_end_without_confirmed_power_off_names_the_drive(
        make_rig, lie, request_, state):
    rig = make_rig(settings=replace(SETTINGS, step_timeout=0.3))
    stop_with_power(rig, lie)
    answer = rig.rejection(request_)
    assert 'the power of q2 (node 2) is not confirmed off' in answer
    assert 'switch the supply off before anybody reaches in' in answer
    assert (rig.drive_states[1] is State.QUICK_STOP_ACTIVE) == (lie is obey_nothing)
    assert {rig.drive_states[0], rig.drive_states[2]} <= UNPOWERED_STATES
    assert rig.state is state


def test_third_drive_is_switched_off_beside_silent_ones(make_rig):
    rig = make_rig(settings=replace(SETTINGS, step_timeout=0.3))
    stop_with_power(rig, fall_silent)
    fall_silent(rig.drives[0])
    rig.forge(0, bytes([2, 3]))  # NMT stop: no PDO reaches q3
    answer = rig.rejection('cleanup')
    assert 'the power of q1 (node 1) and q2 (node 2) is not confirmed off' in answer
    assert rig.drive_states[2] in UNPOWERED_STATES


def test_confirmed_power_off_is_reported(rig):
    configured(rig)
    assert rig.snapshot.power == 'confirmed off'
    assert 'have confirmed that their power is off' in rig.request('cleanup')
    assert rig.snapshot.power == 'unknown'  # nobody listens to them any more


def test_powered_and_silent_drives_are_named(make_rig):
    rig = make_rig(settings=replace(SETTINGS, max_missed_cycles=3))
    stop_with_power(rig, fall_silent)
    rig.until(lambda: rig.snapshot.power == 'q1 on, q2 unknown, q3 on')
    assert [axis.power for axis in rig.snapshot.axes] == [
        Power.ON, Power.UNKNOWN, Power.ON]
    assert 'power: q1 on, q2 unknown, q3 on' in rig.rejection('home')


# --- drives that somebody uses who is not heard

ENABLE = (Controlword.SHUTDOWN, Controlword.SWITCH_ON, Controlword.ENABLE_OPERATION)


def write(rig, index, value):
    for node in (1, 2, 3):
        rig.forge(0x600 + node, bytes([0x2B, index & 0xFF, index >> 8, 0, value, 0, 0, 0]))


@pytest.mark.parametrize(('words', 'state'), [
    (ENABLE, State.OPERATION_ENABLED),
    ((*ENABLE, Controlword.QUICK_STOP), State.QUICK_STOP_ACTIVE)])
def test_drives_powered_by_a_silent_master_are_left_alone(rig, words, state):
    write(rig, 0x605A, 6)
    for word in words:
        write(rig, 0x6040, word)
    rig.until(lambda: rig.drive_states == [state] * 3)
    boots = [drive.nmt_state for drive in rig.drives]
    assert f'q3 (node 3) has power ({state.value})' in rig.rejection('configure')
    assert rig.drive_states == [state] * 3
    assert [drive.nmt_state for drive in rig.drives] == boots
    write(rig, 0x6040, Controlword.DISABLE_VOLTAGE)
    rig.until(lambda: rig.drive_states == [State.SWITCH_ON_DISABLED] * 3)
    rig.request('configure')


# --- what is asked of drives by SDO, of objects that a test makes

class Objects:
    """What a drive answers, by index and subindex; None where it does not in time."""

    def __init__(self, values) -> None:
        self.values, self.written = values, []

    def read_number(self, index, subindex=0, signed=False):
        value = self.values.get((index, subindex), ABSENT)
        if value is ABSENT:
            raise SdoAbortError('it has no such object', 0x06020000)
        if value is None:
            raise DriveTimeoutError('it does not answer')
        return value

    def write(self, index, subindex, data) -> None:
        self.written.append((index, subindex, data))


ABSENT = object()
OFF, ENABLED, QUICK_STOP = 0x0250, 0x0637, 0x0617
OURS = 127 << 16 | round(1e3 * SETTINGS.heartbeat_timeout)


def commissioning(*values, nmt_state=NmtState.PRE_OPERATIONAL, clock=None, **profile):
    """Return what asks drives with these values, the drives, and the NMT commands it sends."""
    commands = []
    drives = tuple(
        Drive(AxisMonitor(name, axis, SETTINGS, replace(
            load_profile(axis.profile), **profile)), Objects(one))
        for name, axis, one in zip(AXIS_NAMES, DEFAULT_AXES, values, strict=False))
    for drive in drives:
        drive.monitor.nmt_state = nmt_state
    bus = SimpleNamespace(command=lambda *command: commands.append(command))
    asking = Commissioning(bus, drives, SETTINGS, threading.Event(), clock or Clock())
    return asking, drives, commands


@pytest.mark.parametrize(('statusword', 'velocity', 'consumer', 'is_operational', 'use'), [
    (OFF, 0, 0, False, ''), (None, 100_000, 0, True, ''), (NO_STATE, 100_000, 0, True, ''),
    (OFF, 100_000, OURS, False, 'moves at 0.233 m/s'),
    (OFF, -100_000, 0, False, 'moves at -0.233'), (OFF, 850, 0, False, ''),
    (OFF, ABSENT, ABSENT, False, ''),
    (ENABLED, 0, 0, False, 'has power (operation enabled)'),
    (QUICK_STOP, 0, 0, False, 'has power (quick stop active)'),
    # what this driver has left behind misses its heartbeat and has stopped
    (QUICK_STOP, 0, OURS, True, ''), (OFF, 0, OURS, True, ''),
    (ENABLED, 0, OURS, True, 'has power (operation enabled)'),
    *((QUICK_STOP, 0, other, False, 'has power') for other in (
        OURS + 1, OURS & ~0xFFFF, OURS - (1 << 16))),
    (OFF, 0, OURS + 1, True, 'is operational'), (OFF, 0, 0, True, 'is operational')])
def test_use_by_another_master_is_named(
        statusword, velocity, consumer, is_operational, use):
    asking, _, commands = commissioning(
        {(0x6041, 0): statusword, (0x606C, 0): velocity, (0x1016, 1): consumer},
        nmt_state=NmtState.OPERATIONAL if is_operational else NmtState.PRE_OPERATIONAL)
    if use:
        with pytest.raises(DriveStateError, match=re.escape(f'q1 (node 1) {use}')):
            asking.require_unused()
    else:
        asking.require_unused()
    assert not commands


def test_drive_watching_us_by_another_object_is_ours():
    """Its profile writes 1016h:02, as where another node is watched by 1016h:01."""
    asking, *_ = commissioning(
        {(0x6041, 0): QUICK_STOP, (0x606C, 0): 0, (0x1016, 2): OURS},
        nmt_state=NmtState.OPERATIONAL,
        objects=(ProfileObject(0x1016, 2, 'master_heartbeat', required=True),))
    asking.require_unused()

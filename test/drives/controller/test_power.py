"""Whether a drive has power: never said to be off unless its own statusword confirms it."""

from __future__ import annotations

from dataclasses import replace

from drive_rig import at_rest, inactive, SETTINGS
import pytest
from support import wait_until

from facade_manipulator.drives.cia402.states import Controlword, Power, State, UNPOWERED_STATES
from facade_manipulator.drives.controller.snapshot import ControllerState

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
    rig.until(ControllerState.STOPPED)
    wait_until(lambda: rig.drive_states == [State.QUICK_STOP_ACTIVE] * 3, 'the quick stop')
    with rig.simulator.access() as drives:
        lie(drives[1])


@pytest.mark.parametrize('lie', LIES.values(), ids=LIES)
@pytest.mark.parametrize(('request_', 'state'), [
    ('cleanup', ControllerState.UNCONFIGURED), ('close', ControllerState.CLOSED)])
def test_an_end_without_confirmation_fails_with_the_name_of_the_drive(
        make_rig, lie, request_, state):
    rig = make_rig(settings=replace(SETTINGS, step_timeout=0.3))
    stop_with_power(rig, lie)
    answer = rig.rejection(request_)
    assert 'the power of q2 (node 2) is not confirmed off' in answer
    assert 'switch the supply off before anybody reaches in' in answer
    assert (rig.drive_states[1] is State.QUICK_STOP_ACTIVE) == (lie is obey_nothing)
    assert {rig.drive_states[0], rig.drive_states[2]} <= UNPOWERED_STATES
    assert rig.state is state


def test_one_that_answers_is_switched_off_beside_two_that_do_not(make_rig):
    rig = make_rig(settings=replace(SETTINGS, step_timeout=0.3))
    stop_with_power(rig, fall_silent)
    with rig.simulator.access() as drives:
        fall_silent(drives[0])
    rig.forge(0, bytes([2, 3]))  # NMT stop: no PDO reaches q3
    answer = rig.rejection('cleanup')
    assert 'the power of q1 (node 1) and q2 (node 2) is not confirmed off' in answer
    assert rig.drive_states[2] in UNPOWERED_STATES


def test_drives_that_confirm_it_are_said_to_be_off(rig):
    inactive(rig)
    assert rig.controller.snapshot().power == 'confirmed off'
    assert 'have confirmed that their power is off' in rig.do('cleanup')
    assert rig.controller.snapshot().power == 'unknown'  # nobody listens to them any more


def test_each_drive_with_power_and_each_that_is_silent_is_named(make_rig):
    rig = make_rig(settings=replace(SETTINGS, max_missed_cycles=3))
    stop_with_power(rig, fall_silent)
    wait_until(lambda: rig.controller.snapshot().power == 'q1 on, q2 unknown, q3 on',
               'the silence')
    assert [axis.power for axis in rig.controller.snapshot().axes] == [
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
def test_drives_with_power_of_a_master_that_is_not_heard_are_left_alone(rig, words, state):
    write(rig, 0x605A, 6)
    for word in words:
        write(rig, 0x6040, word)
    wait_until(lambda: rig.drive_states == [state] * 3, 'the power')
    boots = [drive.nmt_state for drive in rig.drives]
    assert f'q3 (node 3) has power ({state.value})' in rig.rejection('configure')
    assert rig.drive_states == [state] * 3
    assert [drive.nmt_state for drive in rig.drives] == boots
    write(rig, 0x6040, Controlword.DISABLE_VOLTAGE)
    wait_until(lambda: rig.drive_states == [State.SWITCH_ON_DISABLED] * 3, 'the power off')
    rig.do('configure')


def test_a_drive_that_moves_without_power_is_left_alone_until_it_stands(rig):
    with rig.simulator.access() as drives:
        reader = drives[1].objects.readers[0x606C, 0]
        drives[1].objects.readers[0x606C, 0] = lambda: 100_000
    assert 'q2 (node 2) moves at' in rig.rejection('configure')
    with rig.simulator.access() as drives:
        drives[1].objects.readers[0x606C, 0] = reader
    rig.do('configure')


def test_drives_that_are_operational_for_nobody_here_are_left_alone(rig):
    write(rig, 0x1017, 20)
    rig.forge(0, bytes([1, 0]))
    assert 'q1 (node 1) is operational, q2 (node 2) is operational' in rig.rejection('configure')

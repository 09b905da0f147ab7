"""Events that end a motion, and the parameters that are written then."""

from __future__ import annotations

import pytest
from tools.commissioning.rig import own_profile
import yaml

from facade_manipulator.errors import BusError
from facade_manipulator.resources import config_path
from facade_manipulator.tools.commissioning.motion import _Ramp, ACCELERATION

pytestmark = pytest.mark.long

JOG = ('jog', 'q1', '40', '--speed', '20')
MOVING = 2.0  # s after the begin of the command, when the carriages move


def speeds(rig):
    return [abs(drive.motor.velocity) / drive.motor._per_metre for drive in rig.drives]


def during(rig, rejected, act, *words):
    """Run a command and let an event happen during its motion; return the command's message."""
    def check_and_act():
        assert min(speeds(rig)) > 0.01
        act()

    rig.later(MOVING, check_and_act)
    said = rejected(*(words or JOG))
    assert 'Written into machine.yaml: nothing' in said and 'jog q1' not in rig.overlay.steps()
    return said


def test_ctrl_c_stops_the_carriages_and_removes_the_power(rig, rejected, capsys):
    def interrupt():
        raise KeyboardInterrupt

    assert 'interrupted' in during(rig, rejected, interrupt)
    assert not rig.is_powered and max(speeds(rig)) < 1e-3


@pytest.mark.parametrize(('code', 'message'), [
    (0x2310, 'current is too high (error code 2310h); the carriages are stopped; next: check the '
     'motor cable'),
    (0x8611, 'error is beyond its window (error code 8611h); the carriages are stopped')])
def test_fault_of_one_drive_stops_all(rig, rejected, code, message):
    assert message in during(rig, rejected, lambda: rig.drives[1].inject_fault(code))
    assert not rig.is_powered


def test_silent_drive_stops_all_with_its_name(rig, rejected, capsys):
    def fall_silent():
        rig.drives[1].is_silent = True

    assert 'q2 (node 2)' in during(rig, rejected, fall_silent)
    assert not rig.is_powered


def test_lost_bus_leaves_the_stop_to_the_drives(rig, rejected):
    def lose():
        rig.bus_error = BusError('the interface is down')

    assert 'the interface is down' in during(rig, rejected, lose)
    rig.pass_time(1.0)
    assert max(speeds(rig)) < 1e-3


@pytest.mark.parametrize(('cob_id', 'data', 'message'), [
    (0x701, bytes(1), 'q1 (node 1) has restarted'),
    (0x77F, b'\x05', 'another master is on the bus')])
def test_restart_or_another_master_stops_all(rig, rejected, cob_id, data, message):
    assert message in during(rig, rejected, lambda: rig.deliver([(cob_id, data)]))


def test_drive_in_use_is_rejected_and_keeps_its_power(rig, rejected):
    for word in (6, 7, 15):
        rig.drives[0].objects.write((0x6040, 0), word)
    assert 'q1 (node 1) has power' in rejected(*JOG)
    assert rig.is_powered


def test_drive_without_dead_master_stop_does_not_move(rig, tmp_path, rejected):
    objects = yaml.safe_load(config_path('drives/simulated.yaml').read_text())['objects']
    rig.configured(own_profile(
        tmp_path, objects=[one for one in objects if one['index'] != 0x1016]))
    assert 'would continue to move if this computer were silent' in rejected(*JOG)
    assert rig.places == pytest.approx([-0.1, 0.1, 0.0])


def test_profile_without_homing_in_place_is_rejected(rig, tmp_path, rejected):
    rig.configured(own_profile(tmp_path, homing_methods=[17, 18]), **{'q1.homing_method': 17})
    assert 'add 37 or 35 to its homing_methods' in rejected(*JOG)


@pytest.mark.parametrize('answer', ['n', '', EOFError])
def test_answer_other_than_yes_powers_no_drive(rig, rejected, answer):
    def end(_):
        raise EOFError

    rig.answers['Do this'] = end if answer is EOFError else answer
    assert 'nothing was done' in rejected(*JOG, yes=False) or answer is EOFError
    assert not rig.is_powered and rig.places == pytest.approx([-0.1, 0.1, 0.0])


def test_ramp_stays_within_its_window_and_acceleration():
    ramp, before, last = _Ramp((True, False, True), 0.01, 0.01), 0.0, 0.0
    ramp.reset((0.1, 0.2, 0.3))
    for goal in [0.05] * 100 + [-0.05] * 200 + [0.0] * 50:
        ramp.goal = goal
        here = ramp.sample(0.0)[0] - 0.1
        assert abs(here) <= 0.01 + 1e-9
        assert abs((here - last) - (last - before)) <= 1.05 * ACCELERATION * 0.01**2
        before, last = last, here
    assert ramp.at_rest and ramp.sample(0.0)[1] == 0.2

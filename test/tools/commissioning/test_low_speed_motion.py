"""Events that end a motion, and the parameters that are written then."""

import pytest
from tools.commissioning.rig import own_profile, raising

from facade_manipulator.errors import BusError

pytestmark = pytest.mark.long

JOG = ('jog', 'q1', '40', '--speed', '20')
MOVING = 2.0  # s after the begin of the command, when the carriages move


def speeds(rig):
    return [
        abs(drive.motor.velocity) / drive.motor.counts_per_metre for drive in rig.drives
    ]


def during(rig, rejected, act):
    """Run a command and let an event happen during its motion; return the command's message."""

    def check_and_act():
        assert min(speeds(rig)) > 0.01
        act()

    rig.later(MOVING, check_and_act)
    said = rejected(*JOG)
    assert 'Written into machine.yaml: nothing' in said
    assert 'jog q1' not in rig.overlay.steps()
    return said


def fall_silent(rig):
    rig.drives[1].is_silent = True


@pytest.mark.parametrize(
    ('act', 'message'),
    [
        (raising(KeyboardInterrupt), 'interrupted'),
        (fall_silent, 'q2 (node 2)'),
        (
            lambda rig: rig.drives[1].inject_fault(0x2310),
            'current is too high (error code 2310h); the carriages are stopped; next: check the '
            'motor cable',
        ),
        (
            lambda rig: rig.drives[1].inject_fault(0x8611),
            'error is beyond its window (error code 8611h); the carriages are stopped',
        ),
        (lambda rig: rig.deliver([(0x701, bytes(1))]), 'q1 (node 1) has restarted'),
        (lambda rig: rig.deliver([(0x77F, b'\x05')]), 'another master is on the bus'),
    ],
)
def test_event_during_a_motion_stops_all_without_power(rig, rejected, act, message):
    assert message in during(rig, rejected, lambda: act(rig))
    assert not rig.is_powered
    assert max(speeds(rig)) < 1e-3


def test_lost_bus_leaves_the_stop_to_the_drives(rig, rejected):
    def lose():
        rig.bus_error = BusError('the interface is down')

    assert 'the interface is down' in during(rig, rejected, lose)
    rig.pass_time(1.0)
    assert max(speeds(rig)) < 1e-3


def test_drive_without_dead_master_stop_does_not_move(rig, tmp_path, rejected):
    rig.configured(own_profile(tmp_path, without=0x1016))
    message = rejected(*JOG)
    assert 'would continue to move if this computer were silent' in message
    assert 'next: remove the cause, and repeat' in message
    assert rig.places == pytest.approx([-0.1, 0.1, 0.0])


def test_profile_without_homing_in_place_is_rejected(rig, tmp_path, rejected):
    rig.configured(
        own_profile(tmp_path, homing_methods=[17, 18]), **{'q1.homing_method': 17}
    )
    assert 'add 37 or 35 to its homing_methods' in rejected(*JOG)


@pytest.mark.parametrize('answer', ['n', '', raising(EOFError)])
def test_answer_other_than_yes_powers_no_drive(rig, rejected, answer):
    rig.answers['Do this'] = answer
    assert ('no answer' if callable(answer) else 'nothing was done') in rejected(
        *JOG, yes=False
    )
    assert not rig.is_powered
    assert rig.places == pytest.approx([-0.1, 0.1, 0.0])

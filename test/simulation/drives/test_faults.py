"""Fault injection at the simulated drive: the effect and the end of each fault."""

import pytest
from simulation.drives.bench import Bench, CPM, NMT_RESET

from facade_manipulator.drives.states import Controlword, State, Status
from facade_manipulator.simulation.drives import faults

REGISTER = {0x2310: 0x03, 0x3220: 0x05, 0x4210: 0x09, 0x8611: 0x21, 0x8110: 0x11, 0x7380: 0x21,
            0xFF02: 0x81, 0x1000: 0x01}


def moving():
    return Bench().configure().enable().move_at(0.2)


def reset(bench):
    bench.controlword = 0
    bench.cycle(2)
    bench.controlword = Controlword.FAULT_RESET
    bench.cycle(1)
    bench.controlword = 0
    return bench.cycle(2)


@pytest.mark.parametrize('code', sorted(REGISTER))
def test_fault_is_reported_everywhere_and_cleared_by_reset(code):
    bench = moving()
    bench.drive.inject_fault(code)
    bench.cycle(30)
    message = bench.emergencies()[-1]
    assert (message.code, message.register) == (code, REGISTER[code])
    assert bench.read(0x603F) == code and bench.read(0x1001) == REGISTER[code]
    assert bench.motion.velocity == 0
    reset(bench)
    assert bench.state is State.SWITCH_ON_DISABLED
    assert bench.emergencies()[-1] == (0, 0, bytes(5)) and bench.read(0x603F) == 0
    assert bench.read(0x1003, 0) == 1 and bench.read(0x1003, 1) == code


@pytest.mark.parametrize('code, state', [
    (0x2310, State.FAULT), (0x7380, State.FAULT), (0x8611, State.FAULT_REACTION_ACTIVE),
    (0x8A80, State.FAULT_REACTION_ACTIVE), (0x8A88, State.FAULT),
    (0x8110, State.QUICK_STOP_ACTIVE)])
def test_error_code_causes_its_reaction(code, state):
    bench = moving()
    bench.drive.inject_fault(code)
    assert bench.drive.state is state


def test_safe_torque_off_cuts_power_and_survives_reboot():
    bench = moving()
    bench.drive.open_safe_torque_off()
    bench.cycle(2)
    assert bench.state is State.FAULT
    assert not bench.status.statusword & Status.VOLTAGE_ENABLED
    bench.nmt(NMT_RESET)
    bench.wait(0.1)
    assert bench.drive.state is State.FAULT
    bench.drive.axis.torque_off = False
    bench.nmt(NMT_RESET)
    bench.configure().enable()
    assert bench.status.statusword & Status.VOLTAGE_ENABLED


# --- faults by name

def effect(name):
    """Return a moving bench with a fault for 0.3 s, and its position before the fault."""
    bench = moving()
    bench.sends_heartbeat = True
    start = bench.status.position_counts
    bench.sent.clear()
    getattr(faults, name)(bench.drive)
    return bench.move_at(0.02, 30), start


@pytest.mark.parametrize(('name', 'is_sent'), [
    ('silent', {}), ('without_heartbeat', {0x182: 30}),
    ('restarting', {0x702: 1}), ('deaf_to_rpdo', {0x182: 30, 0x702: 6})])
def test_fault_changes_the_frames_of_30_cycles(name, is_sent):
    bench, _ = effect(name)
    for cob_id in (0x182, 0x702):
        assert sum(sent == cob_id for sent, _ in bench.sent) == is_sent.get(cob_id, 0)


def test_deaf_drive_stops_but_answers_sdo():
    bench, start = effect('deaf_to_rpdo')
    assert bench.motion.velocity == 0 and bench.read(0x607A) < bench.target


def test_half_following_drive_reports_no_following_error():
    bench = Bench().configure().enable()
    faults.half_following(bench.drive)
    bench.move_at(0.1, 100).cycle(50)
    assert bench.status.position_counts == pytest.approx(0.5 * bench.target, abs=2)
    assert bench.motion.following_error_counts == 0 and bench.emergencies() == []


def test_stuck_drive_trips_on_its_following_error():
    bench = moving()
    faults.stuck(bench.drive)
    bench.move_at(0.2, 40)
    assert [message.code for message in bench.emergencies()] == [0x8611]


def test_slipping_drive_counts_a_displacement_without_motion():
    bench = Bench().configure().enable()
    faults.slipping(bench.drive)
    assert bench.cycle(1).position_counts == pytest.approx(0.03 * CPM, abs=1)
    assert bench.drive.motor.carriage_position == pytest.approx(0.0, abs=1e-3)


def test_drive_reporting_no_power_continues_to_move():
    bench, start = effect('lying_about_power')
    assert bench.state is State.SWITCH_ON_DISABLED
    assert bench.status.position_counts > start


def test_drive_without_dead_master_stop_continues_to_move():
    bench, _ = effect('without_dead_master_stop')
    bench.wait(0.3)
    assert bench.drive.state is State.OPERATION_ENABLED
    assert [message.code for message in bench.emergencies()] == [0x8130]

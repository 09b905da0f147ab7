"""Fault injection at the simulated drive: each hook, what it does and how it ends."""


from drive_bench import Bench, CPM, NMT_RESET
import pytest

from facade_manipulator.drives.canopen.nmt import NmtState
from facade_manipulator.drives.cia402.states import Controlword, Mode, State, Status

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
def test_a_fault_is_told_in_every_place_and_cleared_by_a_reset(code):
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
def test_the_reaction_suits_the_fault(code, state):
    bench = moving()
    bench.drive.inject_fault(code)
    assert bench.drive.state is state


@pytest.mark.parametrize('behaviour, state', [
    (0, NmtState.PRE_OPERATIONAL), (1, NmtState.OPERATIONAL), (2, NmtState.STOPPED)])
def test_a_drive_that_misses_its_master_stops_and_is_as_operational_as_it_was_told(
        behaviour, state):
    bench = moving()
    bench.write(0x1029, 1, behaviour)
    bench.sends_heartbeat = True
    bench.cycle()
    bench.wait(0.3)
    assert bench.emergencies()[-1].code == 0x8130
    assert bench.drive.nmt_state is state
    assert bench.drive.state is State.QUICK_STOP_ACTIVE


@pytest.mark.parametrize('goal', [
    State.SWITCH_ON_DISABLED, State.READY_TO_SWITCH_ON, State.SWITCHED_ON])
def test_a_fault_without_power_is_one_at_once(goal):
    bench = Bench().configure().go(goal)
    bench.drive.inject_fault(0x8611)
    assert bench.drive.state is State.FAULT


def test_a_persistent_fault_rejects_the_reset_until_its_cause_is_gone():
    bench = moving()
    bench.drive.inject_fault(0x3220, persistent=True)
    reset(bench)
    assert bench.state is State.FAULT and bench.read(0x603F) == 0x3220
    bench.drive.remove_cause()
    assert bench.drive.state is State.FAULT
    reset(bench)
    assert bench.state is State.SWITCH_ON_DISABLED


def test_safe_torque_off_cuts_the_power_and_survives_a_reboot():
    bench = moving()
    bench.drive.open_safe_torque_off()
    bench.cycle(2)
    assert bench.state is State.FAULT
    assert not bench.status.statusword & Status.VOLTAGE_ENABLED
    bench.nmt(NMT_RESET)
    bench.wait(0.1)
    assert bench.drive.state is State.FAULT
    bench.drive.remove_cause()
    bench.nmt(NMT_RESET)
    bench.configure().enable()
    assert bench.status.statusword & Status.VOLTAGE_ENABLED


def test_a_lost_position_slips_and_forgets_the_home():
    bench = Bench().configure(_6098=37).enable(Mode.HOMING)
    bench.command(Controlword.HOMING_START)
    assert bench.status.statusword & Status.HOMING_ATTAINED
    bench.drive.lose_position(slip=0.01)
    bench.cycle(2)
    assert bench.state is State.FAULT and bench.emergencies()[-1].code == 0x7380
    assert bench.status.position_counts == pytest.approx(0.01 * CPM, abs=1)
    reset(bench)
    bench.enable(Mode.HOMING)
    assert not bench.status.statusword & Status.HOMING_ATTAINED


def test_a_silent_drive_hears_but_says_nothing():
    bench = moving()
    bench.drive.is_silent = True
    bench.sent.clear()
    bench.controlword = Controlword.QUICK_STOP
    bench.cycle(20)
    assert bench.sent == [] and bench.drive.state is State.QUICK_STOP_ACTIVE
    bench.drive.is_silent = False
    assert bench.wait(0.06)[0] == (0x702, b'\x05')

"""Faults of the simulated drive, and error codes with their reset."""

import drive_faults
import pytest
from simulation.drives.bench import Bench

from facade_manipulator.drives.states import Controlword, State

OFF = State.FAULT
STOPPING = State.FAULT_REACTION_ACTIVE
EFFECTS = {  # state at once
    0x1000: OFF,
    0x2310: OFF,
    0x7380: OFF,
    0x8A88: OFF,
    0xFF02: OFF,
    0x8110: State.QUICK_STOP_ACTIVE,
    0x8611: STOPPING,
    0x8A80: STOPPING,
}


def moving():
    return Bench().configure().enable().move_at(0.2)


@pytest.mark.parametrize('code', EFFECTS)
def test_fault_is_reported_everywhere_and_cleared_by_reset(code):
    bench = moving()
    bench.drive.inject_fault(code)
    assert bench.drive.axis.state is EFFECTS[code]
    bench.cycle(30)
    message = bench.emergencies()[-1]
    assert message.code == code
    assert message.register == 1
    assert bench.read(0x603F) == code
    assert bench.read(0x1001) == 1
    assert bench.motion.velocity == 0
    for bench.controlword in (0, Controlword.FAULT_RESET, 0):
        bench.cycle(2)
    assert bench.state is State.SWITCH_ON_DISABLED
    assert bench.emergencies()[-1] == (0, 0, bytes(5))
    assert bench.read(0x603F) == 0


@pytest.mark.parametrize(
    ('fault', 'has_master', 'state', 'codes'),
    [
        (drive_faults.lying_about_power, True, State.SWITCH_ON_DISABLED, []),
        (
            drive_faults.without_dead_master_stop,
            False,
            State.OPERATION_ENABLED,
            [0x8130],
        ),
    ],
)
def test_drive_with_undetectable_fault_continues_to_move(
    fault, has_master, state, codes
):
    bench = moving()
    bench.send(0x77F, [5])
    bench.sends_heartbeat = has_master
    fault(bench.drive)
    bench.move_at(0.2, 30)
    assert bench.state is state
    assert bench.motion.velocity > 0
    assert [message.code for message in bench.emergencies()] == codes


def test_stuck_drive_trips_on_its_following_error():
    bench = moving()
    drive_faults.stuck(bench.drive)
    bench.move_at(0.2, 40)
    assert [message.code for message in bench.emergencies()] == [0x8611]

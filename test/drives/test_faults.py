"""Faults in every situation and in any order: all drives stop, with a next step."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
import math

from bus_world import ignore_targets, Rig, SITUATIONS, SWITCH_HOMING
from cycle_checks import POWERED
from drive_faults import (
    deaf_to_rpdo,
    restarting,
    silent,
    slipping,
    without_heartbeat,
    without_safe_torque,
)
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import rule, RuleBasedStateMachine, run_state_machine_as_test
import pytest

from facade_manipulator.canopen.bus import BusCongestedError
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.controller import REQUESTS
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.drives.states import State
from facade_manipulator.errors import BusError, ManipulatorError
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.motion.setpoints import Setpoint
from facade_manipulator.simulation.drives.drive import SimulatedDrive

Q2 = 1  # the number of the axis that fails
CLEAR = 'clear_faults, activate'
HOME = 'clear_faults, home, activate'
CONFIGURE = 'cleanup, configure, home, activate'
CONFIGURED = {*SITUATIONS} - {'not configured'}
ACTIVE = {'active at rest', 'active in motion'}


# --- faults


def drive(act: Callable[[SimulatedDrive], object]) -> Callable[[Rig], None]:
    return lambda rig: rig.inject(Q2, act)


def emergency(code: int) -> Callable[[Rig], None]:
    return drive(lambda one: one.inject_fault(code))


@dataclass(frozen=True)
class Fault:
    """
    Fault, with the cause that the driver reports and the next step that the driver names.

    `shows` names the situations in which the driver notices the fault, by default all except
    'not configured'. A fault that cuts the power leaves all drives without power at rest. A fault
    that unhomes loses the home position of the drive.
    """

    inject: Callable[[Rig], None]
    cause: str
    next_step: str = CLEAR
    shows: frozenset[str] | set[str] = frozenset(CONFIGURED)
    cuts_power: bool = False
    unhomes: bool = False


def lost(inject: Callable[[Rig], None], cause: str = 'position is lost') -> Fault:
    return Fault(inject, cause, HOME, cuts_power=True, unhomes=True)


def restart(inject: Callable[[Rig], None]) -> Fault:
    return Fault(inject, 'has restarted by itself', CONFIGURE, unhomes=True)


def bus(kind: type[BusError], cause: str) -> Fault:
    error = kind(f'can0: {cause}')
    return Fault(
        lambda rig: setattr(rig, 'bus_error', error), cause, CONFIGURE, unhomes=True
    )


FAULTS = {
    'following error 8611': Fault(emergency(0x8611), 'following error'),
    'communication 8120': Fault(emergency(0x8120), 'error passive'),
    'overcurrent 2310': Fault(emergency(0x2310), 'current is too high'),
    'unknown code B123': Fault(emergency(0xB123), 'in no table'),
    'safe torque off': Fault(drive(without_safe_torque), 'safe torque off is open'),
    'encoder 7305': lost(emergency(0x7305)),
    'drive watchdog FF02': lost(emergency(0xFF02), 'watchdog of the drive'),
    'position lost 7380': lost(emergency(0x7380)),
    'counts slip': replace(
        lost(drive(slipping), 'has jumped by 0.0'), shows=CONFIGURED - {'homing'}
    ),
    'silent': Fault(drive(silent), 'did not', CONFIGURE),  # answer, or stop
    'no heartbeat': Fault(drive(without_heartbeat), 'sent no heartbeat', CONFIGURE),
    'restart': restart(drive(restarting)),
    'another drive': restart(drive(lambda one: one.set_identity(0, 0, 0, 7))),
    'deaf to RPDO': Fault(drive(deaf_to_rpdo), 'q2', CONFIGURE, {'active in motion'}),
    'targets ignored': Fault(
        drive(ignore_targets), 'does not follow its targets (bit 12 is 0)', shows=ACTIVE
    ),
    # its heartbeat and its silence are noticed in either order
    'NMT stop': Fault(lambda rig: rig.forge(0, b'\x02\x02'), 'q2', 'activate'),
    'NMT reset': restart(lambda rig: rig.forge(0, b'\x81\x02')),
    'interface down': bus(BusError, 'the CAN interface is down'),
    'bus-off': bus(BusError, 'the controller is bus-off'),
    'send queue full': bus(BusCongestedError, 'the send queue is full'),
}


# --- one after another

QUICK = 'active in motion'
ALIKE = {  # They differ from another fault of the table only in their code or frame.
    'communication 8120',
    'overcurrent 2310',
    'encoder 7305',
    'drive watchdog FF02',
    'another drive',
    'NMT reset',
    'bus-off',
}
CASES = []
for fault_name in FAULTS:
    for situation_name in SITUATIONS:
        if situation_name == QUICK:
            marks = pytest.mark.long if fault_name in ALIKE else ()
            CASES.append(pytest.param(fault_name, QUICK, marks=marks))
        elif fault_name not in ALIKE:
            case = pytest.param(fault_name, situation_name, marks=pytest.mark.long)
            CASES.append(case)


def require_stop(rig: Rig, fault: Fault, situation: str) -> None:
    """Require that a fault stops all drives, and that its cause and next step are reported."""
    hint = (
        f'no cause has {fault.cause!r}; next: correct it, '
        f'or remove {situation!r} from shows'
    )
    rig.until(lambda: fault.cause in rig.all_causes, hint=hint)
    rig.until(lambda: State.OPERATION_ENABLED not in rig.drive_states)
    rig.run(0.5)
    assert rig.state in (ControllerState.STOPPED, ControllerState.BUS_LOST)
    first = 'the operator stops' if situation == 'stopping' else fault.cause
    assert first in rig.snapshot.causes[0].message
    step = fault.next_step
    if situation == 'homing' and step == CLEAR:
        step = HOME
    assert step in rig.snapshot.next_step
    if fault.unhomes:
        assert 'q2' in rig.snapshot.unhomed


@pytest.mark.parametrize(('name', 'situation'), CASES)
def test_fault_stops_all_drives_and_names_next_steps(name, situation):
    fault = FAULTS[name]
    rig = Rig(axes=SWITCH_HOMING if situation == 'homing' else DEFAULT_AXES)
    SITUATIONS[situation](rig)
    before = rig.state
    jobs = list(rig.jobs)
    fault.inject(rig)
    if situation not in fault.shows:
        rig.run(0.3)
        assert rig.state is before
        assert fault.cause not in rig.all_causes
    else:
        require_stop(rig, fault, situation)
        assert rig.rejection('activate')
        assert all(job.done() for _, job in jobs)
        if fault.cuts_power:
            assert not POWERED & {*rig.drive_states}
    rig.course = None
    rig.repair()
    if rig.state is ControllerState.HOMING:
        rig.request('halt')
    rig.recover()
    assert rig.drive_states == [State.OPERATION_ENABLED] * 3
    rig.close()


# --- in any order

LESS_THAN_ANY = MotionLimits(speed=0.5, acceleration=3.0)  # smallest limits of a walk
# COB-IDs of the frames of drives and master, except commands to the drives
KNOWN_IDS = [0x080, 0x77F]
for base in (0x080, 0x180, 0x280, 0x380, 0x580, 0x700):
    KNOWN_IDS += [base + 1, base + 2, base + 3]
KNOWN = st.sampled_from(KNOWN_IDS)


def is_no_command(cob_id: int) -> bool:
    """Return whether a COB-ID is neither RPDO1 nor an SDO request of a drive."""
    return cob_id & 0x780 not in (0x200, 0x600)


STRANGE = st.integers(0, 0x7FF).filter(is_no_command)
moments = st.floats(0.0, 0.5)


class Walk(RuleBasedStateMachine):
    """Random walk of events: each cycle passes its checks, and the next steps lead to active."""

    def __init__(self) -> None:
        super().__init__()
        self.rig = Rig()
        self.rig.checks.limits = LESS_THAN_ANY

    @rule(name=st.sampled_from(sorted({*REQUESTS} - {'close'})), seconds=moments)
    def ask(self, name: str, seconds: float) -> None:
        self.rig.ask(name)
        self.rig.run(seconds)

    @rule()
    def follow_next_steps(self) -> None:
        with suppress(AssertionError):  # a fault may still be there
            self.rig.recover(6)

    @rule(seconds=st.floats(0.0, 2.0))
    def wait(self, seconds: float) -> None:
        self.rig.run(seconds)

    @rule(name=st.sampled_from([*FAULTS]), seconds=moments)
    def fail(self, name: str, seconds: float) -> None:
        FAULTS[name].inject(self.rig)
        self.rig.run(seconds)

    @rule()
    def repair(self) -> None:
        self.rig.repair()

    @rule(cause=st.sampled_from(('software_stop', 'the node ends')))
    def stop(self, cause: str) -> None:
        self.rig.controller.stop(cause)
        self.rig.run(0.02)

    @rule(cause=st.sampled_from(('', 'software_stop')))
    def forbid_power(self, cause: str) -> None:
        self.rig.controller.forbid_power(cause)

    @rule(seconds=st.floats(0.0, 0.3))
    def stall(self, seconds: float) -> None:
        self.rig.stall(seconds)

    @rule(amplitude=st.floats(-0.06, 0.06), rate=st.floats(0.2, 6.0))
    def stream(self, amplitude: float, rate: float) -> None:
        self.rig.stream(amplitude, rate)

    @rule(
        position=st.tuples(*[st.floats(-0.6, 0.6) | st.just(math.nan)] * 3),
        velocity=st.tuples(*[st.floats(-9.0, 9.0) | st.just(math.inf)] * 3),
        ahead=st.floats(-0.3, 1.5),
    )
    def send_any_setpoint(self, position, velocity, ahead: float) -> None:
        now = self.rig.clock.monotonic()
        with suppress(ManipulatorError):
            self.rig.follower.add(Setpoint(now + ahead, position, velocity), now)
        self.rig.run(0.02)

    @rule(speed=st.floats(0.05, 0.5), acceleration=st.floats(0.5, 3.0))
    def change_limits(self, speed: float, acceleration: float) -> None:
        self.rig.follower.change_limits(MotionLimits(speed, acceleration))

    @rule(seconds=st.sampled_from((-30.0, -5.0, -0.3, -0.02, 0.02, 0.3, 5.0, 30.0)))
    def set_system_clock(self, seconds: float) -> None:
        self.rig.clock.offset += seconds
        self.rig.run(0.05)

    @rule(command=st.sampled_from((1, 2, 128, 129, 130)), node=st.integers(0, 3))
    def command_network(self, command: int, node: int) -> None:
        self.rig.forge(0, bytes([command, node]))
        self.rig.run(0.05)

    @rule(cob_id=KNOWN | STRANGE, data=st.binary(max_size=8))
    def forge(self, cob_id: int, data: bytes) -> None:
        self.rig.forge(cob_id, data)
        self.rig.run(0.02)

    def teardown(self) -> None:
        try:
            self.rig.repair()
            self.rig.controller.forbid_power('')
            self.rig.run(4.0)
            self.rig.recover()
        finally:
            self.rig.close()


@pytest.mark.long
def test_random_requests_and_faults_are_safe():
    run_state_machine_as_test(
        Walk, settings=settings(max_examples=6, stateful_step_count=30)
    )


def test_few_random_requests_and_faults_are_safe():
    run_state_machine_as_test(
        Walk, settings=settings(max_examples=3, stateful_step_count=15)
    )

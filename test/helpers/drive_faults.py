"""Situations of the driver, and every fault that a drive, the bus or another master can make."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from bus_world import Rig

from facade_manipulator.canopen.bus import BusCongestedError
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.states import Mode
from facade_manipulator.errors import BusError
from facade_manipulator.simulation.drives.drive import SimulatedDrive
from facade_manipulator.simulation.drives.faults import slipping, without_heartbeat

Q2 = 1  # the number of the axis that fails
CLEAR, HOME = 'clear_faults, activate', 'clear_faults, home, activate'
CONFIGURE = 'cleanup, configure, home, activate'
SLOW_HOMING = tuple(
    replace(axis, homing_method=17, homing_speed=0.03) for axis in DEFAULT_AXES)


# --- situations

def configured(rig: Rig) -> None:
    rig.request('configure', 'home')


def homing(rig: Rig) -> None:
    rig.request('configure')
    rig.ask('home')
    rig.until(lambda: min(abs(drive.motor.velocity) for drive in rig.drives) > 0.0)


def at_rest(rig: Rig) -> None:
    rig.request('configure', 'home', 'activate')


def in_motion(rig: Rig) -> None:
    at_rest(rig)
    rig.stream()
    rig.until(lambda: rig.snapshot.axes[0].velocity > 0.1)


def stopping(rig: Rig) -> None:
    in_motion(rig)
    rig.controller.stop('the operator stops')
    rig.run(0.01)


SITUATIONS = {
    'not configured': lambda rig: None, 'configured': configured, 'homing': homing,
    'active at rest': at_rest, 'active in motion': in_motion, 'stopping': stopping}
CONFIGURED = {*SITUATIONS} - {'not configured'}
ACTIVE = {'active at rest', 'active in motion'}


# --- faults

def drive(act: Callable[[SimulatedDrive], object]) -> Callable[[Rig], None]:
    return lambda rig: rig.inject(Q2, act)


def emergency(code: int) -> Callable[[Rig], None]:
    return drive(lambda one: one.inject_fault(code))


def change(name: str, value: object) -> Callable[[Rig], None]:
    return drive(lambda one: setattr(one, name, value))


def ignore_targets(one: SimulatedDrive) -> Callable[[], object]:
    mode = one.axis.modes[Mode.CYCLIC_SYNCHRONOUS_POSITION]
    vars(mode).update(latch=lambda: None, status=lambda: 0)
    return lambda: (vars(mode).pop('latch'), vars(mode).pop('status'))


@dataclass(frozen=True)
class Fault:
    """
    A fault, the cause that the driver reports, and the next step that it names.

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
    delay: float = 0.0  #: s, from the injection until the drive shows the fault


def lost(inject: Callable[[Rig], None], cause: str = 'position is lost') -> Fault:
    return Fault(inject, cause, HOME, cuts_power=True, unhomes=True)


def restart(inject: Callable[[Rig], None]) -> Fault:
    return Fault(inject, 'has restarted by itself', CONFIGURE, unhomes=True)


def bus(kind: type[BusError], cause: str) -> Fault:
    error = kind(f'can0: {cause}')
    return Fault(lambda rig: setattr(rig, 'bus_error', error), cause, CONFIGURE, unhomes=True)


FAULTS = {
    'following error 8611': Fault(emergency(0x8611), 'following error'),
    'communication 8120': Fault(emergency(0x8120), 'error passive'),
    'overcurrent 2310': Fault(emergency(0x2310), 'current is too high'),
    'unknown code B123': Fault(emergency(0xB123), 'in no table'),
    'safe torque off': Fault(
        drive(SimulatedDrive.open_safe_torque_off), 'safe torque off is open'),
    'encoder 7305': lost(emergency(0x7305)),
    'drive watchdog FF02': lost(emergency(0xFF02), 'watchdog of the drive'),
    'position lost 7380': lost(drive(SimulatedDrive.lose_position)),
    'counts slip': replace(
        lost(drive(slipping), 'has jumped by 0.0'), shows=CONFIGURED - {'homing'}),
    'silent': Fault(change('is_silent', True), 'did not', CONFIGURE),  # answer, or stop
    'no heartbeat': Fault(
        drive(without_heartbeat), 'sent no heartbeat', CONFIGURE,
        CONFIGURED - {'stopping'}),
    'restart': restart(drive(SimulatedDrive.reboot)),
    'another drive': restart(
        drive(lambda one: one.set_identity(0, 0, 0, 7))),
    'deaf to RPDO': Fault(
        change('is_deaf', True), 'q2', CONFIGURE, {'active in motion'}),
    'targets ignored': Fault(
        drive(ignore_targets), 'does not follow its targets, bit 12 is 0', shows=ACTIVE),
    # its heartbeat and its silence are noticed in either order
    'NMT stop': Fault(lambda rig: rig.forge(0, b'\x02\x02'), 'q2', 'activate'),
    'NMT reset': restart(lambda rig: rig.forge(0, b'\x81\x02')),
    'interface down': bus(BusError, 'the CAN interface is down'),
    'bus-off': bus(BusError, 'the controller is bus-off'),
    'send queue full': bus(BusCongestedError, 'the send queue is full'),
}

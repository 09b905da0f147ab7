"""
Faults of a simulated drive by name.

A new fault is one function here that takes the drive, with `fault` before it.
"""

from __future__ import annotations

from collections.abc import Callable

from facade_manipulator.drives.states import State, STATUSWORDS
from facade_manipulator.simulation.drives.drive import SimulatedDrive

Fault = Callable[[SimulatedDrive], object]  #: may return a function that repairs the drive
FAULTS: dict[str, Fault] = {}  #: by name, such as ``'deaf to rpdo'``
_SLIP = 0.03  # m


def fault(function: Fault) -> Fault:
    """Register a function as the fault of its name."""
    FAULTS[function.__name__.replace('_', ' ')] = function
    return function


@fault
def silent(drive: SimulatedDrive) -> None:
    """Send nothing."""
    drive.is_silent = True


@fault
def without_heartbeat(drive: SimulatedDrive) -> None:
    """Send everything except the heartbeat."""
    drive.stop_heartbeat()


@fault
def deaf_to_rpdo(drive: SimulatedDrive) -> None:
    """Take no RPDO, but answer SDO requests and SYNC."""
    drive.is_deaf = True


@fault
def half_following(drive: SimulatedDrive) -> None:
    """Move half the distance from here to each target, with a following error of zero."""
    target, start = drive.axis.cyclic.target, drive.motor.position
    drive.axis.cyclic.target = lambda: start + 0.5 * (target() - start)  # type: ignore


@fault
def stuck(drive: SimulatedDrive) -> None:
    """Block the motor against any demand of the servo."""
    drive.motor.peak_speed = 0.0


@fault
def slipping(drive: SimulatedDrive) -> None:
    """Count a travel that the carriage did not make."""
    drive.motor.offset += drive._scale.to_counts(_SLIP)


@fault
def restarting(drive: SimulatedDrive) -> None:
    """Lose power for a moment."""
    drive.reboot()


@fault
def lying_about_power(drive: SimulatedDrive) -> None:
    """Report that the motor has no power, in every state."""
    drive.objects.readers[0x6041, 0] = lambda: STATUSWORDS[State.SWITCH_ON_DISABLED][1]


@fault
def without_dead_master_stop(drive: SimulatedDrive) -> None:
    """Go on when the heartbeat of the master is lost."""
    drive.objects.values[0x6007, 0] = 0

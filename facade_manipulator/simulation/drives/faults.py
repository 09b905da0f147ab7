"""Faults of a simulated drive by name: each is a function that takes the drive."""

from __future__ import annotations

from facade_manipulator.drives.states import Mode, State, STATUSWORDS
from facade_manipulator.simulation.drives.drive import SimulatedDrive

_SLIP = 0.03  # m


def silent(drive: SimulatedDrive) -> None:
    """Send nothing."""
    drive.is_silent = True


def without_heartbeat(drive: SimulatedDrive) -> None:
    """Send everything except the heartbeat."""
    drive.stop_heartbeat()


def deaf_to_rpdo(drive: SimulatedDrive) -> None:
    """Take no RPDO, but answer SDO requests and SYNC."""
    drive.is_deaf = True


def half_following(drive: SimulatedDrive) -> None:
    """Go half of the way to each target, with a following error of zero."""
    drive.axis.modes[Mode.CYCLIC_SYNCHRONOUS_POSITION].share = 0.5


def stuck(drive: SimulatedDrive) -> None:
    """Stand still, whatever the servo does."""
    drive.motor.peak_speed = 0.0


def slipping(drive: SimulatedDrive) -> None:
    """Count a travel that the carriage did not make."""
    drive.motor.offset += drive._scale.to_counts(_SLIP)


def restarting(drive: SimulatedDrive) -> None:
    """Lose power for a moment."""
    drive.reboot()


def lying_about_power(drive: SimulatedDrive) -> None:
    """Report that the motor has no power, in every state."""
    drive.objects.readers[0x6041, 0] = lambda: STATUSWORDS[State.SWITCH_ON_DISABLED][1]


def without_dead_master_stop(drive: SimulatedDrive) -> None:
    """Go on when the heartbeat of the master is lost."""
    drive.objects.values[0x6007, 0] = 0


FAULTS = {fault.__name__.replace('_', ' '): fault for fault in (
    silent, without_heartbeat, deaf_to_rpdo, half_following, stuck, slipping, restarting,
    lying_about_power, without_dead_master_stop)}

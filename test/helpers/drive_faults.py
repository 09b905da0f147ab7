"""
Faults of a simulated drive.

A new fault is one function in this module. It takes the drive and may return a repair function.
"""

from __future__ import annotations

from collections.abc import Callable

from facade_manipulator.drives.states import Controlword, State, STATUSWORDS
from facade_manipulator.simulation.drives.drive import SimulatedDrive
from facade_manipulator.simulation.drives.simulated_axis import SAFE_TORQUE_OFF


def silent(drive: SimulatedDrive) -> None:
    """Send no frames."""
    drive.is_silent = True


def without_heartbeat(drive: SimulatedDrive) -> None:
    """Send everything except the heartbeat."""
    drive.objects.sdo.download(0x1017, 0, bytes(2))


def deaf_to_rpdo(drive: SimulatedDrive) -> None:
    """Ignore RPDOs, but answer SDO requests and SYNC."""
    drive.is_deaf = True


def half_following(drive: SimulatedDrive) -> None:
    """Move half the distance from the present position to each target, without following error."""
    target = drive.axis.cyclic.target
    start = drive.motor.position
    drive.axis.cyclic.target = lambda: start + 0.5 * (target() - start)  # type: ignore


def stuck(drive: SimulatedDrive) -> None:
    """Block the motor against any demand of the servo."""
    drive.motor.peak_speed = 0.0


def slipping(drive: SimulatedDrive) -> None:
    """Count a travel of 30 mm that the carriage did not make."""
    drive.motor.offset += round(0.03 * drive.motor.counts_per_metre)


def without_safe_torque(drive: SimulatedDrive) -> None:
    """Cut the power by the safety chain, until `torque_off` of the axis is reset."""
    drive.axis.torque_off = True
    drive.inject_fault(SAFE_TORQUE_OFF)


def restarting(drive: SimulatedDrive) -> None:
    """Lose power for a moment."""
    drive.reboot()


def lying_about_power(drive: SimulatedDrive) -> None:
    """Report that the motor has no power, in every state."""
    drive.objects.readers[0x6041, 0] = lambda: STATUSWORDS[State.SWITCH_ON_DISABLED][1]


def without_dead_master_stop(drive: SimulatedDrive) -> None:
    """Continue when the heartbeat of the master is lost."""
    drive.objects.values[0x6007, 0] = 0


def quick_stop_input(drive: SimulatedDrive) -> Callable[[], object]:
    """
    Open the quick-stop input, which causes no error code; return a function that closes it.

    The drive ignores the command to enable operation while the input is open.
    """
    axis = drive.axis
    control = axis.control
    without_enable = ~(Controlword.ENABLE_OPERATION ^ Controlword.SWITCH_ON)
    vars(axis)['control'] = lambda word: control(word & without_enable)
    if axis.state is State.OPERATION_ENABLED:
        control(Controlword.QUICK_STOP)
    return lambda: vars(axis).pop('control')


def safe_torque_off_without_code(drive: SimulatedDrive) -> None:
    """Cut the power without an error code, until `torque_off` of the axis is reset."""
    drive.axis.torque_off = True
    drive.axis.control(Controlword.DISABLE_VOLTAGE)

"""Hand and ruler of a user of the simulated carriages: lines of text push and measure them."""

from __future__ import annotations

from collections.abc import Mapping
import math

from facade_manipulator.drives.states import POWERED_STATES
from facade_manipulator.errors import DriveStateError, ParameterError
from facade_manipulator.kinematics.planar import MM
from facade_manipulator.simulation.drives.drive import SimulatedDrive

USAGE = '"push q2 50" pushes q2 by 50 mm to the right, "ruler" shows the carriages'


def act(line: str, drives: Mapping[str, SimulatedDrive]) -> str:
    """
    Carry out a line for carriages by name; return the reply.

    Raises a ParameterError for a wrong line, a DriveStateError if the drive has power.
    """
    match line.lower().split():
        case ['ruler']:
            return _ruler(drives)
        case ['push', name, *words] if name in drives and words:
            return _push(name, drives[name], _distance(line, ''.join(words)))
        case ['push', name, *words] if words:
            raise ParameterError(
                f'{line} rejected: there is no carriage {name}; next: choose '
                + ', '.join(drives)
            )
    raise ParameterError(
        f'{line} rejected: it is not a command; next: type push q2 50, or ruler'
    )


def _ruler(drives: Mapping[str, SimulatedDrive]) -> str:
    """Return the true places of the carriages."""
    places = (
        f'{name} {MM * drive.motor.carriage_position:+.1f} mm'
        for name, drive in drives.items()
    )
    return f'{", ".join(places)} from the middle of the rail'


_LEAST = 1e-4  # m: the ruler shows no shorter distance


def _distance(line: str, text: str) -> float:
    """Return the distance [m] in a text such as ``'+50mm'``."""
    try:
        distance = float(text.removesuffix('mm')) / MM
    except ValueError:
        distance = math.nan
    if not _LEAST <= abs(distance) < math.inf:
        raise ParameterError(
            f'{line} rejected: {text} is not a distance of at least {MM * _LEAST:g} mm; '
            'next: give millimetres, positive to the right, such as push q2 50'
        )
    return distance


def _push(name: str, drive: SimulatedDrive, distance: float) -> str:
    """
    Push a carriage by a distance [m].

    With power a push is rejected: the servo would hold the carriage, and a user of the machine
    keeps the hands away.
    """
    if drive.axis.state in POWERED_STATES:
        raise DriveStateError(
            f'push of {name} rejected: its drive has power ({drive.axis.state.value}) and '
            'holds the carriage; next: deactivate the driver, or end the command that moves it'
        )
    motor = drive.motor
    start = motor.carriage_position
    end = start + distance
    end_stop = motor.hard_stop / motor.counts_per_metre
    if abs(end) > end_stop:
        stop = math.copysign(end_stop, end)
        most = math.trunc(MM * (stop - start))
        raise ParameterError(
            f'push of {name} rejected: it would end at {MM * end:+.1f} mm, beyond the end stop '
            f'at {MM * stop:+g} mm; next: push it by at most {most:+} mm'
        )
    motor.push(distance)
    return f'{name} is pushed from {MM * start:+.1f} to {MM * end:+.1f} mm'

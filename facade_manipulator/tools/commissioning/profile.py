"""
Command `profile`: a drive profile held against the drives.

References
----------
CiA 402-2: supported drive modes 6502h.

"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from facade_manipulator.canopen.sdo import SdoChannel
from facade_manipulator.drives import configuration
from facade_manipulator.drives.axis_settings import AXIS_NAMES, AxisSettings
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.profile import DriveProfile, load_profile
from facade_manipulator.errors import DriveIdentityError, DriveObjectError
from facade_manipulator.tools.commissioning.context import Context

_CYCLIC_POSITION = 1 << 7  # in 6502h


def run_profile(context: Context) -> int:
    """Hold the profiles against the drives; return 1 where a drive differs."""
    names = [context.options.axis] if context.options.axis else AXIS_NAMES
    settings = context.settings('controller', ControllerSettings)
    context.agree('The objects of the profiles are written to the drives, read back, and undone '
                  'by a reset. Nothing is stored, nothing moves.')
    status = 0
    for name in names:
        axis = context.axes[name]
        profile = load_profile(axis.profile)
        with context.bus() as bus:
            drive = context.drive(bus, name, profile.eds)
            problems = list(differences(drive, profile, axis, settings))
            bus.reset(axis.node_id)
        for problem in problems:
            print(f'! {name}: {problem}')
        if problems:
            status = 1
        else:
            print(f'{name}: the drive agrees with profile {axis.profile}')
            context.record(f'profile {name}')
    return status


def differences(
    drive: SdoChannel, profile: DriveProfile, axis: AxisSettings, settings: ControllerSettings,
) -> Iterator[str]:
    """Yield every difference of a drive from its profile; raises a DriveTimeoutError."""
    read = partial(configuration.read_optional, drive)
    try:
        configuration.check_identity(
            drive.name, configuration.read_identity(drive), axis, {})
    except DriveIdentityError as error:
        yield str(error)
    try:
        configuration.apply(drive, configuration.drive_writes(profile, axis, settings))
    except DriveObjectError as error:
        yield from str(error).split('; ')
    yield from configuration.unit_conflicts(read, axis)
    if not configuration.stops_without_master(drive, profile):
        yield 'it does not stop when this computer falls silent (1016h with 6007h)'
    modes = read(0x6502, 0)
    if modes is not None and not modes & _CYCLIC_POSITION:
        yield f'it has no cyclic synchronous position (6502h = {modes:X}h, bit 7)'

"""
The exception tree: one base, children by what the caller would do about them.

::

    ManipulatorError
    ├── ParameterError (also a ValueError)   correct the configuration
    ├── InputError                           the message is rejected and counted
    ├── LimitError                           the machine cannot go there
    │   ├── UnreachableError
    │   ├── StrokeLimitError
    │   ├── CarriageGapError
    │   ├── SingularityError
    │   └── SetpointLimitError
    ├── CalibrationError                     measure again, as the message says
    ├── CommissioningError                   do what the message says, then try again
    ├── BusError                             look at the CAN interface
    └── DriveError                           look at the drive
        ├── DriveStateError                  not possible in the present state
        ├── DriveTimeoutError                the drive did not answer
        ├── DriveIdentityError               another drive than configured
        └── DriveObjectError                 an object rejected or read back wrong

Their messages have the value, the bound and the unit.
"""

from __future__ import annotations

from argparse import ArgumentTypeError
from collections.abc import Callable, Iterator
from contextlib import contextmanager
import errno
import math
from pathlib import Path
import sys

INTERRUPTED = 130  # as a shell says of a command that Ctrl-C has ended
_REMEDIES = {
    **dict.fromkeys((errno.ENOSPC, errno.EDQUOT), 'free space on the disk'),
    **dict.fromkeys((errno.EACCES, errno.EPERM, errno.EROFS),
                    'choose a place where you may write, or change its owner'),
}


class ManipulatorError(Exception):
    """Base of every error that this package raises on purpose."""


# extras of the packages that are not in 'study'
EXTRAS = {'distributed': 'cluster', 'rosbags': 'calibration', 'scipy': 'calibration'}


def missing_package(error: ModuleNotFoundError) -> str:
    """Return what to say of a package that is not one of the machine's own needs."""
    name = str(error.name).partition('.')[0].lower()
    return (f'the Python package {name} is needed for this: sudo apt install python3-{name}, or '
            f"pip install the extra '{EXTRAS.get(name, 'study')}' of facade_manipulator")


def above_zero(text: str) -> float:
    """Return the number that an option of a command is given as; a type for argparse."""
    value = float(text)
    if not 0.0 < value < math.inf:
        raise ArgumentTypeError(f'{text} is no finite number above 0')
    return value


def os_error(error: OSError) -> str:
    """Return an error of the operating system as one sentence with its remedy."""
    where = f'{error.filename}: ' if error.filename else ''
    remedy = _REMEDIES.get(error.errno or 0)
    return f'{where}{error.strerror or error}' + (f'; next: {remedy}' if remedy else '')


def exit_status(
    name: str, action: Callable[[], int | None], failed: int = 1, interrupted: str = 'interrupted'
) -> int:
    """Run a command and return its exit status; an error is one line on standard error."""
    try:
        return action() or 0
    except ManipulatorError as error:
        message = str(error)
    except OSError as error:
        message = os_error(error)
    except ModuleNotFoundError as error:
        message = missing_package(error)
    except KeyboardInterrupt:
        message, failed = interrupted, INTERRUPTED
    print(f'{name}: {message}', file=sys.stderr)
    return failed


class ParameterError(ManipulatorError, ValueError):
    """A parameter is not finite, out of range or contradicts another one."""


@contextmanager
def file_errors(path: Path, done: str = 'written') -> Iterator[None]:
    """Raise a ParameterError that names a file if what is inside cannot write, or read, it."""
    try:
        yield
    except (OSError, ValueError) as error:  # matplotlib's of a file name without a known ending
        raise ParameterError(
            f'{path} cannot be {done}: {getattr(error, "strerror", None) or error}') from error


class InputError(ManipulatorError):
    """A message is rejected; `reason` is the key under which that is counted: ``'stale'``."""

    def __init__(self, reason: str, message: str) -> None:
        super().__init__(message)
        self.reason = reason

    @staticmethod
    def not_finite(what: str, value: float, unit: str = '') -> InputError:
        """Return the rejection of a number that is not finite, ready to be raised."""
        suffix = f' {unit}' if unit else ''
        return InputError(
            'not_finite', f'{what} = {value}{suffix} is not a finite number')

    @staticmethod
    def out_of_order(what: str, lateness: float) -> InputError:
        """Return the rejection of what came after something newer [s], ready to be raised."""
        return InputError(
            'out_of_order', f'{what} is {lateness:.3f} s older than the one before, expected a '
            'newer one')


def require_recent(what: str, age: float, oldest: float, lead: float) -> None:
    """
    Reject what is older than a bound [s], or was measured farther in the future than another.

    Raises an InputError with reason ``'stale'`` or ``'future'``.
    """
    if age > oldest:
        raise InputError('stale', f'{what} is {age:.3f} s old, bound {oldest:g} s')
    if -age > lead:
        raise InputError(
            'future', f'{what} is {-age:.3f} s from the future, bound {lead:g} s: are the '
            'clocks synchronised?')


class CalibrationError(ManipulatorError):
    """Measurements from which nothing can be calibrated; the message names them."""


class CommissioningError(ManipulatorError):
    """A step of commissioning was not done; the message says in what state the machine is."""


class LimitError(ManipulatorError):
    """
    A quantity, such as ``'q2'`` or ``'q3 - q1'``, lies beyond a limit of the machine.

    Value and bound are in the unit, ``''`` for a pure number; the relation of the value to the
    bound is ``'below'`` or ``'above'``.
    """

    reason = 'limit'

    def __init__(
        self, quantity: str, value: float, bound: float, unit: str, relation: str
    ) -> None:
        self.quantity = quantity
        self.value = value
        self.bound = bound
        self.unit = unit
        self.relation = relation
        suffix = f' {unit}' if unit else ''
        super().__init__(
            f'{quantity} = {value:.6g}{suffix} is {relation} the bound {bound:.6g}{suffix}')


class UnreachableError(LimitError):
    """The links are too short for the pose: no real solution of eqs 7-8."""

    reason = 'unreachable'


class StrokeLimitError(LimitError):
    """A carriage would leave the rail's stroke."""

    reason = 'stroke'


class CarriageGapError(LimitError):
    """Two carriages would come closer than the carriage gap."""

    reason = 'carriage_gap'


class SingularityError(LimitError):
    """The pose is singular, beyond a singularity or too badly conditioned."""

    reason = 'singularity'


class SetpointLimitError(LimitError):
    """A setpoint lies farther from the carriages than a stream may begin."""

    reason = 'far_setpoint'


class BusError(ManipulatorError):
    """The CAN interface is missing, down, bus-off or rejects frames."""


class DriveError(ManipulatorError):
    """Base of what one drive, or the group of three, reports."""


class DriveStateError(DriveError):
    """The request is not possible in the present state; the message says what to do first."""


class DriveTimeoutError(DriveError):
    """A drive did not answer within its time."""


class DriveIdentityError(DriveError):
    """A drive's type, vendor, product or serial number is not the configured one."""


class DriveObjectError(DriveError):
    """A drive rejected an object, or read it back with another value."""

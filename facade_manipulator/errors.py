"""
Exceptions of the package, grouped by the reaction expected from the caller.

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
    ├── CalibrationError                     follow the message, then measure again
    ├── CommissioningError                   follow the message, then try again
    ├── BusError                             check the CAN interface
    └── DriveError                           check the drive
        ├── DriveStateError                  not possible in the present state
        ├── DriveTimeoutError                the drive did not answer
        └── DriveObjectError                 an object or the identity is not as configured

Messages contain the value, the limit with its unit, and one next step.
"""

from __future__ import annotations

import errno
import math

NEXT = '; next: '  # precedes the next step of the operator in a message

# reason and next step of the failures of a user's file
_FILE_FAILURES = {
    errno.ENOENT: ('it does not exist', 'check the path'),
    errno.ENOTDIR: ('a part of its path is not a folder', 'check the path'),
    errno.EISDIR: ('it is a folder', 'name a file'),
    errno.EEXIST: ('a file has this name', 'name another folder'),
    errno.EACCES: ('this user has no permission', 'change its owner or permissions'),
    errno.EPERM: ('this user has no permission', 'change its owner or permissions'),
    errno.EROFS: ('its file system is read-only', 'name another folder'),
    errno.ENOSPC: ('its file system is full', 'free some space'),
}


def joined(*messages: str) -> str:
    """Join messages into one message, with their next steps at the end in the same order."""
    texts: list[str] = []
    steps: list[str] = []
    for message in messages:
        text, _, step = message.partition(NEXT)
        if text:
            texts.append(text)
        if step and step not in steps:
            steps.append(step)

    remaining = []
    for number, step in enumerate(steps, 1):
        # a later step may begin with an earlier one
        if not any(later.startswith(step) for later in steps[number:]):
            remaining.append(step)
    problem = '; '.join(texts)
    return f'{problem}{NEXT}{", then ".join(remaining)}' if remaining else problem


def attributed(subject: str, verb: str, reason: str) -> str:
    """Return ``'<subject> <verb>: <reason>'``; do not repeat the subject in the reason."""
    for known in ('rejected', 'failed'):
        _, found, rest = reason.rpartition(f'{subject} {known}: ')
        if found:
            return f'{found}{rest}'
    return f'{subject} {verb}: {reason.removeprefix(f"{subject} is ")}'


class ManipulatorError(Exception):
    """
    Base class of all errors that this package raises deliberately.

    `next_step` is the next step of the operator that ends a message without one.
    """

    next_step = ''

    def __init__(self, message: str = '') -> None:
        if self.next_step and NEXT not in message:
            message = f'{message}{NEXT}{self.next_step}'
        super().__init__(message)

    @property
    def problem(self) -> str:
        """Return the message without its next step, so that another next step can follow."""
        return str(self).partition(NEXT)[0]

    @property
    def remedy(self) -> str:
        """Return the next step contained in the message; ``''`` without a next step."""
        return str(self).partition(NEXT)[2]


class ParameterError(ManipulatorError, ValueError):
    """A parameter is not finite, is out of range, or contradicts another parameter."""


# decimals of a double: more digits show no further difference
_MOST_DIGITS = 17


def compared(
    value: float, limit: float, form: str = '.6g', limit_digits: int = 6
) -> tuple[str, str]:
    """
    Return the texts of a value and its limit, with enough digits that they compare alike.

    The format and the number of digits of the limit are minimums. A value above its limit is never
    printed as equal to this limit.
    """
    digits = int(form[1:-1])
    for more in range(_MOST_DIGITS):
        value_text = f'{value:.{digits + more}{form[-1]}}'
        limit_text = f'{limit:.{max(limit_digits, digits + more)}g}'
        shown_value = float(value_text)
        shown_limit = float(limit_text)
        is_below_alike = (shown_value < shown_limit) == (value < limit)
        if is_below_alike and (shown_value > shown_limit) == (value > limit):
            break
    return value_text, limit_text


def compared_magnitudes(
    value: float, limit: float, form: str = '.6g', limit_digits: int = 6
) -> tuple[str, str]:
    """Return the texts of a value of either sign and of the limit of its magnitude."""
    signed_limit = math.copysign(limit, value)
    value_text, limit_text = compared(value, signed_limit, form, limit_digits)
    return value_text, limit_text.removeprefix('-')


class InputError(ManipulatorError):
    """A message is rejected; `reason`, such as ``'stale'``, selects the counter of rejections."""

    #: next step after the rejection of a message, by its reason
    INPUT_STEPS = {
        'exception': 'report the traceback in the log of this node',
        'frame': 'correct the frame of the sender',
        'future': 'synchronise the clocks',
        'inconsistent': 'send the velocity of the path',
        'jump': 'check the estimator',
        'malformed': 'correct the sender',
        'names': 'correct the sender',
        'not_finite': 'correct the sender',
        'not_measured': 'check the sensor',
        'out_of_order': 'let one sender publish in the order of its stamps',
        'out_of_plane': 'correct the pose',
        'publishers': 'end one of the nodes',
        'quality': 'correct the quality of service of the publisher',
        'quaternion': 'normalise the quaternion',
        'range': 'check unit and range of the sensor',
        'stale': 'synchronise the clocks, or reduce the load of the computer',
        'tolerance': 'choose another tolerance',
    }

    def __init__(self, reason: str, message: str) -> None:
        self.next_step = self.INPUT_STEPS.get(
            reason, 'follow the next step on driver/status'
        )
        super().__init__(message)
        self.reason = reason

    @staticmethod
    def not_finite(quantity: str, value: float) -> InputError:
        """Return the error for a number that is not finite; the caller raises it."""
        return InputError('not_finite', f'{quantity} = {value} is not a finite number')

    @staticmethod
    def out_of_order(quantity: str, lateness: float) -> InputError:
        """Return the error for a message older than its predecessor by `lateness` [s]."""
        relation = f'is {lateness:.3f} s older than'
        if lateness < 0.0005:  # 0.000 s would explain nothing
            relation = 'has the stamp of, or is less than 1 ms older than,'
        return InputError('out_of_order', f'{quantity} {relation} the previous message')


# s, ten years: an older stamp is missing, or is a time since a start instead of since 1970
MISSING_STAMP_AGE = 3.2e8


def require_recent(
    quantity: str, age: float, maximum_age: float, maximum_lead: float
) -> None:
    """
    Reject a message if its age [s] is out of range; a stamp in the future has a negative age.

    Raises an InputError with reason ``'stale'`` or ``'future'``.
    """
    if not age <= maximum_age:  # NaN is also rejected
        age_text, limit = compared(age, maximum_age, '.3f')
        problem = f'{quantity} is {age_text} s old, above the limit {limit} s'
        if age > MISSING_STAMP_AGE:
            problem += f'{NEXT}stamp the message with the system time'
        raise InputError('stale', problem)
    if -age > maximum_lead:
        lead_text, limit = compared(-age, maximum_lead, '.3f')
        raise InputError(
            'future',
            f'{quantity} is {lead_text} s from the future, above the limit {limit} s',
        )


class CalibrationError(ManipulatorError):
    """The measurements do not determine the calibration; the message lists the parameters."""


class CommissioningError(ManipulatorError):
    """A commissioning step failed; the message describes the state of the machine."""


class LimitError(ManipulatorError):
    """
    A quantity, such as ``'q2'`` or ``'q3 - q1'``, exceeds a limit of the machine.

    Value and bound are in the unit, ``''`` for a pure number. The relation of the value to the
    bound completes the message, such as ``'below'`` or ``'not above'``. The parameter that sets
    the bound is named if there is one.
    """

    reason = 'limit'
    next_step = 'choose a pose inside the workspace'

    def __init__(
        self,
        quantity: str,
        value: float,
        bound: float,
        unit: str,
        relation: str,
        parameter: str = '',
    ) -> None:
        self.quantity = quantity
        self.value = value
        self.bound = bound
        self.unit = unit
        suffix = f' {unit}' if unit else ''
        source = f' ({parameter})' if parameter else ''
        value_text, bound_text = compared(value, bound)
        super().__init__(
            f'{quantity} = {value_text}{suffix} is {relation} the limit '
            f'{bound_text}{suffix}{source}'
        )


class UnreachableError(LimitError):
    """The links are too short for the pose: eqs 7-8 have no real solution."""

    reason = 'unreachable'
    next_step = 'choose a pose within the reach of the links'


class StrokeLimitError(LimitError):
    """A carriage would leave the stroke of the rail."""

    reason = 'stroke'
    next_step = 'choose a pose nearer to the middle of the rail'


class CarriageGapError(LimitError):
    """Two carriages would be closer than the carriage gap."""

    reason = 'carriage_gap'
    next_step = 'choose a pose with more distance between the carriages'


class SingularityError(LimitError):
    """The pose is singular, beyond a singularity, or too badly conditioned."""

    reason = 'singularity'
    next_step = 'choose a pose farther from the singularity'


class SetpointLimitError(LimitError):
    """A setpoint is too far from the carriages or from the previous setpoint."""

    reason = 'far_setpoint'
    next_step = 'begin the stream at end_effector_pose, within the limits of motion'


class BusError(ManipulatorError):
    """The CAN interface is missing, down or bus-off, or it rejects frames."""


class DriveError(ManipulatorError):
    """Base class of errors of one drive or of all three drives."""


class DriveStateError(DriveError):
    """The request is impossible in the present state; the message states the first step."""


class DriveTimeoutError(DriveError):
    """A drive did not answer in time."""


class DriveObjectError(DriveError):
    """
    A drive rejects an object, or its identity or an object differs from the configuration.

    `findings` are the messages that the message of the error joins, usually one for each object.
    """

    def __init__(self, *findings: str) -> None:
        super().__init__(joined(*findings))
        self.findings = findings


DISK_FULL = f'writing failed: the file system is full{NEXT}free some space'


def file_reason(error: OSError) -> str:
    """Return why a user's file cannot be used, without the file's path."""
    reason, _ = _FILE_FAILURES.get(error.errno or 0, (str(error.strerror), ''))
    return reason if error.filename is not None else str(error)


def file_sentence(error: OSError) -> str:
    """Describe the failure of a user's file in one sentence with its path and the next step."""
    if error.filename is None:
        # a write names no file
        is_full = error.errno == errno.ENOSPC
        return DISK_FULL if is_full else str(error)
    _, step = _FILE_FAILURES.get(error.errno or 0, ('', 'check this path'))
    return f'{error.filename} rejected: {file_reason(error)}; next: {step}'

"""Why the drives are stopped, and what the operator does about it."""

from __future__ import annotations

from dataclasses import dataclass, replace

CLEAR_REMEDY = 'remove the cause, clear the faults, then activate'
BUS_REMEDY = 'check the CAN bus, wait until it is back, clear the faults, then activate'
TARGET_REMEDY = 'check the source of the setpoints, clear the faults, then activate'
TRACKING_REMEDY = (
    'find out which carriage is held back (its load, its drive, controller.drive_lag), clear the '
    'faults, then activate')
COMPUTER_REMEDY = 'take load off this computer, clear the faults, then activate'
CONFIGURE_REMEDY = 'check its power and cable, then clean up and configure again'
NOT_RESPONDING_REMEDY = 'switch the power of the drives off, find out why, configure again'


@dataclass(frozen=True)
class Cause:
    """
    Why the group stopped.

    Attributes
    ----------
    message : str
        What happened.
    remedy : str
        The operator's next step.
    axis : str
        Which axis it comes from; ``''`` for none of them.
    cut_power : bool
        Whether the drives lose power once they stand still.
    configure_again : bool
        Whether clearing is not enough: the drives must be configured again.
    is_vague : bool
        Whether a further cause of the same axis says more.
    is_silence : bool
        Whether nothing was received from the drive, which a restart would explain.
    is_restart : bool
        Whether the drive has restarted.

    """

    message: str
    remedy: str = CLEAR_REMEDY
    axis: str = ''
    cut_power: bool = False
    configure_again: bool = False
    is_vague: bool = False
    is_silence: bool = False
    is_restart: bool = False

    def __str__(self) -> str:
        return f'{self.message}; next: {self.remedy}'

    def is_completed_by(self, later: Cause) -> bool:
        """Return whether a later cause completes this one: a silent drive has restarted."""
        return self.is_silence and later.is_restart and later.axis == self.axis

    def completed_by(self, later: Cause) -> Cause:
        """Return one cause with both messages, with the next step of the later one."""
        return replace(later, message=f'{self.message}; {later.message}')

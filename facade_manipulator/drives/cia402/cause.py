"""Why the drives are stopped, and what the operator does about it."""

from __future__ import annotations

from dataclasses import dataclass, replace

CLEAR_REMEDY = 'remove the cause, clear the faults, then activate'
BUS_REMEDY = 'see to the CAN bus, wait until it is back, clear the faults, then activate'
TARGET_REMEDY = 'see to the source of the setpoints, clear the faults, then activate'
COMPUTER_REMEDY = 'take load off this computer, clear the faults, then activate'
CONFIGURE_REMEDY = 'check its power and cable, then clean up and configure again'
DISOBEYED_REMEDY = 'switch the power of the drives off, find out why, configure again'


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
        Whether the drive was not heard, of which a restart would be the reason.
    is_restart : bool
        Whether the drive has begun again.

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
        """Tell whether a later cause is the rest of this story: a drive fell silent to restart."""
        return self.is_silence and later.is_restart and later.axis == self.axis

    def completed_by(self, later: Cause) -> Cause:
        """Return one cause that tells both, with the next step of the later one."""
        return replace(later, message=f'{self.message}; {later.message}')

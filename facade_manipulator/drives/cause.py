"""Why the drives are stopped, and what the operator does about it."""

from __future__ import annotations

from dataclasses import dataclass


class Remedy:
    """Action of the operator before the requests of the `next_step` of a cause."""

    CLEAR = 'remove the cause'
    BUS = 'check the CAN bus, wait until it is back'
    TARGET = 'check the source of the setpoints'
    TRACKING = (
        'find out which carriage is held back (its load, its drive, controller.drive_lag)')
    COMPUTER = 'take load off this computer'
    CONFIGURE = 'check its power and cable'
    OTHER_MASTER = (
        'find out who else commands the drives (a second driver, a configuration tool) and end it')
    NOT_RESPONDING = 'switch the power of the drives off, find out why'


@dataclass(frozen=True)
class Cause:
    """Why the group stopped."""

    message: str  #: what happened
    remedy: str = Remedy.CLEAR  #: as of `Remedy`; ``''`` for nothing
    axis: str = ''  #: which axis it comes from; ``''`` for none of them
    cut_power: bool = False  #: whether the drives lose power once they stand still
    #: whether clearing is not enough: the drives must be configured again
    configure_again: bool = False
    home_again: bool = False  #: whether a position is lost
    #: whether a further cause of the same axis may say more: why the drive is silent, or in fault
    is_vague: bool = False

    def __str__(self) -> str:
        return f'{self.message}; next: {self.next_step}'

    @property
    def next_step(self) -> str:
        """What to do, then which requests to make, by their names and in their order."""
        requests = 'clear_faults, activate'
        if self.configure_again:
            requests = 'cleanup, configure, home, activate'
        elif self.home_again:
            requests = 'clear_faults, home, activate'
        return f'{self.remedy}, then {requests}' if self.remedy else requests

    def is_explained_by(self, later: Cause) -> bool:
        """Return whether a later cause says more of the same axis and asks for no less."""
        return (self.is_vague and not later.is_vague and later.axis == self.axis
                and later.configure_again >= self.configure_again)

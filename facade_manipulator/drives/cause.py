"""Why the drives are stopped, and what the operator does about it."""

from __future__ import annotations

from dataclasses import dataclass

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
    sentence : str
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

    """

    sentence: str
    remedy: str = CLEAR_REMEDY
    axis: str = ''
    cut_power: bool = False
    configure_again: bool = False
    is_vague: bool = False

    def __str__(self) -> str:
        return f'{self.sentence}; next: {self.remedy}'

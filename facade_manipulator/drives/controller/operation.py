"""What every request of an operator has in common: it begins, is polled, and ends."""

from __future__ import annotations

from concurrent.futures import Future
from typing import Any, ClassVar

from facade_manipulator.drives.cia402 import Group
from facade_manipulator.drives.controller.session import Session
from facade_manipulator.drives.controller.snapshot import ControllerState
from facade_manipulator.errors import (
    DriveError,
    DriveFaultError,
    DriveStateError,
    ManipulatorError,
)


class Operation:
    """
    A request under way, in the control thread.

    `begin` and `poll` raise a ManipulatorError with the message for the operator; the message
    of a success is what they return.

    Parameters
    ----------
    session : Session

    """

    state: ClassVar[ControllerState]
    interrupts = False
    outlives_bus: ClassVar[bool] = False

    def __init__(self, session: Session) -> None:
        self.session = session

    @property
    def name(self) -> str:
        """What the operator calls it."""
        return type(self).__name__.lower()

    @property
    def group(self) -> Group:
        """
        The state machine of the drives.

        Raises
        ------
        DriveStateError
            The drives are not configured.

        """
        if self.session.group is None:
            raise DriveStateError(f'{self.name} is not possible, the drives are not configured')
        return self.session.group

    def begin(self, now: float) -> str | None:
        """Begin; return the message if there is nothing to do."""

    def poll(self, now: float) -> str | None:
        """Return the message once it is done, None until then."""

    def give_up(self) -> None:
        """Tidy up after a failure."""

    def require_allowed(self) -> None:
        """
        Raise why no drive may have power.

        Raises
        ------
        DriveStateError
            Power is forbidden.

        """
        if self.session.forbidden:
            raise DriveStateError(f'{self.name} is not possible: {self.session.forbidden}; '
                                  'wait until whoever set it takes it back')

    def require_not_stopped(self) -> None:
        """
        Raise why the drives were stopped meanwhile.

        Raises
        ------
        DriveFaultError
            They are stopped.

        """
        if self.session.is_stopped:
            raise DriveFaultError(self.group.cause.message)


def result_of(job: Future) -> Any:
    """Return the worker's result, or raise its error with a message for an operator."""
    error = job.exception()
    if error is None or isinstance(error, ManipulatorError):
        return job.result()
    raise DriveError(f'checking the drives failed: {type(error).__name__}: {error}') from error

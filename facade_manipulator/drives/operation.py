"""What every request of an operator has in common: it begins, is polled, and ends."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator
from concurrent.futures import Future
from typing import Any, ClassVar, TypeVar

from facade_manipulator.drives.commissioning import Commissioning
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.exchange import CyclicExchange
from facade_manipulator.drives.group import Group
from facade_manipulator.drives.monitor import require_dead_master_stop
from facade_manipulator.drives.session import Session
from facade_manipulator.errors import BusError, DriveError, DriveStateError, ManipulatorError

Result = TypeVar('Result')
Steps = Generator[None, float, Any]  # each takes a cycle, whose time [s] is sent


class Operation(ABC):
    """
    A request under way, in the control thread.

    `run` does it from begin to end: ``now = yield`` waits for the next cycle, what it returns is
    the message of a success, a ManipulatorError has that of a failure. One before the first
    ``yield`` rejects the request; after a later one `give_up` tidies up.
    """

    state: ClassVar[ControllerState]
    interrupts = False
    _steps: Steps
    outlives_bus: ClassVar[bool] = False

    def __init__(self, session: Session) -> None:
        self.session = session
        self.future: Future[Any] = Future()
        self.future.set_running_or_notify_cancel()  # from here on nobody can cancel it

    @property
    def name(self) -> str:
        """What the operator calls it."""
        return type(self).__name__.lower()

    @property
    def group(self) -> Group:
        """The state machine of the drives; a DriveStateError if they are not configured."""
        if self.session.group is None:
            raise DriveStateError(f'{self.name} is not possible, the drives are not configured')
        return self.session.group

    @property
    def open_bus(self) -> tuple[CyclicExchange, Commissioning]:
        """The bus, and the worker's access to the drives on it; a BusError if it is not open."""
        session = self.session
        if session.lost:
            raise BusError(f'{self.name} is not possible, the bus is lost: {session.lost}')
        if session.exchange is None or session.commissioning is None:
            raise BusError(f'{self.name} is not possible, the bus is not open')
        return session.exchange, session.commissioning

    @abstractmethod
    def run(self, now: float) -> Steps:
        """Do what is asked for, from a time on [s]."""

    def begin(self, now: float) -> Any:
        """Begin; return the message if there is nothing to do."""
        self._steps = self.run(now)
        return self.poll(None)

    def poll(self, now: float | None) -> Any:
        """Go on; return the message once it is done, None until then."""
        try:
            next(self._steps) if now is None else self._steps.send(now)
        except StopIteration as end:
            return end.value
        return None

    def done(self, work: Callable[[], Result]) -> Generator[None, float, Result]:
        """Wait until the worker has done something; return its result."""
        job = self.session.worker.submit(work)
        yield  # it has begun: whatever fails now, `give_up` closes the bus
        while not job.done():
            yield
        return result_of(job)

    def give_up(self) -> None:  # noqa: B027, a hook: most have nothing to tidy up
        """Tidy up after a failure."""

    def require_allowed(self) -> None:
        """
        Raise a DriveStateError that says why no drive may have power.

        It is forbidden, or would stay on without this computer.
        """
        require_dead_master_stop(self.name, self.session.monitors, self.session.settings)
        if self.session.forbidden:
            raise DriveStateError(f'{self.name} is not possible: {self.session.forbidden}')

    def until(self, *states: ControllerState) -> Steps:
        """
        Wait until all drives are where one of some states wants them.

        Raises a DriveError that says why they were stopped meanwhile.
        """
        while not any(map(self.session.has_done, states)):
            yield
            if self.session.is_stopped:
                raise DriveError(self.group.reason)


def result_of(job: Future[Result]) -> Result:
    """Return the worker's result, or raise its error with a message for an operator."""
    error = job.exception()
    if error is None or isinstance(error, ManipulatorError):
        return job.result()
    raise DriveError(f'checking the drives failed: {type(error).__name__}: {error}') from error

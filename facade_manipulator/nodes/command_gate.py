"""Gate of compensator and ik_service for commands sent before the drives are active."""

from __future__ import annotations

from collections.abc import Callable
import math
from time import monotonic
from typing import Any, Generic, Protocol, TypeVar

from facade_manipulator import topics
from facade_manipulator.errors import InputError, ManipulatorError, NEXT
from facade_manipulator.nodes.conversions import ros_time
from facade_manipulator.nodes.driver_status import (
    DRIVER_SILENCE,
    DriverStatus,
    SILENT,
    STATUS_PERIOD,
)
from facade_manipulator.nodes.node_subscriptions import PublisherWatch

GATE_PERIOD = 0.05  # s, between two updates of a gate


class Command(Protocol):
    """Command (a goal or a pose) with its time of reception."""

    @property
    def received(self) -> float:
        """Return the time of reception [s, monotonic]."""


C = TypeVar('C', bound=Command)


class CommandGate(Generic[C]):
    """
    Gate that passes only the commands received while the drives are active.

    The gate is open while driver/status reports active drives. It is also open if no driver/status
    was received within `PATIENCE` of the start, because a driver of another make publishes no
    status.

    A closed gate holds the newest command for `PATIENCE`, because a command that follows the
    activation may arrive before the driver's status. The command passes if it was received after
    the activation. Otherwise it is rejected once.

    The node calls `offer` for each command, `watch_driver` once, and `update` every `GATE_PERIOD`.
    Times are on the monotonic clock [s], because the system clock may be set.

    Parameters
    ----------
    follow : callable
        Receives a command that passes.
    reject : callable
        Receives a command that does not pass, and the error: that of `follow`, or `refusal`.
    end : callable
        Called when the commands that have passed must no longer be followed.
    repeat : str
        Next step of the operator who sends a rejected command again.

    Attributes
    ----------
    status : DriverStatus or None
        None before the first message, `SILENT` after `SILENCE` without a message.
    held : command or None
        Command that waits for the status of the driver.

    """

    # s, for the first driver/status after the start, and for the status after a command
    PATIENCE = STATUS_PERIOD
    SILENCE = DRIVER_SILENCE

    def __init__(
        self,
        follow: Callable[[C], None],
        reject: Callable[[C, ManipulatorError], None],
        end: Callable[[], None],
        repeat: str,
    ) -> None:
        self._follow = follow
        self._reject = reject
        self._end = end
        self._repeat = repeat
        self.status: DriverStatus | None = None
        self._opened = math.inf  # commands received before do not pass
        self._deadline = math.inf  # of the next status; set by the first update
        self.held: C | None = None
        self._passed = -math.inf  # reception of the newest command that has passed

    @property
    def is_open(self) -> bool:
        """Return whether the gate passes commands."""
        return self._opened < math.inf

    @property
    def has_passed(self) -> bool:
        """Return whether the gate has passed a command since it opened."""
        return self._passed >= self._opened > -math.inf

    def offer(self, command: C) -> None:
        """Follow a command, or hold it until the driver status decides."""
        self.update(command.received)
        self.held = command
        self._decide()

    def withdraw(self) -> bool:
        """Drop the held command; return whether a command was held."""
        is_held = self.held is not None
        self.held = None
        return is_held

    def receive(self, now: float, system_time: float, status: DriverStatus) -> None:
        """Apply a driver/status; measure the age of the activation with the system clock [s]."""
        self._deadline = now + self.SILENCE
        before = self.status
        self.status = status
        if math.isinf(status.active_since):
            self._open(math.inf)
        elif before is SILENT:
            self._open(now)  # a driver that returns follows no earlier command
        elif before is None or status.active_since != before.active_since:
            # the system clock may have been set back
            age = max(system_time - status.active_since, 0.0)
            self._open(now - age)

    def receive_invalid(self) -> None:
        """Close the gate if the first status of the driver is rejected."""
        if self.status is None:
            self._become_silent()

    def update(self, now: float) -> None:
        """Apply the time-outs of the driver status and of the held command."""
        if self._deadline == math.inf:
            # not in the constructor: a busy process may begin its callbacks late
            self._deadline = now + self.PATIENCE
        elif now > self._deadline and self.status is None:
            self._open(-math.inf)
        elif now > self._deadline and self.status is not SILENT:
            self._become_silent()
        held = self.held
        if held is not None and now > held.received + self.PATIENCE:
            self._reject_held(held)

    def refusal(self, next_step: str) -> InputError:
        """Return why the gate does not pass commands, with the operator's next step at the end."""
        if self.status is None or self.is_open:
            return InputError(
                'inactive',
                f'the command was sent before the drives were activated{NEXT}{next_step}',
            )
        first = self.status.next_step or 'wait until the drives are active'
        return InputError(
            self.status.state, f'{self.status}{NEXT}{first}, then {next_step}'
        )

    def _become_silent(self) -> None:
        self.status = SILENT
        self._open(math.inf)

    def _open(self, since: float) -> None:
        """Pass commands received after a time [s]; infinity closes the gate."""
        if since == self._opened:
            return
        self._opened = since
        if self._passed < since:
            self._end()
        self._decide()

    def _decide(self) -> None:
        """Follow or reject the held command, unless a driver status is still expected."""
        held = self.held
        if held is None:
            return
        if held.received >= self._opened:
            self.held = None
            try:
                self._follow(held)
                self._passed = held.received
            except ManipulatorError as error:
                self._reject(held, error)
        elif self.is_open or self.status is SILENT:
            self._reject_held(held)

    def _reject_held(self, held: C) -> None:
        self.held = None
        self._reject(held, self.refusal(self._repeat))


def watch_driver(gate: CommandGate[Any], inputs: PublisherWatch) -> None:
    """Subscribe to driver/status on behalf of a gate."""

    def receive(message: Any) -> None:
        gate.receive(monotonic(), ros_time(), DriverStatus.from_message(message))

    inputs.subscribe(topics.DRIVER_STATUS, receive, lambda *_: gate.receive_invalid())

"""Messages on driver/status, from the driver to the compensator and the ik_service."""

from __future__ import annotations

import math
from typing import NamedTuple

from diagnostic_msgs.msg import DiagnosticStatus

from facade_manipulator.errors import InputError
from facade_manipulator.nodes.planar_messages import status_values

STATUS_PERIOD = 0.5  # s, between two equal messages on driver/status
# s without a message, after which the driver counts as silent
DRIVER_SILENCE = 4 * STATUS_PERIOD


def state_sentence(state: str) -> str:
    """Return a sentence for a state such as ``'active'`` or ``'bus lost'``."""
    for condition in ('lost', 'silent'):
        subject, found, _ = state.partition(f' {condition}')
        if found:
            return f'the {subject} is {condition}'
    return f'the drives are {state}'


class DriverStatus(NamedTuple):
    """State of the drives as received on driver/status."""

    state: str  #: such as ``'active'`` or ``'stopped'``
    activity: str  #: of the carriages while the state is active, such as ``'holding'``
    next_step: (
        str  #: of the operator before goals are followed, ``''`` if they are followed
    )
    #: since when the drives follow setpoints [s, ROS time]; infinite while they do not
    active_since: float = math.inf

    def __str__(self) -> str:
        """Return the state, worded as the reason of a rejection."""
        return 'the driver is silent' if self is SILENT else state_sentence(self.state)

    @staticmethod
    def from_message(message: DiagnosticStatus) -> DriverStatus:
        """Read a message; raise an InputError if another program has sent it."""
        values = status_values(message)
        try:
            since = float(values['active since'])
            if not since > -math.inf:  # also rejects NaN
                raise ValueError(f'active since {since}')
            return DriverStatus(
                values['state'], values['activity'], values['next step'], since
            )
        except (KeyError, ValueError) as error:
            raise InputError(
                'names', f'driver/status rejected: {error}; next: end the other program'
            ) from None


SILENT = DriverStatus('silent', 'unknown', 'check whether the driver still runs')

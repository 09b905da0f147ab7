"""States of the group of axes; the steps of a plan lead from state to state."""

from __future__ import annotations

from enum import Enum


class GroupState(Enum):
    """State of the group; its value is shown to the operator as the controller state."""

    INACTIVE = 'inactive'  #: without power
    HOMING = 'homing'
    ACTIVATING = 'activating'
    ACTIVE = 'active'  #: the drives follow setpoints
    HALTED = 'halted'  #: the drives hold their positions with power
    DEACTIVATING = 'deactivating'
    STOPPED = 'stopped'  #: by a cause, until it is cleared
    CLEARING = 'clearing faults'

    __hash__ = object.__hash__

    @property
    def has_power(self) -> bool:
        """Return whether the drives should have power in this state."""
        return self in _WITH_POWER


_WITH_POWER = frozenset(
    {
        GroupState.HOMING,
        GroupState.ACTIVATING,
        GroupState.ACTIVE,
        GroupState.HALTED,
        GroupState.DEACTIVATING,
    }
)

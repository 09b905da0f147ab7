"""States of the group of axes, which the steps of a plan lead through."""

from __future__ import annotations

from enum import Enum


class GroupState(Enum):
    """State of the group; the operator reads its value as the state of the controller."""

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
        """Return whether the drives are meant to have power."""
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

"""
What the controller, and with it the group of axes, is doing.

The states of lifecycle (ROS) and statusword (CiA 402) are given; this is ours, between them.
"""

from __future__ import annotations

from enum import Enum
from functools import cached_property


class ControllerState(Enum):
    """What the controller is doing; the group walks through those that the drives take part in."""

    UNCONFIGURED = 'unconfigured'
    CONFIGURING = 'configuring'
    INACTIVE = 'inactive'
    HOMING = 'homing'
    ACTIVATING = 'activating'
    HOLDING = 'holding'  #: of the group, on the way to active: power is on, no target is followed
    ACTIVE = 'active'
    RAMPING = 'coming to rest'  #: of the group, on the way to halted or inactive
    HALTING = 'halting'
    HALTED = 'halted'
    DEACTIVATING = 'deactivating'
    STOPPING = 'stopping'  #: of the group, on the way to stopped
    STOPPED = 'stopped'
    CLEARING = 'clearing faults'
    TESTING = 'testing itself'
    BUS_LOST = 'bus lost'
    CLEANING_UP = 'cleaning up'
    CLOSED = 'closed'
    LOST = 'control loop lost'

    __hash__ = object.__hash__

    @cached_property
    def is_following(self) -> bool:
        """Whether targets are commanded, be it those of the moment that power came."""
        return self in _FOLLOWING

    @cached_property
    def is_active(self) -> bool:
        """Whether the drives follow setpoints, or are on the way there or back."""
        return self in _ACTIVE

    @cached_property
    def has_power(self) -> bool:
        """Whether the drives are meant to have power."""
        return self in _ACTIVE or self is ControllerState.HOMING

    @cached_property
    def is_stopped(self) -> bool:
        """Whether something has stopped the drives, or is stopping them."""
        return self is ControllerState.STOPPING or self is ControllerState.STOPPED


_FOLLOWING = frozenset({
    ControllerState.HOLDING, ControllerState.ACTIVE, ControllerState.RAMPING,
    ControllerState.HALTED,
})
_ACTIVE = _FOLLOWING | {
    ControllerState.ACTIVATING, ControllerState.HALTING, ControllerState.DEACTIVATING}

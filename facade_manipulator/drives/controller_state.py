"""The state of the controller, between the lifecycle (ROS) and the statusword (CiA 402)."""

from __future__ import annotations

from enum import Enum


class ControllerState(Enum):
    """The state of the controller: that of the group of axes, of a request or of the bus."""

    # of the group
    INACTIVE = 'inactive'
    HOMING = 'homing'
    ACTIVATING = 'activating'
    ACTIVE = 'active'
    HALTED = 'halted'
    DEACTIVATING = 'deactivating'
    STOPPED = 'stopped'
    CLEARING = 'clearing faults'
    # of a request
    CONFIGURING = 'configuring'
    HALTING = 'halting'
    TESTING = 'testing itself'
    CLEANING_UP = 'cleaning up'
    # of the bus and the control loop
    UNCONFIGURED = 'unconfigured'
    BUS_LOST = 'bus lost'
    CLOSED = 'closed'
    LOST = 'control loop lost'

    __hash__ = object.__hash__

    @property
    def is_active(self) -> bool:
        """Return whether the drives follow setpoints, or are on the way there or back."""
        return self in _ACTIVE

    @property
    def has_power(self) -> bool:
        """Return whether the drives are meant to have power."""
        return self in _ACTIVE or self is ControllerState.HOMING


_ACTIVE = frozenset({
    ControllerState.ACTIVATING, ControllerState.ACTIVE, ControllerState.HALTING,
    ControllerState.HALTED, ControllerState.DEACTIVATING})

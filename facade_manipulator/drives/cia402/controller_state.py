"""
What the controller, and with it the group of axes, is doing.

The states of lifecycle (ROS) and statusword (CiA 402) are given; this is ours, between them.
"""

from __future__ import annotations

from enum import Enum


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


ACTIVE_STATES = frozenset({
    ControllerState.ACTIVATING, ControllerState.HOLDING, ControllerState.ACTIVE,
    ControllerState.RAMPING, ControllerState.HALTING, ControllerState.HALTED,
    ControllerState.DEACTIVATING,
})
WITH_POWER = ACTIVE_STATES | {ControllerState.HOMING}
FOLLOWING_STATES = frozenset({
    ControllerState.HOLDING, ControllerState.ACTIVE, ControllerState.RAMPING,
    ControllerState.HALTED,
})
STOPPED_STATES = frozenset({ControllerState.STOPPING, ControllerState.STOPPED})

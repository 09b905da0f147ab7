"""
What the group of axes can be doing, and the lists of steps that lead from one to the next.

All three drives must have done a step before any takes the next.
"""

from __future__ import annotations

from enum import Enum

from facade_manipulator.drives.cia402 import axis as steps
from facade_manipulator.drives.cia402.axis import Step
from facade_manipulator.drives.cia402.states import Mode


class Phase(Enum):
    """What the group is doing."""

    OFF = 'inactive'
    ENABLING = 'activating'
    HOLDING = 'holding'
    RUNNING = 'active'
    RAMPING = 'coming to rest'
    HALTED = 'halted'
    DISABLING = 'deactivating'
    HOMING = 'homing'
    STOPPING = 'stopping'
    STOPPED = 'stopped'
    RESETTING = 'clearing faults'

    __hash__ = object.__hash__


POWERED_PHASES = frozenset({
    Phase.ENABLING, Phase.HOLDING, Phase.RUNNING, Phase.RAMPING, Phase.HALTED, Phase.DISABLING,
    Phase.HOMING,
})
FOLLOWING_PHASES = frozenset({Phase.HOLDING, Phase.RUNNING, Phase.RAMPING, Phase.HALTED})
STOPPED_PHASES = frozenset({Phase.STOPPING, Phase.STOPPED})


Plan = tuple[tuple[Phase, Step], ...]


def _plan(*parts: tuple[Phase, tuple[Step, ...]]) -> Plan:
    return tuple((phase, step) for phase, steps_ in parts for step in steps_)


_CSP = Mode.CYCLIC_SYNCHRONOUS_POSITION
OFF = _plan((Phase.OFF, (steps.POWER_OFF,)))
POWER_DOWN = _plan((Phase.DISABLING, steps.POWER_DOWN)) + OFF
HALT = _plan((Phase.RAMPING, (steps.COME_TO_REST,)), (Phase.HALTED, (steps.FOLLOW,)))
DISABLE = _plan((Phase.RAMPING, (steps.COME_TO_REST,))) + POWER_DOWN
FOLLOW = _plan((Phase.RUNNING, (steps.FOLLOW,)))
END_HOMING = _plan((Phase.DISABLING, (steps.END_HOMING, steps.FOLLOW))) + POWER_DOWN
HOME = _plan(
    (Phase.ENABLING, steps.power_on(Mode.HOMING)), (Phase.HOMING, (steps.HOME,))) + END_HOMING
# not done before a drive has shown what the command before, still on its way, has done
GIVE_UP_ENABLING = _plan((Phase.DISABLING, (steps.POWER_OFF._replace(min_cycles=4),))) + OFF
STOP = _plan((Phase.STOPPING, (steps.QUICK_STOP,)), (Phase.STOPPED, (steps.STAY_STOPPED,)))
CUT_POWER = _plan((Phase.STOPPED, (steps.CUT_POWER,)))
STOP_AND_CUT_POWER = _plan((Phase.STOPPING, (steps.QUICK_STOP, steps.CUT_POWER))) + CUT_POWER
RESET = _plan((Phase.RESETTING, steps.RESET_FAULT)) + OFF
# what a halt begins in each phase; in the others nothing is commanded to move
HALTS = {
    Phase.ENABLING: GIVE_UP_ENABLING,
    Phase.HOLDING: DISABLE,
    Phase.RUNNING: HALT,
    Phase.RAMPING: HALT,
    Phase.HALTED: HALT,
    Phase.HOMING: END_HOMING,
}


def enable_plan(hold_cycles: int) -> Plan:
    """Return the plan that powers on, holds for some cycles, and follows."""
    hold = steps.FOLLOW._replace(purpose='hold', min_cycles=hold_cycles)
    return _plan((Phase.ENABLING, steps.power_on(_CSP)), (Phase.HOLDING, (hold,))) + FOLLOW

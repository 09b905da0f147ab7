"""
The lists of steps that lead the group of axes from one state to the next.

All three drives must have done a step before any takes the next.
"""

from __future__ import annotations

from facade_manipulator.drives import axis as steps
from facade_manipulator.drives.axis import Step
from facade_manipulator.drives.controller_state import ControllerState as Doing
from facade_manipulator.drives.states import Mode

Plan = tuple[tuple[Doing, Step], ...]


def _plan(*parts: tuple[Doing, tuple[Step, ...]]) -> Plan:
    return tuple((state, step) for state, steps_ in parts for step in steps_)


_CSP = Mode.CYCLIC_SYNCHRONOUS_POSITION
OFF = _plan((Doing.INACTIVE, (steps.POWER_OFF,)))
POWER_DOWN = _plan((Doing.DEACTIVATING, steps.POWER_DOWN)) + OFF
HALT = _plan((Doing.RAMPING, (steps.COME_TO_REST,)), (Doing.HALTED, (steps.FOLLOW,)))
DISABLE = _plan((Doing.RAMPING, (steps.COME_TO_REST,))) + POWER_DOWN
FOLLOW = _plan((Doing.ACTIVE, (steps.FOLLOW,)))
END_HOMING = _plan((Doing.DEACTIVATING, (steps.END_HOMING, steps.FOLLOW))) + POWER_DOWN
HOME = _plan(
    (Doing.ACTIVATING, steps.power_on(Mode.HOMING)), (Doing.HOMING, (steps.HOME,))) + END_HOMING
# not done before a drive has shown what the command before, still on its way, has done
GIVE_UP_ENABLING = _plan((Doing.DEACTIVATING, (steps.POWER_OFF._replace(min_cycles=4),))) + OFF
STOP = _plan((Doing.STOPPING, (steps.QUICK_STOP,)), (Doing.STOPPED, (steps.STAY_STOPPED,)))
CUT_POWER = _plan((Doing.STOPPED, (steps.CUT_POWER,)))
STOP_AND_CUT_POWER = _plan((Doing.STOPPING, (steps.QUICK_STOP, steps.CUT_POWER))) + CUT_POWER
RESET = _plan((Doing.CLEARING, steps.RESET_FAULT)) + OFF
# what a halt begins in each state; in the others nothing is commanded to move
HALTS = {
    Doing.ACTIVATING: GIVE_UP_ENABLING,
    Doing.HOLDING: DISABLE,
    Doing.ACTIVE: HALT,
    Doing.RAMPING: HALT,
    Doing.HALTED: HALT,
    Doing.HOMING: END_HOMING,
}


def enable_plan(hold_cycles: int) -> Plan:
    """Return the plan that powers on, holds for some cycles, and follows."""
    hold = steps.FOLLOW._replace(purpose='hold', min_cycles=hold_cycles)
    return _plan((Doing.ACTIVATING, steps.power_on(_CSP)), (Doing.HOLDING, (hold,))) + FOLLOW

"""
Tables of the steps that lead the group of axes from one state to the next.

All three drives must have completed a step before any drive receives the next.
"""

from __future__ import annotations

from typing import NamedTuple

from facade_manipulator.drives.group_state import GroupState
from facade_manipulator.drives.states import Controlword, Mode, State

# states of the group in which the drives receive power or keep it
_POWERING = frozenset(
    {
        GroupState.HOMING,
        GroupState.ACTIVATING,
        GroupState.ACTIVE,
        GroupState.HALTED,
    }
)


class Step(NamedTuple):
    """Step: a controlword, and the CiA 402 states that drives reach after this command."""

    state: GroupState  #: of the group during the step
    purpose: str  #: completes the message "q2 did not …"
    controlword: int
    goal: frozenset[State]  #: states of a drive that has done the step
    via: frozenset[State] = frozenset()  #: states of a drive on its way there
    #: mode of operation to command, and to see displayed at the end; None for any
    mode: int | None = Mode.CYCLIC_SYNCHRONOUS_POSITION
    to_rest: bool = False  #: whether the step lasts until the carriage is at rest
    min_cycles: int = 1  #: smallest number of cycles that the step lasts
    follows: bool = (
        False  #: whether targets are commanded, those of the power-on included
    )

    @property
    def is_without_power(self) -> bool:
        """Return whether the command of the step only takes power away."""
        may_power_on = self.state in _POWERING
        return not may_power_on and self.controlword != Controlword.ENABLE_OPERATION


Plan = tuple[Step, ...]


_ANY = frozenset(State)
_OFF = frozenset({State.SWITCH_ON_DISABLED})
_READY = frozenset({State.READY_TO_SWITCH_ON})
_ON = frozenset({State.SWITCHED_ON})
_ENABLED = frozenset({State.OPERATION_ENABLED})
FAULT_STATES = frozenset({State.FAULT, State.FAULT_REACTION_ACTIVE})


def _power_on(mode: int) -> Plan:
    """Return the steps from switch on disabled to operation enabled in a mode of operation."""
    begin = GroupState.ACTIVATING
    return (
        Step(
            begin,
            'select its mode of operation',
            Controlword.DISABLE_VOLTAGE,
            _OFF,
            mode=mode,
        ),
        Step(begin, 'get ready to switch on', Controlword.SHUTDOWN, _READY, _OFF, mode),
        Step(begin, 'switch on', Controlword.SWITCH_ON, _ON, _READY, mode),
        Step(
            begin, 'enable operation', Controlword.ENABLE_OPERATION, _ENABLED, _ON, mode
        ),
    )


_END = GroupState.DEACTIVATING
_CLEAR = GroupState.CLEARING
OFF = (
    Step(
        GroupState.INACTIVE,
        'switch off',
        Controlword.DISABLE_VOLTAGE,
        _OFF,
        _ANY - FAULT_STATES,
        mode=None,
    ),
)
FOLLOW = (
    Step(
        GroupState.ACTIVE,
        'stay in operation',
        Controlword.ENABLE_OPERATION,
        _ENABLED,
        follows=True,
    ),
)
_FOLLOW = FOLLOW[0]
POWER_DOWN = (  # a drive may skip states while it powers down, not while it powers on
    Step(
        _END,
        'disable operation',
        Controlword.DISABLE_OPERATION,
        _ON | _READY | _OFF,
        _ENABLED,
    ),
    Step(_END, 'shut down', Controlword.SHUTDOWN, _READY | _OFF, _ON),
    Step(_END, 'switch off', Controlword.DISABLE_VOLTAGE, _OFF, _READY | _ON),
    *OFF,
)
_RAMP = _FOLLOW._replace(state=_END, purpose='come to rest', to_rest=True)
DISABLE = (_RAMP, *POWER_DOWN)
END_HOMING = (
    Step(
        _END,
        'come to rest after homing',
        Controlword.ENABLE_OPERATION,
        _ENABLED,
        mode=Mode.HOMING,
        to_rest=True,
        min_cycles=3,
    ),
    _FOLLOW._replace(state=_END, follows=False),
    *POWER_DOWN,
)
HOME_AXES = (
    *_power_on(Mode.HOMING),
    Step(
        GroupState.HOMING,
        'hold for homing',
        Controlword.ENABLE_OPERATION,
        _ENABLED,
        mode=Mode.HOMING,
    ),
    *END_HOMING,
)
_STOP = Step(
    GroupState.STOPPED,
    'stop',
    Controlword.QUICK_STOP,
    _ANY - _ENABLED,
    _ANY,
    mode=None,
    to_rest=True,
)
STOP_AXES = (_STOP, _STOP._replace(purpose='stay stopped', to_rest=False))
CUT_POWER = (
    Step(
        GroupState.STOPPED,
        'lose power',
        Controlword.DISABLE_VOLTAGE,
        _OFF | FAULT_STATES,
        _ANY,
        mode=None,
    ),
)
STOP_AND_CUT_POWER = (_STOP, *CUT_POWER, *CUT_POWER)
RESET = (
    Step(
        _CLEAR,
        'leave the quick stop',
        Controlword.DISABLE_VOLTAGE,
        _OFF | frozenset({State.FAULT}),
        _ANY,
        mode=None,
    ),
    Step(_CLEAR, 'take the fault reset', Controlword.FAULT_RESET, _ANY, mode=None),
    Step(_CLEAR, 'leave the fault', Controlword.DISABLE_VOLTAGE, _OFF, _ANY, mode=None),
    *OFF,
)


def enable_plan(hold_cycles: int) -> Plan:
    """Return the plan: power on, hold for a number of cycles, then follow targets."""
    hold = _FOLLOW._replace(
        state=GroupState.ACTIVATING, purpose='hold', min_cycles=hold_cycles
    )
    return *_power_on(Mode.CYCLIC_SYNCHRONOUS_POSITION), hold, *FOLLOW


HALT_AXES = (
    _RAMP._replace(state=GroupState.HALTED),
    _FOLLOW._replace(state=GroupState.HALTED),
)
# the drives first show the effect of the previous command, which is still on its way
GIVE_UP_ENABLING = (OFF[0]._replace(state=_END, min_cycles=4), *OFF)


def halt_plan(step: Step, is_confirmed: bool) -> Plan | None:
    """
    Return the plan that halts during a step; None if the present plan continues.

    Only after a confirmed activation do the carriages hold with power. Otherwise the halt cancels
    a homing or an activation, and powers the drives off. A plan that already ends in the required
    state continues, because a repeated halt must not extend its time.
    """
    if step.state is GroupState.HOMING:
        return END_HOMING
    if step.state is GroupState.ACTIVATING and not step.follows:
        return GIVE_UP_ENABLING
    if not step.follows or step.state is GroupState.HALTED:
        return None
    if is_confirmed:
        return HALT_AXES
    return None if step.state is GroupState.DEACTIVATING else DISABLE

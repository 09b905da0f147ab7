"""
One drive's path through the CiA 402 state machine, a step at a time.

A step is a controlword, the states it leads to and the states passed before. The stepper
only watches: it says when the step is done and raises when the drive goes elsewhere or takes too
long. It never chooses a controlword by itself.
"""

from __future__ import annotations

from typing import NamedTuple

from facade_manipulator.drives.states import Controlword, decode_state, Mode, State
from facade_manipulator.errors import DriveError, DriveStateError, DriveTimeoutError

FAULT_STATES = frozenset({State.FAULT, State.FAULT_REACTION_ACTIVE})
_ANY_STATE = frozenset(State)
_NO_STATE: frozenset[State] = frozenset()
HEED_CYCLES = 5  # from a controlword to its effect in a statusword: two, and some for the drive


class Feedback(NamedTuple):
    """What one drive last sent."""

    statusword: int
    #: mode of operation display 6061; None while the drive does not show it
    mode: int | None = Mode.CYCLIC_SYNCHRONOUS_POSITION
    at_rest: bool = True  #: whether the carriage stands still
    error: str = ''  #: the last error of an emergency message or of 603F; '' for none
    #: while homing: how far the actual position is from the home position [m], 0 where that is as
    #: exact as the homing method
    home_error: float = 0.0
    #: for how many cycles in a row the drive has sent nothing: all else is as old as that
    missed_cycles: int = 0
    disobedience: str = ''  #: in what it does not do what it is commanded, as it says itself


class Step(NamedTuple):
    """A step of the state machine."""

    purpose: str  #: what it is for, as in "q2 did not *switch on*"
    controlword: int
    goal: frozenset[State]  #: where the drive shall be
    via: frozenset[State] = frozenset()  #: where it may be until it is there
    #: mode of operation to command, and to see displayed before the step is done; None for a step
    #: that does not care
    mode: int | None = Mode.CYCLIC_SYNCHRONOUS_POSITION
    to_rest: bool = False  #: whether the step is done only when the carriage stands still
    min_cycles: int = 1  #: fewest cycles that the step lasts


def _states(*states: State) -> frozenset[State]:
    return frozenset(states)


_CSP, _HOMING = Mode.CYCLIC_SYNCHRONOUS_POSITION, Mode.HOMING
_OFF = _states(State.SWITCH_ON_DISABLED)
_READY = _states(State.READY_TO_SWITCH_ON)
_ON = _states(State.SWITCHED_ON)
_ENABLED = _states(State.OPERATION_ENABLED)
# what a drive shows that a command of a stop has not reached, or that does not obey it
_NOT_HEEDED: dict[int, frozenset[State]] = {
    Controlword.QUICK_STOP: _ENABLED,
    Controlword.DISABLE_VOLTAGE: _ENABLED | _ON | _READY | _states(State.QUICK_STOP_ACTIVE),
}
_UNPOWERED = _OFF | _READY | _ON | FAULT_STATES | _states(State.NOT_READY_TO_SWITCH_ON)

POWER_OFF = Step(
    'switch off', Controlword.DISABLE_VOLTAGE, _OFF, _ANY_STATE - FAULT_STATES, mode=None)
FOLLOW = Step('stay in operation', Controlword.ENABLE_OPERATION, _ENABLED)
COME_TO_REST = Step('come to rest', Controlword.ENABLE_OPERATION, _ENABLED, to_rest=True)
QUICK_STOP = Step(
    'stop', Controlword.QUICK_STOP, _UNPOWERED | _states(State.QUICK_STOP_ACTIVE), _ANY_STATE,
    mode=None, to_rest=True)
STAY_STOPPED = QUICK_STOP._replace(purpose='stay stopped', to_rest=False)
CUT_POWER = Step(
    'lose power', Controlword.DISABLE_VOLTAGE, _OFF | FAULT_STATES, _ANY_STATE, mode=None)


def power_on(mode: int) -> tuple[Step, ...]:
    """Return the steps from switch on disabled to operation enabled in a mode."""
    return (
        Step('select its mode of operation', Controlword.DISABLE_VOLTAGE, _OFF, mode=mode),
        Step('get ready to switch on', Controlword.SHUTDOWN, _READY, _OFF, mode),
        Step('switch on', Controlword.SWITCH_ON, _ON, _READY, mode),
        Step('enable operation', Controlword.ENABLE_OPERATION, _ENABLED, _ON, mode),
    )


# a drive may skip states while it powers down, not while it powers on
POWER_DOWN = (
    Step('disable operation', Controlword.DISABLE_OPERATION, _ON | _READY | _OFF, _ENABLED),
    Step('shut down', Controlword.SHUTDOWN, _READY | _OFF, _ON),
    Step('switch off', Controlword.DISABLE_VOLTAGE, _OFF, _READY | _ON),
)
RESET_FAULT = (
    Step('leave the quick stop', Controlword.DISABLE_VOLTAGE, _OFF | _states(State.FAULT),
         _ANY_STATE, mode=None),
    Step('take the fault reset', Controlword.FAULT_RESET, _ANY_STATE, mode=None),
    Step('leave the fault', Controlword.DISABLE_VOLTAGE, _OFF, _ANY_STATE, mode=None),
)
HOME = Step('hold for homing', Controlword.ENABLE_OPERATION, _ENABLED, mode=_HOMING)
END_HOMING = Step(
    'stand still after homing', Controlword.ENABLE_OPERATION, _ENABLED, mode=_HOMING,
    to_rest=True, min_cycles=3)


class AxisStepper:
    """Watch one drive, by the name that the operator calls the axis, take steps."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.begin(POWER_OFF, 0.0)

    def begin(self, step: Step, deadline: float) -> None:
        """Begin a step that must be done by a time [s]."""
        self._step = step
        self._deadline = deadline
        self._reached = False
        self._cycles = 0
        self._state_now: State | None = None

    @property
    def is_heeded(self) -> bool:
        """Whether the drive shows an effect of a stop's controlword, or it is too early to say."""
        ignoring = _NOT_HEEDED.get(self._step.controlword, _NO_STATE)
        return self._cycles < HEED_CYCLES or self._state_now not in ignoring

    def advance(self, feedback: Feedback, now: float) -> bool:
        """
        Return whether the step is done.

        Raises a DriveError if the drive is in fault, a DriveStateError if it has gone
        where the step does not lead, a DriveTimeoutError if it takes too long.
        """
        self._cycles += 1
        state = self._state_now = self._state(feedback.statusword)
        self._require_on_path(state, feedback)
        arrived = state in self._step.goal and self._is_settled(feedback)
        done = arrived and self._cycles >= self._step.min_cycles
        self._reached = self._reached or done
        if not arrived and now > self._deadline:
            raise DriveTimeoutError(
                f'{self.name} did not {self._step.purpose} in time: '
                f'{self._condition(state, feedback)}')
        return done

    def _state(self, statusword: int) -> State:
        try:
            return decode_state(statusword)
        except DriveStateError as error:
            raise DriveStateError(f'{self.name}: {error}') from None

    def _require_on_path(self, state: State, feedback: Feedback) -> None:
        allowed = self._step.goal if self._reached else self._step.goal | self._step.via
        if state in allowed:
            return
        if state in FAULT_STATES:
            raise DriveError(
                f'{self.name} is in the state {_describe(state, feedback)}: '
                f'{feedback.error or "the drive sent no error code"}')
        raise DriveStateError(
            f'{self.name} should {self._step.purpose}, but went to the state '
            f'{_describe(state, feedback)}')

    def _is_settled(self, feedback: Feedback) -> bool:
        return (self._has_mode(feedback)
                and (feedback.at_rest or not self._step.to_rest))

    def _has_mode(self, feedback: Feedback) -> bool:
        return self._step.mode is None or feedback.mode in (None, self._step.mode)

    def _condition(self, state: State, feedback: Feedback) -> str:
        if feedback.missed_cycles:
            return (f'it has sent no state for {feedback.missed_cycles} cycles, the last one was '
                    f'{_describe(state, feedback)}')
        return f'it is in the state {_describe(state, feedback)}{self._lacking(feedback)}'

    def _lacking(self, feedback: Feedback) -> str:
        if self._step.mode is not None and not self._has_mode(feedback):
            return f', in mode {feedback.mode} instead of {int(self._step.mode)}'
        return '' if feedback.at_rest else ', still moving'


def _describe(state: State, feedback: Feedback) -> str:
    return f'{state.value} (statusword {feedback.statusword:04X}h)'

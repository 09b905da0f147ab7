"""
Group of the three axes: power on together, and stop together after any fault.

How requests, plans, homing and the cycle act on the group:

    request   begins a plan by `enable`, `home`, `disable`, `halt` or `reset`, and waits until the
              drives have done it or are stopped
    plan      a list of steps (`plans`); all three drives must have completed a step before any
              drive receives the next, and the last step lasts until another plan begins
    cycle     calls `step` once, after the feedback of all drives: supervise the present step,
              begin the next if all have completed it, command all axes
    homing    while the group is homing, `step` advances the homing of each axis; the axes with
              the lowest rank that is not homed yet home together
    cause     of the exchange, the targets or the operator: `stop` begins a plan that ends in
              the state stopped, which only `reset` leaves

The group enables operation only inside `Group.enable` and `Group.home`, which an operator
requests. The group has no clock and no bus: time is an argument, the feedback of the axes is the
input, and their output takes the commands.
"""

from __future__ import annotations

from facade_manipulator.drives import plans
from facade_manipulator.drives.axis import Axis
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.feedback import Feedback
from facade_manipulator.drives.group_state import GroupState
from facade_manipulator.drives.plans import Plan
from facade_manipulator.drives.snapshot import Cause
from facade_manipulator.drives.states import (
    AxisCommand,
    Controlword,
    decode_state,
    describe_state,
    Mode,
    State,
    Status,
)
from facade_manipulator.errors import DriveStateError, NEXT


class Group:
    """
    State machine of the three axes.

    Attributes
    ----------
    state : GroupState
        State of the group, that of the present step.
    follows, is_ramping : bool
        Whether targets are commanded, and whether only until the carriages are at rest.
    is_settled : bool
        Whether all drives have completed the present step.
    is_confirmed : bool
        Whether the drives have completed an activation and follow targets since.
    causes : tuple of Cause
        Causes of the stop, the first cause first.
    not_responding : set of str
        Axes that obeyed neither a quick stop nor the command that cuts the power.

    """

    MAX_FURTHER_CAUSES = 8
    # cycles in a row for which a drive without power may show a statusword between two states
    MAX_UNCLEAR_CYCLES = 3

    def __init__(self, axes: tuple[Axis, ...], settings: ControllerSettings) -> None:
        self.axes = axes
        self._settings = settings
        self.causes: tuple[Cause, ...] = ()
        self._cleared: tuple[Cause, ...] = ()  # the causes that the last reset clears
        self.not_responding: set[str] = set()
        self.is_confirmed = False
        self._mode = int(Mode.CYCLIC_SYNCHRONOUS_POSITION)
        self._has_shown_mode = False  # whether all drives have shown the commanded mode
        self._cycles = 0
        self._unclear_cycles = dict.fromkeys([axis.name for axis in axes], 0)
        self.start(0.0)  # a placeholder: the exchange starts it at the present time

    @property
    def is_stopped(self) -> bool:
        """Return whether the drives are stopped by a cause that is not yet cleared."""
        return self.state is GroupState.STOPPED and bool(self.causes)

    @property
    def has_stopped(self) -> bool:
        """Return whether the drives have received the commands to stop and had time to stop."""
        return self.state is GroupState.STOPPED and len(self._plan) == 1

    @property
    def reason(self) -> str:
        """Return the message of the first cause, ``''`` without a cause."""
        return self.causes[0].message if self.causes else ''

    @property
    def severest_cause(self) -> Cause | None:
        """Return the first cause that requires configure, or the first cause if none does."""
        return min(self.causes, key=lambda one: not one.configure_again, default=None)

    def has_done(self, *states: GroupState) -> bool:
        """Return whether all drives have reached one of the given states of the group."""
        return self.state in states and self.is_settled

    # --- requests

    def start(self, now: float) -> None:
        """Switch the drives off, and begin supervision at a time [s]."""
        self._begin(plans.OFF, now)

    def enable(self, now: float) -> None:
        """
        Power on, hold, then follow targets; after a halt, only resume following.

        Raises a DriveStateError unless all drives are switched off or halted.
        """
        is_halted = self.state is GroupState.HALTED
        is_off = self.state is GroupState.INACTIVE
        self._require('activate', is_halted or is_off, is_settled=True)
        self._begin(
            plans.FOLLOW
            if is_halted
            else plans.enable_plan(self._settings.hold_cycles),
            now,
        )

    def home(self, now: float) -> None:
        """
        Power on in homing mode, home, then power off.

        Raises a DriveStateError unless all drives are switched off.
        """
        remedy = 'deactivate' if self.follows else ''
        self._require('home', self.state is GroupState.INACTIVE, True, remedy)
        for axis in self.axes:
            axis.begin_homing(self._settings.period)
        self._begin(plans.HOME_AXES, now)

    def disable(self, now: float) -> None:
        """
        Bring the carriages to rest, then power off.

        Raises a DriveStateError unless targets are commanded.
        """
        self._require('deactivate', self.follows)
        self._begin(plans.DISABLE, now)

    def halt(self, now: float) -> bool:
        """Begin `plans.halt_plan`; return whether the carriages come to rest without a stop."""
        plan = plans.halt_plan(self._plan[0], self.is_confirmed)
        if plan is not None:
            self._begin(plan, now)
            return True
        return self._plan[0].to_rest and self.state is not GroupState.STOPPED

    def reset(self, now: float) -> None:
        """
        Begin to clear the faults; afterwards the group is without power, or stopped again.

        Raises a DriveStateError if the carriages have not stopped yet, and the errors of
        `require_resettable`.
        """
        self._require('clear_faults', self.has_stopped)
        self.require_resettable()
        self._cleared = self.causes
        self.causes = ()
        self._begin(plans.RESET, now)

    def require_resettable(self) -> None:
        """
        Raise an error unless the carriages have stopped and the faults may be cleared.

        Raises a DriveStateError if there is no stop to clear, or the drives must be configured
        again.
        """
        self._require('clear_faults', self.state is GroupState.STOPPED)
        severest = self.severest_cause
        if severest is not None and severest.configure_again:
            raise DriveStateError(
                f'clear_faults cannot clear this stop: {severest.message}'
            )

    def stop(self, cause: Cause, now: float) -> None:
        """Quick-stop all axes and keep them stopped; add the cause to earlier causes."""
        first = self.causes[:1]
        further = self.causes[1:]
        if any(
            one.is_vague
            and not cause.is_vague
            and one.axis == cause.axis
            and one.configure_again <= cause.configure_again
            for one in first
        ):
            self.causes = (cause, *further)  # the later cause says why the drive fails
        elif cause.is_requested and any(one.is_requested for one in self.causes):
            # the later cause contains all present reasons of the supervisors
            self.causes = tuple(
                cause if one.is_requested else one for one in self.causes
            )
        elif cause not in self.causes:
            self.causes = first + (*further, cause)[-self.MAX_FURTHER_CAUSES :]
        if cause.cut_power and self._plan[-1] != plans.CUT_POWER[-1]:
            self._begin(plans.STOP_AND_CUT_POWER, now)
        elif self.state is not GroupState.STOPPED:
            self._begin(plans.STOP_AXES, now)

    def cut_power(self, now: float) -> None:
        """Cut the power once all carriages are at rest; the group remains stopped."""
        is_off = self.state is GroupState.INACTIVE
        self._begin(plans.CUT_POWER if is_off else plans.STOP_AND_CUT_POWER, now)

    # --- the cycle

    def step(self, now: float) -> None:
        """
        Command the drives according to their newest feedback, at a time [s].

        A drive in fault, in an unexpected state or late stops all three in this step. No behaviour
        of a drive raises an error.
        """
        self._cycles += 1
        self._supervise(now)
        if self.is_settled and self._plan[0].mode is not None:
            self._has_shown_mode = True
        if self.state is GroupState.ACTIVE and self.is_settled:
            self.is_confirmed = True
        if self.is_settled and len(self._plan) > 1 and not self._due_rank():
            was_clearing = self.state is GroupState.CLEARING
            self._begin(self._plan[1:], now)
            if self.state is GroupState.INACTIVE:
                self.causes = ()
                self.not_responding.clear()
                if was_clearing:
                    self._forget_errors()
        if self.state is GroupState.HOMING:
            self._command_homing()

    def _forget_errors(self) -> None:
        """
        Forget the errors of all drives, which have left their faults.

        A drive may report its errors only by 603Fh, and does not report that they have ended. The
        same code is then a new error, which may lose the position again.
        """
        for axis in self.axes:
            axis.errors.forget()

    def _command_homing(self) -> None:
        """Start the homing of the axes whose rank is due."""
        due = self._due_rank()
        for axis in self.axes:
            controlword = int(Controlword.ENABLE_OPERATION)
            homing = axis.homing
            if homing is not None and homing.rank == due and not homing.is_homed:
                controlword |= Controlword.HOMING_START
            axis.output.take(AxisCommand(controlword, self._mode))

    def _due_rank(self) -> int:
        """Return the lowest homing rank with an axis that is not homed; 0 if all are homed."""
        if self.state is not GroupState.HOMING:
            return 0
        ranks = []
        for axis in self.axes:
            if axis.homing is not None and not axis.homing.is_homed:
                ranks.append(axis.homing.rank)
        return min(ranks, default=0)

    def _supervise(self, now: float) -> None:
        """Begin the next step when all drives have completed this step; stop if a drive fails."""
        failures: dict[str, str] = {}
        is_done = True
        due = self._due_rank()
        for axis in self.axes:
            failure, has_done = self._evaluate(axis, now)
            is_done = is_done and has_done
            failure = self._advance_homing(axis, due) or failure
            if failure:
                failures[axis.name] = failure
        self.is_settled = is_done and not failures
        if failures and self.state is GroupState.CLEARING:
            self.causes += tuple(one for one in self._cleared if one.axis in failures)
        for name, failure in failures.items():
            self._fail(name, failure, now)

    @staticmethod
    def _advance_homing(axis: Axis, due: int) -> str:
        """Advance an axis whose homing rank is due; return the reason of a failure, or ``''``."""
        homing = axis.homing
        if homing is None:
            return ''
        feedback = axis.feedback
        if homing.rank != due:
            homing.watch(feedback.statusword)
        elif not homing.is_homed:
            return homing.advance(feedback.statusword, feedback.counts)
        return ''

    def _evaluate(self, axis: Axis, now: float) -> tuple[str, bool]:
        """Return the failure of a drive, or ``''``, and whether it has completed the step."""
        step = self._plan[0]
        drive = axis.feedback
        state = decode_state(drive.statusword)
        if self._is_unclear(axis.name, state, drive.statusword):
            return '', False
        has_mode = step.mode is None or drive.mode in (None, step.mode)
        failure = self._disobedience(drive, has_mode)
        has_arrived = (
            state in step.goal and has_mode and (drive.at_rest or not step.to_rest)
        )
        may_stay = state in step.goal or state in step.via
        if may_stay and not failure and (has_arrived or now <= self._deadline):
            return '', has_arrived and self._cycles >= step.min_cycles
        found = [f'in {describe_state(drive.statusword)}']
        if state in plans.FAULT_STATES:
            found.append(axis.errors.message or 'the drive sent no error code')
        if not has_mode:
            found.append(f'in mode {drive.mode} instead of {step.mode}')
        if not drive.at_rest:
            found.append('still moving')
        missed = axis.answers.missed_in_a_row
        if missed:
            found.append(f'according to its last answer, {missed} cycles ago')
        return (
            f'{axis.name} {failure or f"did not {step.purpose}"}: '
            f'it is {", ".join(found)}'
        ), False

    def _is_unclear(self, name: str, state: State | None, statusword: int) -> bool:
        """
        Return whether the state of a drive without power must be awaited, for a few cycles.

        While a drive changes its state, its statusword may show a mixture of two states. The drive
        has not completed the step. A statusword with the bit of operation enabled does not wait.
        """
        is_unclear = (
            self._plan[0].is_without_power
            and state is None
            and not statusword & Status.OPERATION_ENABLED
        )
        cycles = self._unclear_cycles[name] + 1 if is_unclear else 0
        self._unclear_cycles[name] = cycles
        return 0 < cycles <= self.MAX_UNCLEAR_CYCLES

    def _disobedience(self, drive: Feedback, has_mode: bool) -> str:
        """
        Return why a drive fails at once, without a wait for the end of the step; ``''`` if not.

        In a stop nothing is checked: its steps follow no targets and command no mode.
        """
        if self.follows and drive.statusword & Status.FOLLOWING_ERROR:
            return 'is farther behind its target than the following-error window (bit 13 is 1)'
        is_enabled = decode_state(drive.statusword) is State.OPERATION_ENABLED
        if self._has_shown_mode and is_enabled and not has_mode:
            return 'has left its mode of operation'
        is_following = self.follows and self.state is not GroupState.ACTIVATING
        return drive.disobedience if is_following else ''

    def _fail(self, name: str, failure: str, now: float) -> None:
        """
        Stop all axes after a drive failed; cut the power if the drive does not obey the stop.

        Of drives that fail in one cycle, the first is the cause.
        """
        if self.state is not GroupState.STOPPED:
            self.stop(Cause(failure, axis=name, is_vague=True), now)
        elif name not in self.not_responding and (
            self.has_stopped or now > self._deadline
        ):
            self.not_responding.add(name)
            remedy = (
                'switch the supply of the drives off, and check why they keep power'
            )
            self.stop(
                Cause(failure, remedy, name, configure_again=True, is_vague=True), now
            )
            self._begin(plans.CUT_POWER, now)

    def _require(
        self,
        request: str,
        is_possible: bool,
        is_settled: bool = False,
        remedy: str = '',
    ) -> None:
        """
        Raise a DriveStateError if a request is impossible, or must wait until a step ends.

        `remedy` is the next step after an impossible request, unless the drives are stopped by
        causes, which have their own.
        """
        if not is_possible:
            reason = f'{NEXT}{remedy}' if remedy else ''
            if self.causes:
                reason = f': {self.reason}'
            raise DriveStateError(
                f'{request} is not possible while the drives are {self.state.value}{reason}'
            )
        if is_settled and not self.is_settled:
            raise DriveStateError(
                f'{request} is not possible yet: not every drive has confirmed that it is '
                f'{self.state.value}; next: try again'
            )

    def _begin(self, plan: Plan, now: float) -> None:
        """Begin the first step of a plan at a time [s], and command all axes."""
        step = plan[0]
        self._plan = plan
        self.state = step.state
        self.follows = step.follows
        self.is_ramping = step.follows and step.to_rest
        self.is_settled = False
        self.is_confirmed = self.is_confirmed and step.follows
        if step.mode is None or step.mode != self._mode:
            self._has_shown_mode = False
        self._mode = self._mode if step.mode is None else step.mode
        command = AxisCommand(step.controlword, self._mode)
        for axis in self.axes:
            axis.output.take(command)
        self._cycles = 0
        self._deadline = now + (
            self._settings.ramp_timeout
            if self.is_ramping
            else self._settings.step_timeout
        )

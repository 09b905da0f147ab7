"""
The three axes as one: they power on together, and a fault of one stops all.

The group walks through lists of steps (`plans`); all three drives must have done a step before
any takes the next. It enables operation only inside `Group.enable` and
`Group.home`, which an operator asks for, and after a stop it stays stopped until `Group.reset`.
No clock and no bus in here: time and feedback are arguments, controlwords are the result.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

from facade_manipulator.drives import plans
from facade_manipulator.drives.axis import AxisStepper, Feedback
from facade_manipulator.drives.cause import Cause, Remedy
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.homing import HomingSequence
from facade_manipulator.drives.plans import Plan
from facade_manipulator.drives.states import Mode, Status
from facade_manipulator.errors import DriveError, DriveStateError

RESET_WINDOW = 60.0  # s, in which a fault that comes back is not reset again
MAX_FURTHER_CAUSES = 8
HEED_TIME = 0.1  # s, by which a drive that receives the controlword of a stop has obeyed it


class AxisCommand(NamedTuple):
    """Controlword and mode of operation for one drive."""

    controlword: int
    mode: int


@dataclass(frozen=True)
class GroupSettings:
    """Time-outs and counts of the group."""

    step_timeout: float = 1.0  #: longest time for one step [s]
    ramp_timeout: float = 5.0  #: longest time to come to rest on the path [s]
    hold_cycles: int = 20  #: cycles to hold after power-on before targets are followed
    max_resets: int = 3  #: fault resets allowed within a minute


class Group:
    """
    State machine of the three axes, by the names that the operator calls them.

    `state` is what it is doing, `commands` what to command now (`step` may add bits to it),
    `cause` why it stopped, `is_settled` whether all drives have done the present step,
    `homing` the last homing, `not_responding` which axes did not respond to a quick stop, `deaf`
    which axes show no effect of the controlword of a stop in their RPDOs.
    """

    def __init__(
        self, names: tuple[str, ...], settings: GroupSettings | None = None, now: float = 0.0,
    ) -> None:
        self._settings = settings or GroupSettings()
        self.cause: Cause | None = None
        self.further_causes: deque[Cause] = deque(maxlen=MAX_FURTHER_CAUSES)
        self.not_responding: set[str] = set()
        self.deaf: set[str] = set()
        self.is_settled = False
        self._mode = int(Mode.CYCLIC_SYNCHRONOUS_POSITION)
        self._resets: deque[float] = deque(maxlen=self._settings.max_resets)
        self.homing = HomingSequence(())  # none yet
        self._last_shown: list[tuple[int, int | None, str]] = []
        self._steppers = tuple(AxisStepper(name) for name in names)
        self._enable = plans.enable_plan(self._settings.hold_cycles)
        self._begin(plans.OFF, now)

    @property
    def is_stopped(self) -> bool:
        """Return whether something has stopped the drives and was not cleared yet."""
        return self.cause is not None and self.state.is_stopped

    def enable(self, now: float) -> None:
        """
        Power on, hold, then follow targets; after a halt just follow again.

        Raises a DriveStateError if the drives are not switched off, or stopped.
        """
        self._require('activate', self.state in (ControllerState.INACTIVE, ControllerState.HALTED))
        self._require_settled('activate')
        self.homing = HomingSequence(())
        self._begin(plans.FOLLOW if self.state is ControllerState.HALTED else self._enable, now)

    def home(self, sequence: HomingSequence, now: float) -> None:
        """
        Power on in homing mode, home, power off.

        Raises a DriveStateError if the drives are not switched off, or stopped.
        """
        self._require('home', self.state is ControllerState.INACTIVE)
        self._require_settled('home')
        self.homing = sequence
        self._begin(plans.HOME, now)

    def disable(self, now: float) -> None:
        """
        Come to rest, then power off.

        Raises a DriveStateError if the group is stopped, or busy powering on or off.
        """
        self._require('deactivate', self.state.is_following)
        self._begin(plans.DISABLE, now)

    def halt(self, now: float) -> bool:
        """
        Come to rest and hold there; what was not done yet is given up and the power switched off.

        Not done yet are a homing, and an activation that was not confirmed: whoever asked learns
        that it was cancelled, so that no power may stay on. Returns False where this changes
        nothing: without power, and while the power goes off or all is stopping already.
        """
        plan = plans.HALTS.get(self.state)
        if self.state is ControllerState.ACTIVE and not self.is_settled:
            plan = plans.DISABLE
        if plan is not None:
            self._begin(plan, now)
        return plan is not None

    def reset(self, now: float) -> None:
        """
        Begin to clear the faults; ends with the power off, or stopped again.

        Raises a DriveStateError if the carriages have not stopped yet, or as
        `require_resettable` says.
        """
        self._require('clear_faults', self.state is ControllerState.STOPPED)
        self.require_resettable(now)
        self._resets.append(now)
        self._begin(plans.RESET, now)

    def require_resettable(self, now: float) -> None:
        """
        Check whether the faults may be cleared once the carriages have stopped.

        Raises a DriveStateError if there is no stop to clear, the drives must be
        configured again, or there were too many resets within a minute.
        """
        self._require('clear_faults', self.state.is_stopped)
        severest = self.severest_cause
        if severest is not None and severest.configure_again:
            raise DriveStateError(f'clear_faults is not enough: {severest.message}')
        if len(self._resets) == self._resets.maxlen and now - self._resets[0] < RESET_WINDOW:
            wait = RESET_WINDOW - (now - self._resets[0])
            raise DriveStateError(
                f'{len(self._resets)} fault resets within {RESET_WINDOW:g} s are the most: find '
                f'the cause ({self.reason}), the next reset is possible in {wait:.0f} s')

    @property
    def reason(self) -> str:
        """What has stopped it, '' for nothing."""
        return '' if self.cause is None else self.cause.message

    @property
    def causes(self) -> tuple[Cause, ...]:
        """Why it is stopped, the first cause first; empty while it is not."""
        return () if self.cause is None else (self.cause, *self.further_causes)

    @property
    def severest_cause(self) -> Cause | None:
        """The cause whose remedy fixes all: the first that asks to configure, or the first."""
        return next((cause for cause in self.causes if cause.configure_again), self.cause)

    @property
    def needs_configuration(self) -> bool:
        """Return whether a cause asks for the drives to be configured again."""
        return self.severest_cause is not None and self.severest_cause.configure_again

    def stop(self, cause: Cause, now: float) -> None:
        """Quick stop all axes and stay stopped; the first cause is kept, the later ones noted."""
        if self.cause is None or self.cause.is_explained_by(cause):
            self.cause = cause
        elif cause not in self.causes:
            self.further_causes.append(cause)
        if cause.cut_power and self._plan[-1] != plans.CUT_POWER[-1]:
            self._begin(plans.STOP_AND_CUT_POWER, now)
        elif not self.state.is_stopped:
            self._begin(plans.STOP, now)

    def cut_power(self, now: float) -> None:
        """Take the power off for good, but of nothing that moves; ends in stopped."""
        is_off = self.state is ControllerState.INACTIVE
        self._begin(plans.CUT_POWER if is_off else plans.STOP_AND_CUT_POWER, now)

    def step(self, feedback: tuple[Feedback, ...], now: float) -> tuple[AxisCommand, ...]:
        """
        Take the drives' feedback and return what to command them.

        A drive that is in fault, where it should not be, or late, stops all three in this very
        step. Never raises for what a drive does.

        """
        shown = [  # all that a last step looks at
            (one.statusword, one.mode, one.disobedience) for one in feedback]
        if self.is_settled and len(self._plan) == 1 and shown == self._last_shown:
            return self.commands
        self._last_shown = shown
        state, bits, failures, done = self.state, [], [], True
        for number, one in enumerate(feedback):
            try:
                self._require_following(number, one)
                bits.append(self._homing_bits(number, one, now))
                done = self._steppers[number].advance(one, now) and done
            except DriveError as error:
                failures.append((number, error))
        self.is_settled = done and not failures
        for number, failure in failures:
            self._fail(number, failure, now)
        if not self.is_settled and now - self._begun > HEED_TIME:
            self._find_deaf(feedback, now)
        may_proceed = len(self._plan) > 1 and (
            state is not ControllerState.HOMING or self.homing.done)
        if self.is_settled and may_proceed:
            self._proceed(now)
        return self._commands(bits)

    def _find_deaf(self, feedback: tuple[Feedback, ...], now: float) -> None:
        """Note the drives that show no effect of a stop; one that still answers is the cause."""
        if not (self.state.is_stopped or self.state is ControllerState.CLEARING):
            return
        ignoring = [(stepper.name, one) for stepper, one in zip(
            self._steppers, feedback, strict=True) if not stepper.is_heeded]
        command = self.commands[0].controlword
        for name, one in ignoring:
            is_new = name not in self.deaf
            self.deaf.add(name)
            if is_new and not one.missed_cycles:
                self.stop(Cause(
                    f'{name} shows no effect of controlword {command:04X}h in its RPDO within '
                    f'{HEED_TIME:g} s: it is sent by SDO', Remedy.CONFIGURE, name,
                    cut_power=True, configure_again=True), now)

    def _proceed(self, now: float) -> None:
        self._begin(self._plan[1:], now)
        if self.state is ControllerState.INACTIVE:
            self.cause = None
            self.further_causes.clear()
            self.not_responding.clear()
            self.deaf.clear()

    def _commands(self, bits: list[int]) -> tuple[AxisCommand, ...]:
        if self.state is not ControllerState.HOMING:
            return self.commands
        return tuple(
            command._replace(controlword=command.controlword | extra)
            for command, extra in zip(self.commands, bits, strict=True))

    def _homing_bits(self, number: int, feedback: Feedback, now: float) -> int:
        if self.state is ControllerState.HOMING:
            return self.homing.advance(number, feedback, now)
        if self.homing.axes:
            self.homing.axes[number].watch(feedback)
        return 0

    def _require_following(self, number: int, feedback: Feedback) -> None:
        if not self.state.is_following:
            return
        fault = '' if self.state is ControllerState.HOLDING else feedback.disobedience
        if feedback.statusword & Status.FOLLOWING_ERROR:
            fault = 'is farther behind its target than the following-error window, bit 13 is 1'
        if fault:
            raise DriveError(
                f'{self._steppers[number].name} {fault} (statusword {feedback.statusword:04X}h)')

    def _fail(self, number: int, error: DriveError, now: float) -> None:
        name = self._steppers[number].name
        if not self.state.is_stopped:
            self.stop(Cause(str(error), axis=name, is_vague=True), now)
        elif name not in self.not_responding and (
                self.state is ControllerState.STOPPED or now > self._deadline):
            self.not_responding.add(name)
            self.stop(Cause(str(error), Remedy.NOT_RESPONDING, name, configure_again=True), now)
            self._begin(plans.CUT_POWER, now)

    def _require(self, request: str, is_possible: bool) -> None:
        if is_possible:
            return
        if self.cause is not None:
            raise DriveStateError(
                f'{request} is not possible, the drives are {self.state.value}: '
                f'{self.cause.message}')
        raise DriveStateError(
            f'{request} is not possible while the drives are {self.state.value}')

    def _require_settled(self, request: str) -> None:
        if not self.is_settled:
            raise DriveStateError(
                f'{request} is not possible yet, not every drive has confirmed that it is '
                f'{self.state.value}: try again')

    def _begin(self, plan: Plan, now: float) -> None:
        self._plan = plan
        self.is_settled = False
        self.state, step = plan[0]
        self._mode = self._mode if step.mode is None else step.mode
        self.commands = (AxisCommand(step.controlword, self._mode),) * len(self._steppers)
        is_ramp = self.state is ControllerState.RAMPING
        self._begun = now
        self._deadline = now + (
            self._settings.ramp_timeout if is_ramp else self._settings.step_timeout)
        for stepper in self._steppers:
            stepper.begin(step, self._deadline)

"""
The CiA 402 drive behind a simulated node: state machine, modes, supervision, reactions.

References
----------
IEC 61800-7-201 (CiA 402-2): finite state automaton, option codes 6007h, 605Ah, 605Eh.

"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
import math

from canopen import SdoAbortedError
from canopen.sdo import constants

from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.profile import DriveProfile
from facade_manipulator.drives.states import (
    Controlword,
    Mode,
    POWERED_STATES,
    State,
    Status,
    STATUSWORDS,
)
from facade_manipulator.drives.units import INT32_MAX, INT32_MIN
from facade_manipulator.simulation.drives.automaton import decode_command, TRANSITIONS
from facade_manipulator.simulation.drives.modes import CyclicPosition, Homing, Idle, SpeedRamp
from facade_manipulator.simulation.drives.motor import LIMITS, SimulatedMotor, STANDSTILL
from facade_manipulator.simulation.drives.objects import Objects

_LONGEST_STEP = 0.001  # s
_LONGEST_GAP = 1.0  # s: a drive that was not called for longer has stood still in it

FOLLOWING_ERROR, SOFTWARE_LIMIT, SAFE_TORQUE_OFF = 0x8611, 0x8A82, 0x8A88
_LIMIT_SWITCH_ERRORS = dict(zip(LIMITS, (0x8A80, 0x8A81), strict=True))
_NO_WINDOW = 0xFFFFFFFF

# option codes
_KEEPS_STANDING = range(5, 9)  # 605A: stay in quick stop active
_SLOW_RAMP = (1, 5)  # 605A, 605E: on the profile deceleration 6084
_NO_RAMP = 0  # 605A, 605E: power off at once
_CONNECTION_COMMANDS = {2: Controlword.DISABLE_VOLTAGE, 3: Controlword.QUICK_STOP}  # 6007
_CONNECTION_FAULT = 1  # 6007


class SimulatedAxis:
    """
    State machine and motion of one drive.

    The profile has its homing methods and quirks. `report` takes the code of an error that it
    finds; `reset_errors` resets them and returns whether none is left.
    """

    def __init__(
        self, objects: Objects, motor: SimulatedMotor, profile: DriveProfile, scale: AxisSettings,
        report: Callable[[int], None], reset_errors: Callable[[], bool],
    ) -> None:
        self._values, self._motor = objects.values, motor
        self._report, self._reset_errors = report, reset_errors
        self._lost_master_reaction = profile.lost_master_reaction
        self._units, self._motor_speed_units, self._ramp_units = (
            replace(scale, velocity_unit=unit).velocity_units_per_count for unit in (
                profile.velocity_unit, profile.motor_speed_unit, profile.acceleration_unit))
        parts = objects.values, motor, profile, self._units, self._ramp_units
        self.cyclic, self.homing = CyclicPosition(*parts), Homing(*parts)
        self.modes = {
            Mode.NONE: Idle(*parts), Mode.CYCLIC_SYNCHRONOUS_POSITION: self.cyclic,
            Mode.HOMING: self.homing}
        self.torque_off = False  #: whether safe torque off is open; then there is no power
        self._time = -math.inf
        objects.readers.update({
            (0x6061, 0): lambda: self._mode,
            (0x6064, 0): lambda: _int32(motor.counts),
            (0x606C, 0): lambda: _int32(motor.velocity * self._units),
            (0x6077, 0): lambda: round(motor.torque),
            (0x60F4, 0): lambda: _int32(self.following_error),
        })
        objects.writers.update({
            # `control` may be replaced by a fault
            (0x6040, 0): lambda controlword: self.control(controlword),
            (0x6060, 0): self._set_mode,
            (0x6098, 0): self._check_homing_method,
        })
        self.reset()

    def reset(self) -> None:
        """Take the state after the power came on: the position is unknown."""
        self.state = State.SWITCH_ON_DISABLED
        self._controlword = 0
        self._mode = Mode.NONE
        self._stop: SpeedRamp | None = None
        self._late = 0.0  # s, since when the following error is beyond its window
        self._switches = self._motor.inputs
        self._motor.count_from_here()
        self.homing.attained = False
        self._demand = self._motor.position

    # --- what the drive reports

    @property
    def statusword(self) -> int:
        """The statusword 6041, without the bit for NMT Operational."""
        word = STATUSWORDS[self.state][1]
        word |= 0 if self.torque_off else Status.VOLTAGE_ENABLED
        if self.state is State.OPERATION_ENABLED:
            word |= self.modes[self._mode].status()
        return word | Status.FOLLOWING_ERROR * (self._late > 0.0 and self._mode != Mode.HOMING)

    @property
    def following_error(self) -> float:
        """Demand minus actual position in counts; 0 without power."""
        return self._demand - self._motor.position if self.state in POWERED_STATES else 0.0

    @property
    def is_moving(self) -> bool:
        """Whether time matters: there is power on the motor, or it still turns."""
        return self.state in POWERED_STATES or self._motor.velocity != 0.0

    # --- what the master commands

    def control(self, controlword: int) -> None:
        """Act on a controlword."""
        before, self._controlword = self._controlword, controlword
        command = decode_command(controlword)
        if command is Controlword.FAULT_RESET:  # acts at its rising edge
            is_permitted = not before & Controlword.FAULT_RESET and self._reset_errors()
        elif self.state is State.QUICK_STOP_ACTIVE and command is Controlword.ENABLE_OPERATION:
            # a repeated controlword does not undo a stop made by the drive itself
            is_permitted = (command is not decode_command(before)
                            and self._values[0x605A, 0] in _KEEPS_STANDING)
        else:
            is_permitted = True
        if is_permitted:
            self._enter(TRANSITIONS.get((self.state, command), self.state))
        if self.state is State.OPERATION_ENABLED:
            self.modes[self._mode].control(before, controlword)

    def _set_mode(self, mode: int) -> None:
        if mode not in self.modes:
            raise SdoAbortedError(constants.ABORT_INVALID_VALUE)
        if mode != self._mode:
            self._mode = Mode(mode)
            self._enter_mode()

    def _check_homing_method(self, method: int) -> None:
        if method and not self.homing.supports(method):
            raise SdoAbortedError(constants.ABORT_INVALID_VALUE)

    def latch(self) -> None:
        """Let a SYNC act: take the target position, in a mode that has one."""
        if self.state is State.OPERATION_ENABLED:
            self.modes[self._mode].latch()
            low, high = self._values[0x607D, 1], self._values[0x607D, 2]
            if (self._mode == Mode.CYCLIC_SYNCHRONOUS_POSITION and low < high
                    and not low <= self._values[0x607A, 0] <= high):
                self._report(SOFTWARE_LIMIT)

    # --- transitions

    def _enter(self, state: State) -> None:
        if state is self.state or state is State.OPERATION_ENABLED and self.torque_off:
            return
        self.state = state
        self._stop, self._late = None, 0.0
        if state is State.OPERATION_ENABLED:
            self._enter_mode()
        elif state is State.QUICK_STOP_ACTIVE:
            self._begin_stop(self._values[0x605A, 0])

    def _enter_mode(self) -> None:
        self._demand = self._motor.position
        self.modes[self._mode].enter()

    def _begin_stop(self, option: int) -> None:
        ramp = self._values[(0x6084 if option in _SLOW_RAMP else 0x6085), 0] / self._ramp_units
        # the carriage is speed times lag behind its demand
        start = self._motor.position + self._motor.velocity * self._motor.lag
        self._stop = SpeedRamp(start, self._motor.velocity, ramp)
        if option == _NO_RAMP:
            self._end_stop()

    def _end_stop(self) -> None:
        if self.state is State.FAULT_REACTION_ACTIVE:
            self._enter(State.FAULT)
        elif self._values[0x605A, 0] not in _KEEPS_STANDING:
            self._enter(State.SWITCH_ON_DISABLED)

    def fail(self, keeps_power: bool) -> None:
        """Go to fault, with power on the ramp of 605E, or without."""
        if self.state in (State.FAULT, State.FAULT_REACTION_ACTIVE) and keeps_power:
            return
        has_power = self.state in POWERED_STATES
        self._enter(State.FAULT_REACTION_ACTIVE)
        if has_power and keeps_power:
            self._begin_stop(self._values[0x605E, 0])
        else:
            self._enter(State.FAULT)

    def lose_connection(self) -> None:
        """React to a lost master, an NMT stop or a reset by 6007 or the object in its place."""
        option = self._values.get((self._lost_master_reaction, 0), 0)
        if option in _CONNECTION_COMMANDS:
            command = _CONNECTION_COMMANDS[option]
            self._enter(TRANSITIONS.get((self.state, command), self.state))
        elif option == _CONNECTION_FAULT:
            self.fail(keeps_power=True)

    # --- motion

    def advance(self, now: float) -> None:
        """Move from the last call's time to `now` in s."""
        span = min(now - self._time, _LONGEST_GAP)
        if span <= 0.0:
            return
        self._time = now
        count = math.ceil(span / _LONGEST_STEP - 1e-6) if self.is_moving else 0
        for _ in range(count):
            if self.state in POWERED_STATES:
                self._step(span / count)
            else:
                self._motor.coast(span / count)

    def _step(self, step: float) -> None:
        values, motor = self._values, self._motor
        speed_limit = min(values[0x607F, 0] / self._units,
                          values[0x6080, 0] / self._motor_speed_units, motor.peak_speed)
        acceleration_limit = motor.peak_acceleration if self._stop else min(
            max(values[0x60C5, 0] / self._ramp_units, 1.0), motor.peak_acceleration)
        self._demand, speed = (self._stop or self.modes[self._mode]).step(step)
        motor.follow(self._demand, speed, step, speed_limit, acceleration_limit)
        self._supervise(step)

    def _supervise(self, step: float) -> None:
        """Check following error and limit switches; end a stop."""
        window = self._values[0x6065, 0]
        is_late = window != _NO_WINDOW and abs(self._demand - self._motor.position) > window
        self._late = self._late + step if is_late else 0.0
        if is_late and self._late * 1e3 > self._values[0x6066, 0]:
            self._report(FOLLOWING_ERROR)
        inputs = self._motor.inputs
        entered, self._switches = inputs & ~self._switches, inputs
        for switch, code in _LIMIT_SWITCH_ERRORS.items():
            if entered & switch and self._mode != Mode.HOMING:
                self._report(code)
        stop = self._stop
        if stop is not None and stop.speed == 0.0 and abs(self._motor.velocity) < STANDSTILL:
            self._end_stop()


def _int32(value: float) -> int:
    return max(INT32_MIN, min(INT32_MAX, round(value)))

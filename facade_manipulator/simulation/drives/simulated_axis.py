"""
CiA 402 drive behind a simulated node: state machine, modes, monitoring and reactions.

References
----------
IEC 61800-7-201 (CiA 402-2): finite state automaton, option codes 6007h, 605Ah, 605Eh.

"""

from __future__ import annotations

from collections.abc import Callable
import math

from facade_manipulator.canopen import indices
from facade_manipulator.drives.states import (
    Controlword,
    DigitalInput,
    Mode,
    POWERED_STATES,
    State,
    Status,
    STATUSWORDS,
)
from facade_manipulator.drives.units import INT32_MAX, INT32_MIN
from facade_manipulator.simulation.drives.automaton import decode_command, TRANSITIONS
from facade_manipulator.simulation.drives.modes import (
    CyclicPosition,
    Homing,
    Idle,
    SpeedRamp,
)
from facade_manipulator.simulation.drives.motor import SimulatedMotor, STANDSTILL
from facade_manipulator.simulation.drives.objects import Objects

# error codes
FOLLOWING_ERROR = 0x8611
SOFTWARE_LIMIT = 0x8A82
SAFE_TORQUE_OFF = 0x8A88
_LIMIT_SWITCH_ERRORS = {
    DigitalInput.NEGATIVE_LIMIT_SWITCH: 0x8A80,
    DigitalInput.POSITIVE_LIMIT_SWITCH: 0x8A81,
}


class SimulatedAxis:
    """
    State machine and motion of one simulated drive.

    `report` receives the code of each detected error. `reset_errors` resets the errors and returns
    whether no error is left.
    """

    _LONGEST_STEP = 0.001  # s
    _NO_WINDOW = 0xFFFFFFFF

    # option codes 605Ah, after the quick stop ramp 6085h
    _POWER_OFF = 2
    _KEEP_STANDING = 6
    _QUICK_STOP_OPTIONS = (_POWER_OFF, _KEEP_STANDING)
    # option codes 6007h
    _CONNECTION_COMMANDS = {2: Controlword.DISABLE_VOLTAGE, 3: Controlword.QUICK_STOP}

    def __init__(
        self,
        objects: Objects,
        motor: SimulatedMotor,
        report: Callable[[int], None],
        reset_errors: Callable[[], bool],
    ) -> None:
        self._objects = objects
        self._values = objects.values
        self._motor = motor
        self._report = report
        self._reset_errors = reset_errors
        self.cyclic = CyclicPosition(objects, motor)
        self.homing = Homing(objects, motor)
        self.modes = {
            Mode.NONE: Idle(objects, motor),
            Mode.CYCLIC_SYNCHRONOUS_POSITION: self.cyclic,
            Mode.HOMING: self.homing,
        }
        #: whether the input of safe torque off is open; then the motor has no power
        self.torque_off = False
        self._time = -math.inf  # of the last call of `advance` [s]
        objects.readers.update(
            {
                (indices.STATUSWORD, 0): lambda: self.statusword,
                (indices.MODE_DISPLAY, 0): lambda: self._mode,
                (indices.ACTUAL_POSITION, 0): lambda: _int32(motor.counts),
                (indices.ACTUAL_VELOCITY, 0): lambda: _int32(
                    motor.velocity * objects.units[indices.ACTUAL_VELOCITY]
                ),
                (indices.ACTUAL_TORQUE, 0): lambda: (
                    round(motor.torque) * (self.state in POWERED_STATES)
                ),
                (indices.ACTUAL_FOLLOWING_ERROR, 0): lambda: _int32(
                    self.following_error
                ),
                (indices.DIGITAL_INPUTS, 0): lambda: motor.inputs,
            }
        )
        objects.choices |= {
            (indices.QUICK_STOP_OPTION, 0): self._QUICK_STOP_OPTIONS,
            (indices.FAULT_REACTION_OPTION, 0): [self._POWER_OFF],
            (indices.MODE_OF_OPERATION, 0): self.modes,
        }
        objects.writers.update(
            {
                # an injected fault may replace `control`
                (indices.CONTROLWORD, 0): lambda controlword: self.control(controlword),
                (indices.MODE_OF_OPERATION, 0): self._set_mode,
            }
        )

    def reset(self) -> None:
        """Enter the state after power-on, in which the position is unknown."""
        self.state = State.SWITCH_ON_DISABLED
        self._controlword = 0
        self._latched_bit_4 = 0
        self._mode = Mode.NONE
        self._stop: SpeedRamp | None = None
        self._late = 0.0  # s, time of the following error beyond its window
        self._switches = self._motor.inputs
        self._motor.count_from_here()
        self.homing.attained = False

    # --- what the drive reports

    @property
    def statusword(self) -> int:
        """Return the statusword 6041h: state, mode bits and other flags."""
        word = STATUSWORDS[self.state][1] | Status.VOLTAGE_ENABLED * (
            not self.torque_off
        )
        word |= Status.REMOTE * (self._objects.nmt.state == 'OPERATIONAL')
        if self.state is State.OPERATION_ENABLED:
            word |= self.modes[self._mode].status()
        return word | Status.FOLLOWING_ERROR * (
            self._late > 0.0 and self._mode != Mode.HOMING
        )

    @property
    def _demand(self) -> SpeedRamp:
        return self._stop or self.modes[self._mode]

    @property
    def following_error(self) -> float:
        """Return demand minus actual position [counts]; 0 without power."""
        is_powered = self.state in POWERED_STATES
        return self._demand.position - self._motor.position if is_powered else 0.0

    @property
    def is_moving(self) -> bool:
        """Return whether the motor has power or still moves."""
        return self.state in POWERED_STATES or self._motor.velocity != 0.0

    # --- what the master commands

    def control(self, controlword: int) -> None:
        """Process a controlword."""
        before = self._controlword
        self._controlword = controlword
        command = decode_command(controlword)
        is_permitted = True
        if command is Controlword.FAULT_RESET:  # acts at its rising edge
            is_permitted = not before & Controlword.FAULT_RESET and self._reset_errors()
        elif (
            self.state is State.QUICK_STOP_ACTIVE
            and command is Controlword.ENABLE_OPERATION
        ):
            # a repeated controlword does not cancel a stop by the drive itself
            is_permitted = (
                command is not decode_command(before)
                and self._values[indices.QUICK_STOP_OPTION, 0] == self._KEEP_STANDING
            )
        if is_permitted:
            self._obey(command)
        if self.state is State.OPERATION_ENABLED and self._mode == Mode.HOMING:
            self.homing.control(before, controlword)

    def _set_mode(self, mode: int) -> None:
        if mode != self._mode:
            self._mode = Mode(mode)
            self.modes[self._mode].enter()

    def latch(self) -> None:
        """Process a SYNC: latch the target position in cyclic position mode."""
        if (
            self.state is State.OPERATION_ENABLED
            and self._mode == Mode.CYCLIC_SYNCHRONOUS_POSITION
        ):
            if self._latch_bit_4():
                self.cyclic.latch()
            low = self._values[indices.POSITION_LIMITS, 1]
            high = self._values[indices.POSITION_LIMITS, 2]
            target = self._values[indices.TARGET_POSITION, 0]
            if low < high and not low <= target <= high:
                self._report(SOFTWARE_LIMIT)

    def _latch_bit_4(self) -> bool:
        """Latch bit 4 of the controlword; return whether the drive may accept a target."""
        before = self._latched_bit_4
        self._latched_bit_4 = self._controlword & Controlword.NEW_TARGET
        kind = self._objects.profile.quirks.cyclic_bit_4
        if kind == 'toggled':
            return self._latched_bit_4 != before
        return kind == 'clear' or bool(self._latched_bit_4)

    # --- transitions

    def _obey(self, command: Controlword) -> None:
        """Execute the transition of a command in the current state, if any."""
        self._enter(TRANSITIONS.get((self.state, command), self.state))

    def _enter(self, state: State) -> None:
        """
        Enter another CiA 402 state; safe torque off prevents operation.

        The operation begins in the present mode. The other states with power begin a quick-stop
        ramp. Without power the motor coasts.
        """
        is_prevented = state is State.OPERATION_ENABLED and self.torque_off
        if state is self.state or is_prevented:
            return
        self.state = state
        self._stop = None
        self._late = 0.0
        if state is State.OPERATION_ENABLED:
            self.modes[self._mode].enter()
        elif state in POWERED_STATES:
            motor = self._motor
            # the carriage is speed times lag behind its demand
            self._stop = SpeedRamp(
                motor.position + motor.velocity * motor.lag,
                motor.velocity,
                self._objects.counts(indices.QUICK_STOP_DECELERATION),
            )

    def fail(self, keeps_power: bool) -> None:
        """Enter the fault state, with power on a quick-stop ramp or without power."""
        makes_ramp = keeps_power and self.state in POWERED_STATES
        self._enter(State.FAULT_REACTION_ACTIVE if makes_ramp else State.FAULT)

    def lose_connection(self) -> None:
        """React to a lost master, NMT stop or reset as configured in 6007h or its substitute."""
        option = self._values.get((self._objects.profile.lost_master_reaction, 0), 0)
        if option in self._CONNECTION_COMMANDS:
            self._obey(self._CONNECTION_COMMANDS[option])
        elif option == 1:  # a fault
            self.fail(keeps_power=True)

    # --- motion

    def advance(self, now: float) -> None:
        """Simulate the motion from the previous call until `now` [s], which must not decrease."""
        span = now - self._time
        self._time = now
        count = math.ceil(span / self._LONGEST_STEP - 1e-6) if self.is_moving else 0
        for _ in range(count):
            if self.state in POWERED_STATES:
                self._step(span / count)
            else:
                self._motor.coast(span / count)

    def _step(self, step: float) -> None:
        """Follow the demand for a step [s]; check following error and switches; complete stops."""
        objects = self._objects
        motor = self._motor
        demand = self._demand
        acceleration = motor.peak_acceleration
        if not self._stop:
            configured = objects.counts(indices.MAXIMUM_ACCELERATION)
            acceleration = min(max(configured, 1.0), acceleration)
        maximum_speed = min(
            objects.counts(indices.MAXIMUM_VELOCITY),
            objects.counts(indices.MAXIMUM_MOTOR_SPEED),
            motor.peak_speed,
        )
        speed = demand.step(step)
        motor.follow(
            demand.position,
            speed,
            step,
            maximum_speed,
            acceleration,
        )
        window = self._values[indices.FOLLOWING_ERROR_WINDOW, 0]
        is_late = window != self._NO_WINDOW and abs(self.following_error) > window
        self._late = self._late + step if is_late else 0.0
        longest = self._values[indices.FOLLOWING_ERROR_TIME, 0]
        if is_late and 1e3 * self._late > longest:
            self._report(FOLLOWING_ERROR)
        inputs = motor.inputs
        entered = inputs & ~self._switches
        self._switches = inputs
        for switch, code in _LIMIT_SWITCH_ERRORS.items():
            if entered & switch and self._mode != Mode.HOMING:
                self._report(code)
        stop = self._stop
        if stop and stop.speed == 0.0 and abs(motor.velocity) < STANDSTILL:
            if self.state is State.FAULT_REACTION_ACTIVE:
                self._enter(State.FAULT)
            elif self._values[indices.QUICK_STOP_OPTION, 0] != self._KEEP_STANDING:
                self._enter(State.SWITCH_ON_DISABLED)


def _int32(value: float) -> int:
    return max(INT32_MIN, min(INT32_MAX, round(value)))

"""
Driver's controller on a bus that is a list of frames, with three simulated drives.

A test calls the controller's turns in simulated time (`fake_bus`), so each run is identical.
`cycle_checks` checks every cycle.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from contextlib import suppress
from dataclasses import replace
import math

from cycle_checks import CycleChecks
from fake_bus import BusWorld
from replies import future_of

from facade_manipulator.canopen.bus import Frame
from facade_manipulator.canopen.clock import SteadyTime
from facade_manipulator.control_loop.control_loop import guarded_follower
from facade_manipulator.control_loop.loop_channel import LoopSetup
from facade_manipulator.drives.axis_settings import AxisSettings, DEFAULT_AXES
from facade_manipulator.drives.controller import DriveController, REQUESTS
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.snapshot import ControllerSnapshot, ControllerState
from facade_manipulator.drives.states import Mode, State
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.kinematics.geometry import PerCarriage
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.motion.setpoints import Setpoint
from facade_manipulator.simulation.drives.drive import SimulatedDrive

ANSWER_BOUND = 70.0  # s, for a request: homing may take 60 s
IDLE_WAIT = 0.05  # s
LEAD = 0.04  # s, by which a setpoint comes before its instant
SETTINGS = ControllerSettings(boot_timeout=0.5)
MOST_STEPS = 20  # from anything to drives that follow
SWITCH_HOMING = tuple(
    replace(axis, homing_method=17, homing_speed=0.2) for axis in DEFAULT_AXES
)


def axes_at(homes: PerCarriage) -> tuple[AxisSettings, ...]:
    """Return the default axes with other home positions [m]."""
    axes = []
    for axis, home in zip(DEFAULT_AXES, homes, strict=True):
        axes.append(replace(axis, home_position=home))
    return tuple(axes)


#: takes a time since the drives are active [s]; returns how far the carriages have gone since
#: then [m] and how fast they go [m/s]
Course = Callable[[float], tuple[list[float], list[float]]]
HOME = tuple(axis.home_position for axis in DEFAULT_AXES)


class Rig(BusWorld):
    """Controller, three simulated drives, and targets from a stream of setpoints."""

    def __init__(
        self,
        settings: ControllerSettings = SETTINGS,
        axes=DEFAULT_AXES,
        drives=None,
        limits: MotionLimits | None = None,
        has_kernel_sync: bool = False,
        **checks: object,
    ) -> None:
        super().__init__(drives or [*map(SimulatedDrive, axes)], has_kernel_sync)
        self.settings = settings
        self.axes = axes
        self._told = 0
        self._steady_time = SteadyTime(self.clock)
        setup = LoopSetup(Geometry(), settings, axes, limits=limits or MotionLimits())
        self.follower, guard = guarded_follower(setup)
        vars(guard).update(checks)
        self.controller = DriveController(
            settings, axes, self.open_bus, self.follower, guard, self.clock
        )
        self.controller.observe = self._observe
        self.checks = CycleChecks(self)
        self.failures: list[Exception] = []  #: found by the checks
        self.jobs: list[tuple[str, Future]] = []
        self.undo: list[Callable[[], object]] = []
        self.course: Course | None = (
            None  #: of the setpoints while the drives are active
        )
        self._base: PerCarriage | None = None
        self._begun = 0.0
        self._next_setpoint = 0.0
        self._stall = 0.0
        self.power_cut()
        self.run(0.2)

    # --- what a test does

    def run(self, seconds: float) -> None:
        """Run the controller and the drives for some time [s]."""
        end = self.clock.now + seconds
        self.until(lambda: self.clock.now >= end, seconds)

    def until(
        self, condition: Callable[[], object], seconds: float = 5.0, hint: str = ''
    ) -> object:
        """Run until a condition holds, and return its value; fail with a hint after a time [s]."""
        end = self.clock.now + seconds
        while not (value := condition()):
            assert self.clock.now < end, (hint, self.state, self.snapshot.causes)
            self._turn()
        return value

    def _turn(self) -> None:
        before = self.clock.now
        self.controller.turn()
        if self.clock.now == before:  # there is no bus: the loop waits for its node
            self.pass_time(IDLE_WAIT)
        if self.failures:
            raise self.failures[0]

    def cycles(self, number: int) -> None:
        """Run a number of cycles."""
        self.run(number * self.settings.period)

    def until_stopped(self) -> None:
        """Run until all drives are stopped."""
        self.until(lambda: self.state is ControllerState.STOPPED)
        self.until(lambda: State.OPERATION_ENABLED not in self.drive_states)

    def frames(self) -> list[Frame]:
        """Return the frames on the bus since the last call."""
        begin = self._told
        self._told = len(self.heard)
        return self.heard[begin:]

    def ask(self, name: str) -> Future:
        """Send a request and return its future at once."""
        job = future_of(self.controller.request, name)
        self.jobs.append((name, job))
        return job

    def request(self, *names: str) -> str:
        """Send requests in order; return the last answer, or raise its error."""
        for name in names:
            answer = self.finish(self.ask(name))
        return answer

    def finish(self, job: Future) -> str:
        """Run until a request is answered; return the answer, or raise its error."""
        self.until(job.done, ANSWER_BOUND)
        return job.result()

    def rejection(self, name: str) -> str | None:
        """Return why a request fails, None for success."""
        try:
            self.request(name)
        except ManipulatorError as error:
            return str(error)
        return None

    def inject(self, axis: int, fault: Callable[[SimulatedDrive], object]) -> None:
        """Apply a fault to a drive; the fault may return a function that repairs it."""
        self.undo.append(fault(self.drives[axis]) or bool)
        self.advance()

    def recover(self, most_steps: int = MOST_STEPS) -> None:
        """Take the named next step repeatedly until the drives follow."""
        message = None
        for _ in range(most_steps):
            if self.state is ControllerState.ACTIVE:
                return
            step = self.snapshot.next_step.rpartition('then ')[2].partition(',')[0]
            message = self.rejection(step) if step in REQUESTS else None
            if message and 'switch their supply off and on' in message:
                # after a foreign NMT reset of the communication, drives with power watch no master
                for drive in self.drives:
                    drive.reboot()
            self.run(0.1)
        raise AssertionError(f'{self.state}: {self.snapshot.causes}; {message}')

    def repair(self) -> None:
        """Remove the cause of every fault."""
        self.bus_error = None
        while self.undo:
            self.undo.pop()()
        for drive in self.drives:
            drive.is_silent = False
            drive.is_deaf = False
            drive.axis.torque_off = False

    def stream(self, amplitude: float = 0.06, rate: float = 4.0) -> None:
        """Oscillate the setpoints by twice an amplitude [m], at a rate [rad/s]."""

        def course(time: float) -> tuple[list[float], list[float]]:
            offset = amplitude * (1.0 - math.cos(rate * time))
            return [offset] * 3, [amplitude * rate * math.sin(rate * time)] * 3

        self.course = course
        self._base = None

    def stall(self, seconds: float) -> None:
        """Stall the control loop for some time [s]."""
        self.checks.is_late = True
        self._stall = seconds
        self.run(seconds + 0.03)
        self.checks.is_late = False

    def close(self) -> None:
        """End the run, and answer every request."""
        self.rejection('close')
        assert all(job.done() for _, job in self.jobs)

    # --- what a test looks at

    @property
    def snapshot(self) -> ControllerSnapshot:
        return self.controller.snapshot()

    @property
    def state(self) -> ControllerState:
        return self.snapshot.state

    @property
    def drive_states(self) -> list[State]:
        return [drive.axis.state for drive in self.drives]

    @property
    def carriages(self) -> list[float]:
        return [drive.motor.carriage_position for drive in self.drives]

    @property
    def all_causes(self) -> str:
        return ' '.join(cause.message for cause in self.snapshot.causes)

    # --- each turn of the controller

    def _observe(self, snapshot: ControllerSnapshot) -> None:
        try:
            self.checks.look(snapshot)
        except (
            AssertionError,
            ManipulatorError,
        ) as error:  # the controller would catch it
            self.failures.append(error)
        stall = self._stall
        self._stall = 0.0
        self.pass_time(stall)
        if self.clock.now >= self._next_setpoint:
            self._next_setpoint = self.clock.now + self.settings.period
            self._send_setpoint(snapshot)

    def _send_setpoint(self, snapshot: ControllerSnapshot) -> None:
        motion = self.follower.motion
        if (
            self.course is None
            or snapshot.state is not ControllerState.ACTIVE
            or motion is None
        ):
            self._base = None
            return
        if self._base is None:
            self._base = motion.position
            self._begun = self.clock.now
        offsets, speeds = self.course(self.clock.now - self._begun + LEAD)
        stamp = self._steady_time.from_stamp(self.clock.time() + LEAD)
        positions = []
        for base, offset in zip(self._base, offsets, strict=True):
            positions.append(base + offset)
        setpoint = Setpoint(stamp, tuple(positions), tuple(speeds))
        with suppress(ManipulatorError):  # a setpoint that is rejected moves nothing
            self.follower.add(setpoint, self.clock.monotonic())


# --- situations


def configured(rig: Rig) -> None:
    rig.request('configure', 'home')


def homing(rig: Rig) -> None:
    rig.request('configure')
    rig.ask('home')
    rig.until(lambda: min(abs(drive.motor.velocity) for drive in rig.drives) > 0.0)


def at_rest(rig: Rig) -> None:
    rig.request('configure', 'home', 'activate')


def in_motion(rig: Rig) -> None:
    at_rest(rig)
    rig.stream()
    rig.until(lambda: rig.snapshot.axes[0].velocity > 0.1)


def stopping(rig: Rig) -> None:
    in_motion(rig)
    rig.controller.stop('the operator stops')
    rig.run(0.01)


SITUATIONS = {
    'not configured': lambda rig: None,
    'configured': configured,
    'homing': homing,
    'active at rest': at_rest,
    'active in motion': in_motion,
    'stopping': stopping,
}


def ignore_targets(drive: SimulatedDrive) -> Callable[[], object]:
    """Ignore the targets of a drive; return a function that repairs the fault."""
    mode = drive.axis.modes[Mode.CYCLIC_SYNCHRONOUS_POSITION]
    vars(mode).update(latch=lambda: None, status=lambda: 0)
    return lambda: (vars(mode).pop('latch'), vars(mode).pop('status'))

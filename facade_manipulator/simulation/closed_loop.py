"""
The whole loop in one thread and without a clock: estimator, compensation, setpoints, drives, wall.

Everything but the bus is the real thing; the drives are a first-order lag behind the command that
they latch one cycle later and reach one cycle after that.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
import math
from typing import NamedTuple

from facade_manipulator.compensation import (
    Compensator,
    CompensatorSettings,
    CorrectedPose,
    DEFAULTS,
)
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import (
    Carriages,
    Geometry,
    mechanism_of,
    Pose,
    Wrench,
)
from facade_manipulator.motion import (
    GoalSettings,
    MechanismGuard,
    MotionLimits,
    SetpointFollower,
    SetpointStream,
    StreamSettings,
)
from facade_manipulator.simulation.estimator import EstimatorSettings, SimulatedEstimator
from facade_manipulator.simulation.facade import Facade, FacadeSettings
from facade_manipulator.simulation.force_sensor import ForceSensor, ForceSensorSettings
from facade_manipulator.simulation.gondola import GondolaSettings
from facade_manipulator.simulation.motion import Motion
from facade_manipulator.simulation.reaction import PressedGondola
from facade_manipulator.simulation.wall import WallMeasurement, WallSample, WallSettings

START = 1000.0
CYCLES_AHEAD = 2


class LoopSettings(NamedTuple):
    """Settings of the loop's parts; times in s."""

    compensator: CompensatorSettings = DEFAULTS
    estimator: EstimatorSettings = EstimatorSettings()
    wall: WallSettings = WallSettings()
    facade: FacadeSettings = FacadeSettings()
    gondola: GondolaSettings = GondolaSettings()
    force_sensor: ForceSensorSettings = ForceSensorSettings()
    limits: MotionLimits = MotionLimits()
    period: float = 0.01
    drive_lag: float = 0.015
    assumed_lag: float = 0.015
    sensor_delay: float = 0.005


class LoopStep(NamedTuple):
    """One cycle: what was asked for, and the head on the wall when the drives got there."""

    corrected: CorrectedPose | None
    command: Carriages
    actual: Carriages
    sample: WallSample
    wrench: Wrench  #: of the wall on the head
    measured: Wrench | None  #: what the sensor says of it
    rail: Pose


class ClosedLoop:
    """
    Run the loop cycle by cycle.

    The motion counts from the start, without the head on the wall; the head is in the rail's frame
    at the start. The machine that was made may be another than the parameters say.
    """

    def __init__(
        self, geometry: Geometry, settings: LoopSettings, motion: Motion, head: Pose,
        made: Geometry | None = None,
    ) -> None:
        def disturbance(time: float) -> Pose:
            return motion(time - START)

        self.settings = settings
        self.now = START  #: time of the next cycle [s]
        self.compensator = Compensator(geometry, settings.compensator)
        self.gondola = PressedGondola(disturbance, Facade(settings.facade), settings.gondola)
        self.estimator = SimulatedEstimator(settings.estimator, self.gondola.at, START)
        self.wall = WallMeasurement(made or geometry, settings.wall, self.gondola.at)
        self.rejections: list[str] = []
        self.follower = SetpointFollower(
            StreamSettings(), settings.limits, settings.period, MechanismGuard(geometry))
        self._mechanism, self._made = mechanism_of(geometry), mechanism_of(made or geometry)
        self._sensor = ForceSensor(settings.force_sensor)
        self._under_way: deque[LoopStep] = deque()
        self._stream = SetpointStream(geometry, GoalSettings())
        self._actual = self._mechanism.inverse_kinematics(head)
        self._command = self._actual
        self.follower.reset(self._actual)

    def send_goal(self, goal: Pose) -> None:
        """Give a goal on the wall, as the supervisor does."""
        self.compensator.set_goal(goal)
        self.wall.set_goal(self.now, goal)

    def run(self, duration: float) -> list[LoopStep]:
        """Run for a time [s]; return every cycle."""
        return [self.step() for _ in range(round(duration / self.settings.period))]

    def step(self) -> LoopStep:
        """Run one cycle."""
        now, period = self.now, self.settings.period
        self._deliver(now - self.settings.sensor_delay)
        for estimate in self.estimator.advance(now):
            self._attempt(self.compensator.add_estimate, now, *estimate)
        corrected = self.compensator.update(now)
        if corrected is not None:
            self._attempt(self._add, now, corrected)
        reached = now + CYCLES_AHEAD * period
        command = Carriages(*self.follower.sample(reached + self.settings.assumed_lag))
        self._move(command)
        wrench = self.gondola.advance(reached, self._made.forward_kinematics(self._actual))
        sample = self.wall.measure(reached, self._actual)
        step = LoopStep(corrected, command, self._actual, sample, wrench,
                        self._sensor.measure(reached, wrench), self.gondola.at(reached))
        self._under_way.append(step)
        self.now = now + period
        return step

    def _deliver(self, until: float) -> None:
        """Hand over what the sensors have seen up to a time [s]."""
        contact = self.compensator.contact
        while self._under_way and self._under_way[0].sample.time <= until:
            step = self._under_way.popleft()
            sample = step.sample
            if self.settings.facade.present and step.measured is not None:
                self._attempt(contact.add_wrench, self.now, sample.time, step.measured)
            self._attempt(self.compensator.following.add_head, sample.time,
                          self._mechanism.forward_kinematics(step.actual))
            if self.settings.wall.slip_sensor and sample.settled:
                self._attempt(self.compensator.add_lateral_offset, self.now, sample.time,
                              sample.lateral_offset)

    def _add(self, now: float, corrected: CorrectedPose) -> None:
        self.follower.add(self._stream.setpoint(corrected.time, corrected.pose), now)

    def _move(self, command: Carriages) -> None:
        """Let the carriages follow the ramp from the last command to this one."""
        period, lag = self.settings.period, self.settings.drive_lag
        decay = math.exp(-period / lag) if lag > 0.0 else 0.0
        moved = []
        for actual, last, new in zip(self._actual, self._command, command, strict=True):
            steady = (new - last) / period * lag
            moved.append(new - steady - (last - actual - steady) * decay)
        self._actual, self._command = Carriages(*moved), command

    def _attempt(self, take: Callable, *arguments) -> None:
        try:
            take(*arguments)
        except ManipulatorError as error:
            self.rejections.append(str(error))

"""
The whole loop in one thread and without a clock: estimator, compensation, setpoints, drives, wall.

Everything but the bus is the real thing; the drives are a first-order lag behind the command that
they latch one cycle later and reach one cycle after that.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
import math
from typing import Any, NamedTuple

from facade_manipulator.compensation.compensator import Compensator, CorrectedPose
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Carriages, Geometry, mechanism_of, Pose, Wrench
from facade_manipulator.lab.gondola.facade import Facade
from facade_manipulator.lab.gondola.motion import Motion
from facade_manipulator.lab.gondola.rail_sensors import EstimatorOnRail
from facade_manipulator.lab.gondola.reaction import PressedGondola
from facade_manipulator.lab.gondola.scenario import Scenario
from facade_manipulator.lab.gondola.sensors import ForceSensor, SimulatedEstimator
from facade_manipulator.lab.gondola.wall import WallMeasurement, WallSample
from facade_manipulator.motion.follower import SetpointFollower, StreamSettings
from facade_manipulator.motion.guard import mechanism_guard
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.motion.setpoints import GoalSettings, SetpointStream

START = 1000.0
PERIOD = 0.01  # s, of the bus
CYCLES_AHEAD = 2
ASSUMED_LAG = 0.015  # s, of the drives
SENSOR_DELAY = 0.005  # s
HEAD_START = 1.0  # s, of the estimator, before the first goal
CLEARANCE = 0.02  # m, from the wall at the start


class LoopStep(NamedTuple):
    """One cycle: what was asked for, and the head on the wall when the drives got there."""

    corrected: CorrectedPose | None
    actual: Carriages
    sample: WallSample
    wrench: Wrench  #: of the wall on the head


class ClosedLoop:
    """
    Run the loop cycle by cycle.

    The motion counts from the start, without the head on the wall; the head is in the rail's frame
    at the start, by default at the first goal. The machine that was made may be different from
    what the parameters say.
    """

    drive_lag = ASSUMED_LAG  #: of the drives that are there [s]

    def __init__(
        self, geometry: Geometry, scenario: Scenario, motion: Motion, head: Pose | None = None,
        made: Geometry | None = None, limits: MotionLimits | None = None,
    ) -> None:
        self.scenario = scenario
        self.now = START  #: time of the next cycle [s]
        self.compensator = Compensator(geometry, scenario.compensator)
        self.gondola = PressedGondola(
            lambda time: motion(time - START), Facade(scenario.facade), scenario.gondola)
        self.estimator: SimulatedEstimator | EstimatorOnRail = (
            EstimatorOnRail(scenario.sensors, self.gondola.at, START)
            if scenario.sensors.rail.present
            else SimulatedEstimator(scenario.estimator, self.gondola.at, START))
        self.wall = WallMeasurement(scenario.wall, self.gondola.at)
        self.rejections: list[str] = []
        self.follower = SetpointFollower(
            StreamSettings(), limits or MotionLimits(), PERIOD, mechanism_guard(geometry))
        self._mechanism, self._made = mechanism_of(geometry), mechanism_of(made or geometry)
        self._sensor = ForceSensor(scenario.force_sensor)
        self._under_way: deque[LoopStep] = deque()
        self._stream = SetpointStream(geometry, GoalSettings())
        self._actual = self._mechanism.inverse_kinematics(head or _begin(scenario))
        self._command = self._actual
        self.follower.reset(self._actual)

    def send_goal(self, goal: Pose) -> None:
        """Give a goal on the wall, as the supervisor does."""
        self.compensator.set_goal(goal)
        self.wall.set_goal(self.now, goal)

    def mission(self, duration: float) -> Iterator[LoopStep]:
        """Give the mission's goals as long as they are due before a time [s]; yield each cycle."""
        mission = self.scenario.mission
        yield from self._cycles(HEAD_START)
        for number in range(math.ceil(duration / mission.goal_period)):
            self.send_goal(mission.goal(number * mission.goal_period))
            yield from self._cycles(mission.goal_period)

    def run(self, duration: float) -> list[LoopStep]:
        """Run for a time [s]; return every cycle."""
        return list(self._cycles(duration))

    def _cycles(self, duration: float) -> Iterator[LoopStep]:
        return (self.step() for _ in range(round(duration / PERIOD)))

    def step(self) -> LoopStep:
        """Run one cycle."""
        now = self.now
        self._deliver(now - SENSOR_DELAY)
        for estimate in self.estimator.advance(now):
            self._attempt(self.compensator.add_estimate, now, *estimate[:3])
        corrected = self.compensator.update(now)
        if corrected is not None:
            self._attempt(self._add, now, corrected)
        reached = now + CYCLES_AHEAD * PERIOD
        self._move(Carriages(*self.follower.sample(reached + ASSUMED_LAG)))
        head = self._made.forward_kinematics(self._actual)
        wrench = self.gondola.advance(reached, head)
        step = LoopStep(corrected, self._actual, self.wall.measure(reached, head), wrench)
        self._under_way.append(step)
        self.now = now + PERIOD
        return step

    def _deliver(self, until: float) -> None:
        """Hand over what the sensors have seen up to a time [s]."""
        contact = self.compensator.contact
        while self._under_way and self._under_way[0].sample.time <= until:
            step = self._under_way.popleft()
            sample = step.sample
            if self.scenario.facade.present:
                self._attempt(contact.add_wrench, self.now, sample.time,
                              self._sensor.measure(step.wrench))
            self._attempt(self.compensator.following.add_head, sample.time,
                          self._mechanism.forward_kinematics(step.actual))

    def _add(self, now: float, corrected: CorrectedPose) -> None:
        self.follower.add(self._stream.setpoint(corrected.time, corrected.pose), now)

    def _move(self, command: Carriages) -> None:
        """Let the carriages follow the ramp from the last command to this one."""
        decay = math.exp(-PERIOD / self.drive_lag)
        moved = []
        for actual, last, new in zip(self._actual, self._command, command, strict=True):
            steady = (new - last) / PERIOD * self.drive_lag
            moved.append(new - steady - (last - actual - steady) * decay)
        self._actual, self._command = Carriages(*moved), command

    def _attempt(self, take: Callable[..., object], *arguments: Any) -> None:
        try:
            take(*arguments)
        except ManipulatorError as error:
            self.rejections.append(str(error))


def _begin(scenario: Scenario) -> Pose:
    """Return where the head begins: at the first goal, but off the wall if there is one."""
    goal, wall = scenario.mission.goal(0.0), scenario.facade
    if not wall.present:
        return goal
    return goal._replace(y=min(goal.y, wall.distance - CLEARANCE))

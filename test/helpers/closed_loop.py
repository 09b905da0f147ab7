"""
The control of the package on the simulated world, in one thread and without a clock.

Compensator, setpoints and follower are those of the nodes. A command that is computed in one
cycle is latched in the next one and reached in the one after that, as on the bus.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
import math
from typing import Any, NamedTuple

import numpy as np
from sensor_record import feed, SETUP

from facade_manipulator.compensation.compensator import Compensator, CompensatorSettings
from facade_manipulator.compensation.following import LEAST_ERROR
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.estimation.estimator import DisturbanceEstimator
from facade_manipulator.kinematics import Carriages, Geometry, Mechanism, Pose, Wrench
from facade_manipulator.motion.follower import SetpointFollower, StreamSettings
from facade_manipulator.motion.guard import mechanism_guard
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.motion.setpoints import GoalSettings, SetpointStream
from facade_manipulator.prediction.estimate import Estimate, Variances
from facade_manipulator.simulation.world.scenario import Scenario
from facade_manipulator.simulation.world.world import World

START = 1000.0  # s, so that no code takes 0 for the beginning of time
PERIOD = 0.01  # s, of the bus
CYCLES_AHEAD = 2  # from a command to the carriages
DRIVE_LAG = 0.015  # s, of the drives
ESTIMATOR_START = 1.0  # s, from the first estimates to the first goal


class Cycle(NamedTuple):
    """The world after one cycle."""

    time: float  #: [s]
    goal: Pose | None  #: on the wall
    rail: Pose  #: true disturbance
    head: Pose  #: true pose on the wall
    wrench: Wrench  #: true wrench of the brush on the head
    error: Pose  #: of the head, to its path on the wall
    uncompensated: Pose  #: the same of a mechanism that stands still
    is_limited: bool  #: by the workspace or by the limits of motion


class ClosedLoop:
    """Run the control cycle by cycle."""

    def __init__(
        self, scenario: Scenario, head: Pose | None = None, drive_lag: float = DRIVE_LAG
    ) -> None:
        geometry = Geometry()
        self.now = START  #: time of the next cycle [s]
        self.scenario = scenario
        self.world = World(scenario, geometry, START, head, drive_lag)
        self.compensator = Compensator(geometry, CompensatorSettings.of(scenario.compensator))
        self.rejections: list[str] = []
        self.goal: Pose | None = None
        self._mechanism = Mechanism(geometry)
        self._stream = SetpointStream(geometry, GoalSettings())
        self.follower = SetpointFollower(
            StreamSettings(), MotionLimits(), PERIOD, mechanism_guard(geometry))
        self.follower.reset(self.world.carriages)
        self._command = self.world.carriages  # computed in the previous cycle
        self._measured: tuple[float, Carriages, Wrench] | None = None
        self._references: list[tuple[float, Pose]] = []
        self.estimator = DisturbanceEstimator(SETUP) if scenario.raw_sensors else None

    def send_goal(self, goal: Pose) -> None:
        """Send a goal on the wall, as the supervisor does."""
        self.goal = goal
        self.compensator.set_goal(goal)

    def run(self, duration: float) -> list[Cycle]:
        """Run for a time [s]."""
        return [self.step() for _ in range(round(duration / PERIOD))]

    def mission(self, duration: float) -> Iterator[Cycle]:
        """Send the goals of the mission for a time [s]."""
        mission = self.scenario.mission
        yield from self.run(ESTIMATOR_START)
        for number in range(math.ceil(duration / mission.goal_period)):
            self.send_goal(mission.goal(number * mission.goal_period))
            yield from self.run(mission.goal_period)

    def step(self) -> Cycle:
        """Run one cycle."""
        now = self.now
        if self._measured is not None:
            stamp, carriages, wrench = self._measured
            if self.scenario.wall.is_touched:
                self._attempt(self.compensator.contact.add_wrench, now, stamp, wrench)
            self._attempt(self.compensator.following.add_head, stamp,
                          self._mechanism.forward_kinematics(carriages))
        self._measured = now, self.world.carriages, self.world.measure_wrench()
        for estimate in self._estimates(now):
            self._attempt(self.compensator.add_estimate, now, *estimate[:3])
        corrected = self.compensator.update(now)
        is_limited = False
        if corrected is not None:
            self._references.append((corrected.time, corrected.reference))
            is_limited = any(
                abs(error) > LEAST_ERROR for error in corrected.saturation_error)
            self._attempt(lambda: self.follower.add(
                self._stream.setpoint(corrected.time, corrected.pose), now))
        self.now = now + PERIOD
        self.world.advance(self.now, self._command)
        reached = now + CYCLES_AHEAD * PERIOD
        self._command = Carriages(*self.follower.sample(reached + DRIVE_LAG))
        world, reference = self.world, self._reference()
        return Cycle(
            self.now, self.goal, world.rail, world.head, world.wrench,
            *world.wall_errors(reference), is_limited)

    def _reference(self) -> Pose:
        """Return where on its path the head should be now; the goal once it has arrived."""
        while len(self._references) > 1 and self._references[1][0] <= self.now + 1e-9:
            del self._references[0]
        if not self._references:
            return self.world.head
        return self._references[0][1]

    def _estimates(self, now: float) -> list[Estimate]:
        if self.estimator is None:
            return self.world.estimator.receive(now)
        for measurement in self.world.raw_sensors.receive(now):
            feed(self.estimator, now, measurement, [])
        motion = self.estimator.advance(now)
        return [] if motion is None else [Estimate(
            motion.stamp, motion.pose, Variances(*np.diag(motion.covariance).tolist()))]

    def _attempt(self, take: Callable[..., object], *arguments: Any) -> None:
        try:
            take(*arguments)
        except ManipulatorError as error:
            self.rejections.append(str(error))

"""
Control of the package on the simulated world, in one thread and without a clock.

Compensator, setpoints and follower are those of the nodes. A command is latched in the next cycle
and reached one cycle later, as on the bus.
"""

from collections import deque
from collections.abc import Callable
import math
from typing import Any, NamedTuple

import numpy as np
from sensor_record import feed, PERIOD, SETUP, START

from facade_manipulator.compensation.held_back import HeldBack
from facade_manipulator.compensation.pose_compensator import (
    Compensator,
    CompensatorSettings,
)
from facade_manipulator.drives.guard import MechanismCheck
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.estimation.rail_pose_filter import DisturbanceEstimator
from facade_manipulator.kinematics import (
    Carriages,
    compose,
    difference,
    Geometry,
    Mechanism,
    MIN_CONDITIONING,
    Pose,
    Wrench,
)
from facade_manipulator.motion.follower import SetpointFollower, StreamSettings
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.motion.setpoints import SetpointStream
from facade_manipulator.parameters import ParameterSource
from facade_manipulator.prediction.estimate import Estimate
from facade_manipulator.simulation.world.scenario import Scenario
from facade_manipulator.simulation.world.world import World

CYCLES_AHEAD = 2  # from a command to the carriages
DRIVE_LAG = 0.015  # s, of the drives
ESTIMATOR_START = 1.0  # s, from the first estimates to the first goal


class Cycle(NamedTuple):
    """State of the world after one cycle."""

    time: float  #: [s]
    rail: Pose  #: true disturbance
    head: Pose  #: true pose on the wall
    wrench: Wrench  #: true wrench of the brush on the head
    error: Pose  #: of the head, to its path on the wall
    uncompensated: Pose  #: the same of a mechanism at rest
    is_limited: bool  #: by the workspace
    command: Carriages  #: to the drives
    predicted: Pose | None  #: disturbance that was predicted for this time
    deviations: tuple[float, ...] | None  #: its published standard deviations


class Plan(NamedTuple):
    """Pose on the wall for a time, and the disturbance predicted for it."""

    time: float  #: [s]
    reference: Pose
    predicted: Pose | None
    deviations: tuple[float, ...] | None


class ClosedLoop:
    """Control loop that runs cycle by cycle."""

    def __init__(
        self, scenario: Scenario, head: Pose | None = None, drive_lag: float = DRIVE_LAG
    ) -> None:
        geometry = Geometry()
        self.now = START  #: time of the next cycle [s]
        self.scenario = scenario
        self.world = World(scenario, geometry, START, head, drive_lag)
        self.compensator = Compensator(
            geometry,
            CompensatorSettings.read(ParameterSource(scenario.compensator)),
        )
        self.rejections: list[str] = []
        self.follower = SetpointFollower(
            StreamSettings(), MotionLimits(), PERIOD, MechanismCheck(geometry).exact
        )
        self.follower.reset(self.world.carriages)
        self._mechanism = Mechanism(geometry)
        self._stream = SetpointStream(geometry, MIN_CONDITIONING)
        self._command = self.world.carriages  # computed in the previous cycle
        self._measured: tuple[float, Carriages, Wrench] | None = None
        self._plans: deque[Plan] = deque()
        self.estimator = DisturbanceEstimator(SETUP) if scenario.raw_sensors else None

    def run(self, duration: float) -> list[Cycle]:
        """Run for a time [s]."""
        return [self.step() for _ in range(round(duration / PERIOD))]

    def follow(
        self, goal: Pose, duration: float, before: float = ESTIMATOR_START
    ) -> list[Cycle]:
        """Run for a time [s], then follow a goal on the wall; return the cycles with the goal."""
        self.run(before)
        self.compensator.set_goal(goal)
        return self.run(duration)

    def mission(self, duration: float) -> list[Cycle]:
        """Follow the goals of the mission for a time [s]."""
        mission = self.scenario.mission
        cycles = self.run(ESTIMATOR_START)
        for number in range(math.ceil(duration / mission.goal_period)):
            goal = mission.goal(number * mission.goal_period)
            cycles += self.follow(goal, mission.goal_period, 0.0)
        return cycles

    def step(self) -> Cycle:
        """Run one cycle of the control."""
        now = self.now
        compensator = self.compensator
        if self._measured is not None:
            stamp, carriages, wrench = self._measured
            if self.scenario.wall.is_touched:
                self._attempt(compensator.contact.add_wrench, now, stamp, wrench)
            head = self._mechanism.forward_kinematics(carriages)
            self._attempt(compensator.following.add_head, now, stamp, head)
        self._measured = now, self.world.carriages, self.world.measure_wrench()
        for estimate in self._estimates(now):
            self._attempt(compensator.add_estimate, now, *estimate[:3])
        corrected = compensator.update(now)
        is_limited = False
        if corrected is not None:
            time = corrected.time
            predicted = compensator.correction.disturbance(time)
            deviations = compensator.correction.deviations(time)
            plan = Plan(time, corrected.reference, predicted, deviations)
            self._plans.append(plan)
            most = max(map(abs, corrected.saturation_error))
            is_limited = most > HeldBack.LEAST_ERROR
            self._attempt(self._add_setpoint, time, corrected.pose, now)
        self.now = now + PERIOD
        self.world.advance(self.now, self._command)
        reach_time = now + CYCLES_AHEAD * PERIOD + DRIVE_LAG
        self._command = Carriages(*self.follower.sample(reach_time))
        return self._cycle(is_limited)

    def _add_setpoint(self, time: float, pose: Pose, now: float) -> None:
        self.follower.add(self._stream.setpoint(time, pose), now)

    def _cycle(self, is_limited: bool) -> Cycle:
        """Compare the world with the plan for the present time."""
        while len(self._plans) > 1 and self._plans[1].time <= self.now + 1e-9:
            self._plans.popleft()
        plan = Plan(self.now, self.world.head, None, None)
        if self._plans:
            plan = self._plans[0]
        reference = plan.reference
        return Cycle(
            self.now,
            self.world.rail,
            self.world.head,
            self.world.wrench,
            difference(self.world.head, reference),
            difference(compose(self.world.rail, reference), reference),
            is_limited,
            self._command,
            plan.predicted,
            plan.deviations,
        )

    def _estimates(self, now: float) -> list[Estimate]:
        if self.estimator is None:
            return self.world.estimator.receive(now)
        for measurement in self.world.raw_sensors.receive(now):
            feed(self.estimator, now, measurement, [])
        motion = self.estimator.advance(now)
        if motion is None:
            return []
        variances = tuple(np.diag(motion.covariance).tolist())
        return [Estimate(motion.stamp, motion.pose, variances)]

    def _attempt(self, take: Callable[..., object], *arguments: Any) -> None:
        try:
            take(*arguments)
        except ManipulatorError as error:
            self.rejections.append(str(error))

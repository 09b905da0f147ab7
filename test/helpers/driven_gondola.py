"""A gondola, and on it the compensator, the driver's control loop and simulated CiA 402 drives."""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

from virtual_world import World

from facade_manipulator.compensation import Compensator, CorrectedPose
from facade_manipulator.drives.controller import ControllerSettings, ControllerState
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Carriages, Geometry, mechanism_of
from facade_manipulator.lab.gondola import (
    Scenario,
    SimulatedEstimator,
    WallMeasurement,
    WallSample,
)
from facade_manipulator.lab.gondola.closed_loop import HEAD_START
from facade_manipulator.motion import GoalSettings, SetpointStream

LONGEST = 70.0  # s, of a request to the driver
# the lag of the simulated drives
CONTROLLER = ControllerSettings(own_garbage_collection=False, drive_lag=0.005)


class Cycle(NamedTuple):
    """What came of one cycle."""

    elapsed: float  #: since the first estimate [s]
    corrected: CorrectedPose
    sample: WallSample


class DrivenGondola:
    """The loop is closed after each cycle of the driver, with what its drives have answered."""

    def __init__(self, scenario: Scenario) -> None:
        self.world = World(CONTROLLER)
        self.cycles: list[Cycle] = []
        self._mission, motion, geometry = scenario.mission, scenario.motion(), Geometry()
        self._mechanism = mechanism_of(geometry)
        self._compensator = Compensator(geometry, scenario.compensator)
        self._stream = SetpointStream(geometry, GoalSettings())
        for name in ('configure', 'home', 'activate'):
            self.world.finish(self.world.controller.request(name), LONGEST)
        self._stamp = 0.0
        self._start = start = self.world.time.time()
        self._at = lambda time: motion(time - start)
        self._estimator = SimulatedEstimator(scenario.estimator, self._at, start)
        self._wall = WallMeasurement(scenario.wall, self._at)

    def run(self) -> list[Cycle]:
        """Run the mission; return all cycles from the first goal on."""
        try:
            self.world.run(HEAD_START + self._mission.duration, self._cycle)
        finally:
            self.world.close()
        return self.cycles

    def _cycle(self) -> None:
        now, snapshot = self.world.time.time(), self.world.controller.snapshot()
        assert snapshot.state is ControllerState.ACTIVE, snapshot.cause
        stamp, positions, *_ = snapshot.joints()
        if stamp == self._stamp:
            return  # the run ends between two cycles
        self._stamp = stamp
        head = self._mechanism.forward_kinematics(Carriages(*positions))
        self._compensator.following.add_head(stamp, head)
        for estimate in self._estimator.advance(now):
            with suppress(ManipulatorError):  # older than the one before
                self._compensator.add_estimate(now, *estimate[:3])
        if now < self._start + HEAD_START:
            return
        goal = self._mission.goal(now - self._start - HEAD_START)
        if goal != self._compensator.goal:
            self._compensator.set_goal(goal)
            self._wall.set_goal(now, goal)
        corrected = self._compensator.update(now)
        with suppress(ManipulatorError):  # what the driver does not take
            self.world.stream(self._stream.setpoint(corrected.time, corrected.pose))
        self.cycles.append(
            Cycle(stamp - self._start, corrected, self._wall.measure(stamp, head)))

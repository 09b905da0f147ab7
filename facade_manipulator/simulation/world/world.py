"""The gondola, the manipulator on it and the wall as one MuJoCo world without a clock."""

from __future__ import annotations

from collections.abc import Callable
import math
from typing import Any

import mujoco
import numpy as np

from facade_manipulator.kinematics import Carriages, compose, difference, Geometry, Pose, Wrench
from facade_manipulator.prediction import Estimate
from facade_manipulator.simulation.world.model import build_model, initial_state
from facade_manipulator.simulation.world.motion import prescribed_motion
from facade_manipulator.simulation.world.scenario import Scenario
from facade_manipulator.simulation.world.sensors import Measurement, RawSensors, SimulatedEstimator
from facade_manipulator.simulation.world.wind import drag, Gusts

CLEARANCE = 0.02  # m, from the wall to the head at the start
WIND_PERIOD = 0.01  # s, from one change of the wind's force to the next


class World:
    """
    Advance from time to time; the same seed and the same calls give the same numbers.

    Parameters
    ----------
    scenario : Scenario
    geometry : Geometry
        Of the machine as it was made.
    start : float
        Time at which the world begins [s].
    head : Pose or None
        In frame rail at the start; by default the first goal, but off the wall.
    drive_lag : float
        Time constant with which the carriages follow their targets [s]. 0 where simulated drives
        move the carriages: their lag is in the positions that they report.

    """

    def __init__(
        self, scenario: Scenario, geometry: Geometry, start: float = 0.0,
        head: Pose | None = None, drive_lag: float = 0.0,
    ) -> None:
        self.scenario = scenario
        self._start, self._lag = start, drive_lag
        self._motion = prescribed_motion(scenario.motion)
        self.model = build_model(geometry, scenario, self._motion is not None)
        self.data: Any = initial_state(self.model, geometry, head or first_head(scenario))
        self._target = self._lagged = np.array(self.carriages)
        _, stiffness, damping = self.model.actuator('q1').biasprm[:3]
        self._damping_time = damping / stiffness  # s, by which the servos alone would lag
        # the weld is a spring and a damper of 2 timeconst, and the damper resists the carrier
        self._carrier_lag = 2.0 * float(self.model.equality('carrier').solref[0])  # s
        wind, estimator, sensors, wrench = (
            np.random.default_rng((scenario.seed, part)) for part in range(4))
        self._wrench_noise = wrench
        self._estimator = SimulatedEstimator(scenario.estimator, start, estimator)
        self._sensors = RawSensors(scenario.sensors, sensors)
        self._gusts = Gusts(scenario.wind, wind) if scenario.wind.mean_speed else None
        self._periodic = self._schedule()
        if self._motion is not None:
            self._begin_motion(self._motion)

    @property
    def time(self) -> float:
        """Time to which the world has advanced [s]."""
        return self._start + float(self.data.time)

    @property
    def rail(self) -> Pose:
        """True disturbance: pose of the rail in frame facade [m, m, rad]."""
        return self._pose('rail')

    @property
    def head(self) -> Pose:
        """True pose of the head in frame facade [m, m, rad]."""
        return self._pose('head')

    @property
    def carriages(self) -> Carriages:
        """Positions of the carriages [m]."""
        return Carriages(*(float(self.data.joint(name).qpos[0]) for name in Carriages._fields))

    @property
    def wrench(self) -> Wrench:
        """Wrench of the brush on the head in its frame, without noise [N, N, N m]."""
        fx, fy, _ = self.data.sensor('force').data.tolist()  # of the head on the brush
        return Wrench(-fx, -fy, -float(self.data.sensor('torque').data[2]))

    def measure_wrench(self) -> Wrench:
        """Return a reading of the force sensor, with noise."""
        wall = self.scenario.wall
        return Wrench(*self._wrench_noise.normal(
            self.wrench, (wall.force_noise, wall.force_noise, wall.moment_noise)).tolist())

    def wall_error(self, goal: Pose) -> Pose:
        """Return how far the head is from a goal on the wall [m, m, rad]."""
        return difference(self.head, goal)

    def uncompensated_error(self, goal: Pose) -> Pose:
        """Return how far a mechanism would be that stands still at the goal [m, m, rad]."""
        return difference(compose(self.rail, goal), goal)

    def estimates(self, now: float) -> list[Estimate]:
        """Return the estimates of the disturbance that have arrived since the last call."""
        return self._estimator.queue.receive(now)

    def measurements(self, now: float) -> list[Measurement]:
        """Return the measurements of raw sensors that have arrived since the last call."""
        return self._sensors.queue.receive(now)

    def advance(self, time: float, target: Carriages) -> None:
        """Advance to a time [s] while the drives' targets move linearly to new ones [m]."""
        data, step = self.data, self.model.opt.timestep
        count = round((time - self.time) / step)
        if count <= 0:
            return
        *controls, last = self._controls(np.array(target), count, step)
        for number, control in enumerate(controls, round(data.time / step)):
            self._command(control)
            mujoco.mj_step(self.model, data)
            for every, act in self._periodic:
                if number % every == 0:  # mj_step leaves sensors and places as before it
                    act(self._start + number * step)
        self._command(last)
        mujoco.mj_forward(self.model, data)

    def _command(self, control: np.ndarray) -> None:
        self.data.ctrl[:] = control
        if self._motion is not None:
            pose = self._motion(self.data.time + self._carrier_lag)
            _place(pose, self.data.mocap_pos[0], self.data.mocap_quat[0])

    def _controls(self, target: np.ndarray, count: int, step: float) -> np.ndarray:
        """Return the servos' inputs at the ends of all steps to new targets [m], (n + 1, 3)."""
        elapsed = step * np.arange(count + 1)[:, None]
        rate = (target - self._target) / (count * step)
        behind = self._target - rate * self._lag
        # exact answer of a first-order lag to a ramp
        decay = np.exp(-elapsed / self._lag) if self._lag else elapsed == 0.0
        lagged = behind + rate * elapsed + (self._lagged - behind) * decay
        self._target, self._lagged = target, lagged[-1]
        velocities = np.diff(lagged, axis=0)[[*range(count), -1]] / step
        controls: np.ndarray = lagged + self._damping_time * velocities
        return controls

    def _schedule(self) -> list[tuple[int, Callable[[float], None]]]:
        """Return what happens every so many steps."""
        settings, raw, data = self.scenario.sensors, self._sensors, self.data
        tasks: list[tuple[float, Callable[[float], None]]] = [
            (settings.imu_rate, lambda stamp: raw.sample_imu(stamp, data)),
            (settings.range_rate, lambda stamp: raw.sample_ranges(stamp, data)),
            (settings.fix_rate, lambda stamp: raw.sample_fix(stamp, data)),
        ] if settings.present else [
            (self.scenario.estimator.rate, lambda stamp: self._estimator.sample(stamp, self.rail))]
        if self._gusts is not None and self._motion is None:
            tasks.append((1.0 / WIND_PERIOD, self._blow))
        return [(round(1.0 / (rate * self.model.opt.timestep)), task) for rate, task in tasks]

    def _blow(self, stamp: float) -> None:
        """Change the wind's force; that of the mean wind is in the place in still air."""
        gondola, gusts, data = self.scenario.gondola, self._gusts, self.data
        assert gusts is not None
        wind = gusts.velocity(stamp - self._start) - data.joint('gondola').qvel[:2]
        force = drag(gondola, wind) - drag(gondola, gusts.mean)
        moment = gondola.pressure_offset * force[1]
        data.body('gondola').xfrc_applied[:] = (*force, 0.0, 0.0, 0.0, moment)

    def _begin_motion(self, motion: Callable[[float], Pose]) -> None:
        """Let the gondola begin on its prescribed path."""
        joint, data, instant = self.data.joint('gondola'), self.data, 1e-4
        _place(motion(0.0), joint.qpos[:3], joint.qpos[3:])
        change = np.subtract(motion(instant), motion(-instant)) / (2.0 * instant)
        joint.qvel[:] = (*change[:2], 0.0, 0.0, 0.0, change[2])
        mujoco.mj_forward(self.model, data)

    def _pose(self, site: str) -> Pose:
        view = self.data.site(site)
        x, y, _ = view.xpos.tolist()
        return Pose(x, y, math.atan2(view.xmat[3], view.xmat[0]))


def first_head(scenario: Scenario) -> Pose:
    """Return the first goal, but off the wall."""
    goal = scenario.mission.goal(0.0)
    return goal._replace(y=min(goal.y, scenario.wall.distance - CLEARANCE))


def _place(pose: Pose, position: np.ndarray, quaternion: np.ndarray) -> None:
    """Write a planar pose into a body's position and quaternion."""
    position[:] = pose.x, pose.y, 0.0
    quaternion[:] = math.cos(0.5 * pose.theta), 0.0, 0.0, math.sin(0.5 * pose.theta)

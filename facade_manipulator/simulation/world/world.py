"""Gondola, manipulator and wall as one MuJoCo world without a clock."""

from __future__ import annotations

from functools import partial
import math
from typing import Any

import mujoco
import numpy as np

from facade_manipulator.kinematics import Carriages, Geometry, Pose, Wrench
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.simulation.world import sensors
from facade_manipulator.simulation.world.model import build_model, initial_state
from facade_manipulator.simulation.world.scenario import Scenario
from facade_manipulator.simulation.world.wind import drag, Gusts

CLEARANCE = 0.02  # m, from the wall to the head at the start
WIND_RATE = 100.0  # Hz, of changes of the wind's force


class World:
    """
    Simulated world; the same seed and the same calls give the same numbers.

    Parameters
    ----------
    scenario : Scenario
    geometry : Geometry
        Geometry of the machine as built.
    start : float
        Time at which the world begins [s].
    head : Pose or None
        Pose in frame rail at the start; by default the first goal, moved off the wall.
    drive_lag : float
        Time constant with which the carriages follow their targets [s]. The value is 0 with
        simulated drives, because the positions that they report contain their lag.

    """

    def __init__(
        self,
        scenario: Scenario,
        geometry: Geometry,
        start: float = 0.0,
        head: Pose | None = None,
        drive_lag: float = 0.0,
    ) -> None:
        self.scenario = scenario
        self._start, self._lag = start, drive_lag
        is_prescribed = any(vars(scenario.motion).values())
        self.model = build_model(geometry, scenario, is_prescribed)
        goal = scenario.mission.goal(0.0)
        off_wall = goal._replace(y=min(goal.y, scenario.wall.distance - CLEARANCE))
        self.data: Any = initial_state(self.model, geometry, head or off_wall)
        self._target = self._lagged = np.array(self.carriages)
        _, stiffness, damping = self.model.actuator('q1').biasprm[:3]
        self._damping_time = (
            damping / stiffness
        )  # s, lag of the servos without correction
        # the weld is a spring and a damper of 2 timeconst, and the damper resists the carrier
        self._carrier_lag = 2.0 * float(self.model.equality('carrier').solref[0])  # s
        wind, estimator, raw_sensors, self._wrench_noise = (
            np.random.default_rng((scenario.seed, part)) for part in range(4)
        )
        self.estimator = sensors.SimulatedEstimator(
            scenario.estimator, start, estimator
        )
        self.raw_sensors = sensors.RawSensors(raw_sensors)
        self._tasks: list[tuple[float, Any]] = (
            [  # rate [Hz], and a function of a stamp [s]
                (rate, partial(self.raw_sensors.sample, self.model, self.data, name))
                for name, (rate, _) in sensors.RAW_SENSORS.items()
            ]
            if scenario.raw_sensors
            else [
                (
                    scenario.estimator.rate,
                    lambda stamp: self.estimator.sample(stamp, self.rail),
                )
            ]
        )
        if scenario.wind.mean_speed and not is_prescribed:
            self._tasks.append(
                (WIND_RATE, partial(self._blow, Gusts(scenario.wind, wind)))
            )
        if is_prescribed:
            self._begin_motion()

    @property
    def time(self) -> float:
        """Return the time to which the world has advanced [s]."""
        return self._start + float(self.data.time)

    @property
    def rail(self) -> Pose:
        """Return the true disturbance: the pose of the rail in frame facade [m, m, rad]."""
        return self._pose('rail')

    @property
    def head(self) -> Pose:
        """Return the true pose of the head in frame facade [m, m, rad]."""
        return self._pose('head')

    @property
    def carriages(self) -> Carriages:
        """Return the positions of the carriages [m]."""
        return Carriages(*(float(self.data.joint(name).qpos[0]) for name in AXIS_NAMES))

    @property
    def wrench(self) -> Wrench:
        """Return the wrench of the brush on the head in its frame, without noise [N, N, N m]."""
        fx, fy, _ = self.data.sensor(
            'force'
        ).data.tolist()  # force of the head on the brush
        return Wrench(-fx, -fy, -float(self.data.sensor('torque').data[2]))

    def measure_wrench(self) -> Wrench:
        """Return a reading of the force sensor, with noise [N, N, N m]."""
        force, moment = (
            self.model.sensor(name).noise[0] for name in ('force', 'torque')
        )
        noise = self._wrench_noise.standard_normal(3) * (force, force, moment)
        return Wrench(*(noise + self.wrench).tolist())

    def advance(self, time: float, target: Carriages) -> None:
        """Advance to a time [s] while the drives' targets move linearly to new targets [m]."""
        data, step = self.data, self.model.opt.timestep
        count = round((time - self.time) / step)
        if count <= 0:
            return
        first = round(data.time / step)
        times = step * np.arange(first, first + count + 1) + self._carrier_lag
        tasks = [(round(1.0 / (rate * step)), task) for rate, task in self._tasks]
        *commands, last = zip(
            self._controls(np.array(target), count, step),
            *_placements(self.scenario.motion.poses(times)),
            strict=True,
        )
        # each access of `data` makes another view
        ctrl, position, attitude = data.ctrl, data.mocap_pos[0], data.mocap_quat[0]
        for number, command in enumerate(commands, first):
            ctrl[:], position[:], attitude[:] = command
            mujoco.mj_step(self.model, data)
            for every, act in tasks:
                if (
                    number % every == 0
                ):  # mj_step keeps sensors and poses from before the step
                    act(self._start + number * step)
        ctrl[:], position[:], attitude[:] = last
        mujoco.mj_forward(self.model, data)

    def _controls(self, target: np.ndarray, count: int, step: float) -> np.ndarray:
        """Return the inputs of the servos [m] at the ends of all steps, shape (n + 1, 3)."""
        elapsed = step * np.arange(count + 1)[:, None]
        rate = (target - self._target) / (count * step)
        behind = self._target - rate * self._lag
        # exact answer of a first-order lag to a ramp
        decay = np.exp(-elapsed / self._lag) if self._lag else elapsed == 0.0
        lagged = behind + rate * elapsed + (self._lagged - behind) * decay
        self._target, self._lagged = target, lagged[-1]
        velocities = np.diff(lagged, axis=0)[[*range(count), -1]] / step
        return lagged + self._damping_time * velocities

    def _blow(self, gusts: Gusts, stamp: float) -> None:
        """Set the force of the wind; the mean wind's force is part of the equilibrium."""
        gondola, data = self.scenario.gondola, self.data
        wind = gusts.velocity(stamp - self._start) - data.joint('gondola').qvel[:2]
        force = drag(gondola, wind) - drag(gondola, gusts.mean)
        data.body('gondola').xfrc_applied[:] = (
            *force,
            0.0,
            0.0,
            0.0,
            gondola.pressure_offset * force[1],
        )

    def _begin_motion(self) -> None:
        """Set the gondola onto its prescribed path."""
        joint, data, instant = self.data.joint('gondola'), self.data, 1e-4
        poses = self.scenario.motion.poses(np.array((-instant, 0.0, instant)))
        joint.qpos[:] = np.hstack(_placements(poses))[1]
        change = (poses[2] - poses[0]) / (2.0 * instant)
        joint.qvel[:] = (*change[:2], 0.0, 0.0, 0.0, change[2])
        mujoco.mj_forward(self.model, data)

    def _pose(self, site: str) -> Pose:
        view = self.data.site(site)
        x, y, _ = view.xpos.tolist()
        return Pose(x, y, math.atan2(view.xmat[3], view.xmat[0]))


def _placements(poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the positions [m] and the quaternions of planar poses, shapes (n, 3) and (n, 4)."""
    (x, y, theta), none = poses.T, np.zeros(len(poses))
    return (
        np.column_stack((x, y, none)),
        np.column_stack((np.cos(0.5 * theta), none, none, np.sin(0.5 * theta))),
    )

"""MuJoCo world of gondola, manipulator and wall, without a clock."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
import math
from typing import Any

import mujoco
import numpy as np

from facade_manipulator.kinematics import Carriages, Geometry, Pose, Wrench
from facade_manipulator.kinematics.geometry import AXIS_NAMES
from facade_manipulator.simulation.world import sensors
from facade_manipulator.simulation.world.mujoco_model import build_model, initial_state
from facade_manipulator.simulation.world.scenario import Scenario
from facade_manipulator.simulation.world.wind import drag, Gusts


class CarriageServos:
    """
    Carriage servos, which follow the targets of the drives with a lag.

    `World.advance` calls `inputs` once for each new target.
    """

    def __init__(self, model: mujoco.MjModel, carriages: Carriages, lag: float) -> None:
        self._lag = lag
        self._target = np.array(carriages)
        self._lagged = self._target
        _, stiffness, damping = model.actuator('q1').biasprm[:3]
        # s, lag of the servos without correction
        self._damping_time = damping / stiffness

    def inputs(self, target: np.ndarray, count: int, step: float) -> np.ndarray:
        """Return the servo inputs [m] at the ends of all steps, shape (n + 1, 3)."""
        elapsed = step * np.arange(count + 1)[:, None]
        rate = (target - self._target) / (count * step)

        # A first-order lag T answers a ramp p + r t exactly with
        # b + r t + (y − b) e^(−t/T), where b = p − r T and y is its value at the start.
        behind = self._target - rate * self._lag
        if self._lag:
            decay = np.exp(-elapsed / self._lag)
        else:
            decay = np.where(elapsed == 0.0, 1.0, 0.0)
        lagged = behind + rate * elapsed + (self._lagged - behind) * decay
        self._target = target
        self._lagged = lagged[-1]

        velocities = np.diff(lagged, axis=0)[[*range(count), -1]] / step
        return lagged + self._damping_time * velocities


class World:
    """
    Simulated world; the same seed and the same calls produce the same values.

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

    CLEARANCE = 0.02  # m, from the wall to the head at the start
    WIND_RATE = 100.0  # Hz, of changes of the wind's force

    def __init__(
        self,
        scenario: Scenario,
        geometry: Geometry,
        start: float = 0.0,
        head: Pose | None = None,
        drive_lag: float = 0.0,
    ) -> None:
        self.scenario = scenario
        self._start = start
        is_prescribed = any(vars(scenario.motion).values())
        self.model = build_model(geometry, scenario, is_prescribed)
        goal = scenario.mission.goal(0.0)
        off_wall = goal._replace(y=min(goal.y, scenario.wall.distance - self.CLEARANCE))
        self.data: Any = initial_state(self.model, geometry, head or off_wall)
        self._servos = CarriageServos(self.model, self.carriages, drive_lag)
        # the weld is a spring and a damper of 2 timeconst, and the damper resists the carrier
        self._carrier_lag = 2.0 * float(self.model.equality('carrier').solref[0])  # s

        seeds = [(scenario.seed, part) for part in range(4)]
        wind, estimator, raw_sensors, wrench = map(np.random.default_rng, seeds)
        self._wrench_noise = wrench
        self.estimator = sensors.SimulatedEstimator(
            scenario.estimator, start, estimator
        )
        self.raw_sensors = sensors.RawSensors(raw_sensors)

        # rate [Hz], and a function of a stamp [s]
        self._tasks: list[tuple[float, Callable[[float], None]]] = []
        if scenario.raw_sensors:
            for name, (rate, _) in sensors.RAW_SENSORS.items():
                read = partial(self.raw_sensors.sample, self.model, self.data, name)
                self._tasks.append((rate, read))
        else:
            self._tasks.append((scenario.estimator.rate, self._estimate))
        if is_prescribed:
            self._begin_motion()
        elif scenario.wind.mean_speed:
            blow = partial(self._blow, Gusts(scenario.wind, wind))
            self._tasks.append((self.WIND_RATE, blow))

    @property
    def time(self) -> float:
        """Return the current time of the world [s]."""
        return self._start + float(self.data.time)

    @property
    def rail(self) -> Pose:
        """Return the true disturbance: the rail's pose in frame facade [m, m, rad]."""
        return self._pose('rail')

    @property
    def head(self) -> Pose:
        """Return the true pose of the head in frame facade [m, m, rad]."""
        return self._pose('head')

    @property
    def carriages(self) -> Carriages:
        """Return the true carriage positions [m]."""
        return Carriages(*(float(self.data.joint(name).qpos[0]) for name in AXIS_NAMES))

    @property
    def wrench(self) -> Wrench:
        """Return the wrench of the brush on the head in its frame, without noise [N, N, N m]."""
        # force and moment of the head on the brush
        fx, fy, _ = self.data.sensor('force').data.tolist()
        _, _, moment = self.data.sensor('torque').data.tolist()
        return Wrench(-fx, -fy, -moment)

    def measure_wrench(self) -> Wrench:
        """Return a force sensor reading with noise [N, N, N m]."""
        force = self.model.sensor('force').noise[0]
        moment = self.model.sensor('torque').noise[0]
        noise = self._wrench_noise.standard_normal(3) * (force, force, moment)
        return Wrench(*(noise + self.wrench).tolist())

    def advance(self, time: float, target: Carriages) -> None:
        """Advance to a time [s] while the drive targets move linearly to new targets [m]."""
        data = self.data
        step = self.model.opt.timestep
        count = round((time - self.time) / step)
        if count <= 0:
            return

        first = round(data.time / step)
        times = step * np.arange(first, first + count + 1) + self._carrier_lag
        positions, attitudes = _placements(self.scenario.motion.poses(times))
        inputs = self._servos.inputs(np.array(target), count, step)
        *commands, last = zip(inputs, positions, attitudes, strict=True)
        tasks = [(round(1.0 / (rate * step)), task) for rate, task in self._tasks]

        # each access of `data` makes another view
        ctrl = data.ctrl
        position = data.mocap_pos[0]
        attitude = data.mocap_quat[0]
        for number, command in enumerate(commands, first):
            ctrl[:], position[:], attitude[:] = command
            mujoco.mj_step(self.model, data)
            for every, act in tasks:
                # mj_step keeps sensors and poses from before the step
                if number % every == 0:
                    act(self._start + number * step)
        ctrl[:], position[:], attitude[:] = last
        mujoco.mj_forward(self.model, data)

    def _estimate(self, stamp: float) -> None:
        self.estimator.sample(stamp, self.rail)

    def _blow(self, gusts: Gusts, stamp: float) -> None:
        """Apply the wind force; the force of the mean wind is part of the equilibrium."""
        gondola = self.scenario.gondola
        velocity = self.data.joint('gondola').qvel[:2]
        wind = gusts.velocity(stamp - self._start) - velocity
        force = drag(gondola, wind) - drag(gondola, gusts.mean)
        moment = gondola.pressure_offset * force[1]
        applied = self.data.body('gondola').xfrc_applied
        applied[:] = (*force, 0.0, 0.0, 0.0, moment)

    def _begin_motion(self) -> None:
        """Move the gondola onto its prescribed path."""
        joint = self.data.joint('gondola')
        instant = 1e-4  # s
        poses = self.scenario.motion.poses(np.array((-instant, 0.0, instant)))
        joint.qpos[:] = np.hstack(_placements(poses))[1]
        change = (poses[2] - poses[0]) / (2.0 * instant)
        joint.qvel[:] = (*change[:2], 0.0, 0.0, 0.0, change[2])
        mujoco.mj_forward(self.model, self.data)

    def _pose(self, site: str) -> Pose:
        view = self.data.site(site)
        x, y, _ = view.xpos.tolist()
        return Pose(x, y, math.atan2(view.xmat[3], view.xmat[0]))


def _placements(poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return positions [m] and quaternions of planar poses, shapes (n, 3) and (n, 4)."""
    x, y, theta = poses.T
    none = np.zeros(len(poses))
    positions = np.column_stack((x, y, none))

    cosine = np.cos(0.5 * theta)
    sine = np.sin(0.5 * theta)
    attitudes = np.column_stack((cosine, none, none, sine))
    return positions, attitudes

"""Made-up machines with errors as a shop leaves them, and what is measured and recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
import math

import numpy as np

from facade_manipulator.kinematics import compose, Geometry, mechanism_of, Pose
from facade_manipulator.lab.gondola.motion import Motion
from facade_manipulator.lab.gondola.sensors import EstimatorSettings, SimulatedEstimator
from facade_manipulator.tools.calibration.estimator_fit import EstimatorRecording
from facade_manipulator.tools.calibration.unknowns import head_at

DURATION, DRAIN = 120.0, 1.0  # s, of a recording; after which what was measured last has come
RATE = 50.0  # Hz, of joints and wall
CAMERA_NOISE = (1e-3, 1e-3, 1e-3)  # m, m, rad, of the wall
# standard deviations of a machine's errors: of a link, of half a platform and of the rail's bow;
# of a carriage and of the head on the platform; of rail, slide and head
LENGTH, OFFSET, ANGLE = 5e-4, 1e-3, 3.5e-3  # m, m, rad
NOISE = (1e-4, 1e-4, 3.5e-4)  # m, m, rad, of a measured head


def make_machine(drawing: Geometry, random: np.random.Generator) -> Geometry:
    """Return a machine made after a drawing."""
    def errors(deviation: float, count: int) -> tuple[float, ...]:
        return tuple(random.normal(0.0, deviation, count).tolist())

    return replace(
        drawing, link_errors=errors(LENGTH, 2), platform_errors=errors(LENGTH, 2),
        carriage_offsets=errors(OFFSET, 3), rail_angle=errors(ANGLE, 1)[0],
        tool=(*errors(OFFSET, 2), *errors(ANGLE, 1)), rail_bow=errors(LENGTH, 1)[0],
        slide_angle=errors(ANGLE, 1)[0])


def measure_heads(
    machine: Geometry, carriages: np.ndarray, random: np.random.Generator,
    noise: Sequence[float] = NOISE,
) -> np.ndarray:
    """Measure a machine's head at carriage positions [m], as `calibration.heads` takes them."""
    mechanism = mechanism_of(machine)
    heads = np.array([head_at(mechanism, *row) for row in carriages.tolist()])
    return heads + noise * random.standard_normal(heads.shape)


def wandering(time: float) -> Pose:
    """Return a head that wipes to and fro along the rail."""
    return Pose(0.05 * math.sin(0.7 * time), 0.25, 0.0)


def record_estimator(
    motion: Motion, settings: EstimatorSettings, geometry: Geometry, head: Motion = wandering,
    late: float = 0.0,
) -> EstimatorRecording:
    """Record a gondola that moves and a head, in the rail's frame, that is seen late [s]."""
    estimator, mechanism = SimulatedEstimator(settings, motion, 0.0), mechanism_of(geometry)
    random = np.random.default_rng(settings.seed + 1)
    times = np.arange(0.0, DURATION, 1.0 / RATE).tolist()
    heads = [head(time) for time in times]
    joints = [(time, *mechanism.inverse_kinematics(pose))
              for time, pose in zip(times, heads, strict=True)]
    wall = np.array([(time, *compose(motion(time), pose))
                     for time, pose in zip(times, heads, strict=True)])
    wall[:, 0] += late
    wall[:, 1:] += CAMERA_NOISE * random.standard_normal((len(times), 3))
    published = sorted(estimator.advance(DURATION + DRAIN), key=lambda delivery: delivery.stamp)
    return EstimatorRecording(
        np.array([(delivery.stamp, *delivery.pose) for delivery in published]),
        np.array(joints), wall)

"""Recordings of an estimator that is mounted somewhere and stamps late."""

from __future__ import annotations

import math

import numpy as np

from facade_manipulator.calibration import EstimatorRecording
from facade_manipulator.kinematics import compose, Geometry, mechanism_of, Pose
from facade_manipulator.simulation.estimator import EstimatorSettings, SimulatedEstimator
from facade_manipulator.simulation.motion import Motion

DRAIN = 1.0  # s, after which what was measured last has come


def wandering(time: float) -> Pose:
    """Return a head that wipes to and fro along the rail."""
    return Pose(0.05 * math.sin(0.7 * time), 0.25, 0.0)


def record_estimator(
    motion: Motion, head: Motion, settings: EstimatorSettings, geometry: Geometry,
    duration: float, wall_noise: tuple[float, float, float], rate: float = 50.0,
) -> EstimatorRecording:
    """
    Record a gondola that moves and a head that is measured on the wall.

    The head moves in the rail's frame for a duration [s]. Wall noise is the standard deviations of
    the second measurement [m, m, rad], the rate that of joints and wall [Hz]. Raises a LimitError
    if the machine cannot take a pose of the head.
    """
    estimator, mechanism = SimulatedEstimator(settings, motion, 0.0), mechanism_of(geometry)
    random = np.random.default_rng(settings.seed + 1)
    times = np.arange(0.0, duration, 1.0 / rate).tolist()
    heads = [head(time) for time in times]
    joints = [(time, *mechanism.inverse_kinematics(pose))
              for time, pose in zip(times, heads, strict=True)]
    wall = np.array([(time, *compose(motion(time), pose))
                     for time, pose in zip(times, heads, strict=True)])
    wall[:, 1:] += wall_noise * random.standard_normal((len(times), 3))
    published = sorted(estimator.advance(duration + DRAIN), key=lambda delivery: delivery.stamp)
    return EstimatorRecording(
        np.array([(delivery.stamp, *delivery.pose) for delivery in published]),
        np.array(joints), wall)

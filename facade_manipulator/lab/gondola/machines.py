"""Made-up machines with errors as a shop leaves them, and what is measured and recorded."""

from __future__ import annotations

from dataclasses import replace
import math

import numpy as np

from facade_manipulator.kinematics import compose, Geometry, mechanism_of, Pose
from facade_manipulator.lab.gondola.motion import Motion
from facade_manipulator.lab.gondola.sensors import EstimatorSettings, SimulatedEstimator
from facade_manipulator.parameters import parameter, settings
from facade_manipulator.tools.calibration import EstimatorRecording, head_at

DURATION, DRAIN = 120.0, 1.0  # s, of a recording; after which what was measured last has come
RATE = 50.0  # Hz, of joints and wall
CAMERA_NOISE = (1e-3, 1e-3, 1e-3)  # m, m, rad, of the wall


@settings
class ShopSettings:
    """Standard deviations of a machine's errors and of the measurements of its head."""

    length: float = parameter(
        'Of a link, of half a platform and of the bow of the rail', default=5e-4, unit='m',
        minimum=0.0)
    offset: float = parameter(
        'Of a carriage, and of the head on the platform', default=1e-3, unit='m', minimum=0.0)
    angle: float = parameter(
        'Of the rail, of the slide on it and of the head on the platform', default=3.5e-3,
        unit='rad', minimum=0.0)
    position_noise: float = parameter('Of a measured x or y', default=1e-4, unit='m', minimum=0.0)
    angle_noise: float = parameter('Of a measured theta', default=3.5e-4, unit='rad', minimum=0.0)


def make_machine(
    drawing: Geometry, shop: ShopSettings, random: np.random.Generator
) -> Geometry:
    """Return a machine made after a drawing."""
    def errors(deviation: float, count: int) -> tuple[float, ...]:
        return tuple(random.normal(0.0, deviation, count).tolist())

    return replace(
        drawing, link_errors=errors(shop.length, 2),
        platform_errors=errors(shop.length, 2),
        carriage_offsets=errors(shop.offset, 3), rail_angle=errors(shop.angle, 1)[0],
        tool=(*errors(shop.offset, 2), *errors(shop.angle, 1)),
        rail_bow=errors(shop.length, 1)[0], slide_angle=errors(shop.angle, 1)[0])


def measure_heads(
    machine: Geometry, carriages: np.ndarray, shop: ShopSettings, random: np.random.Generator
) -> np.ndarray:
    """
    Measure a machine's head at carriage positions [m], as `calibration.heads` takes them.

    Returns
    -------
    ndarray, shape (n, 3)
        x, y, θ with noise [m, m, rad].

    Raises
    ------
    LimitError
        If the links do not close at a position.

    """
    mechanism = mechanism_of(machine)
    heads = [head_at(mechanism, *row) for row in carriages.tolist()]
    noise = [shop.position_noise, shop.position_noise, shop.angle_noise]
    return np.array(heads) + noise * random.standard_normal((len(heads), 3))


def wandering(time: float) -> Pose:
    """Return a head that wipes to and fro along the rail."""
    return Pose(0.05 * math.sin(0.7 * time), 0.25, 0.0)


def record_estimator(
    motion: Motion, settings: EstimatorSettings, geometry: Geometry, head: Motion = wandering,
    late: float = 0.0,
) -> EstimatorRecording:
    """
    Record a gondola that moves and a head that is measured on the wall, stamped late [s].

    The head moves in the rail's frame. Raises a LimitError if the machine cannot take a pose of
    the head.
    """
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

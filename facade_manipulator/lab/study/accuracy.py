"""
What the workspace is worth at each distance from the rail: accuracy, stiffness, force, speed.

References
----------
J.-P. Merlet, "Jacobian, manipulability, condition number, and accuracy of parallel robots",
J. Mechanical Design 128(1), 2006.

"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import LimitError
from facade_manipulator.kinematics import (
    carriage_forces,
    Geometry,
    head_stiffness,
    Mechanism,
    mechanism_of,
    Pose,
    Wrench,
)
from facade_manipulator.parameters import parameter, settings

PRESSING = Wrench(0.0, 1.0, 0.0)
STEP = 1e-7  # m: what a difference leaves out is below 1e-4 of it


@settings
class DriveTrain:
    """What carries the head, and how exactly it is made."""

    carriage_error: float = parameter(
        'Standard deviation of a carriage position', default=1e-4, unit='m', minimum=0.0,
        maximum=0.1)
    length_error: float = parameter(
        'Standard deviation of a link and of half the platform', default=1e-4, unit='m',
        minimum=0.0, maximum=0.1)
    screw_stiffness: float = parameter(
        'Axial stiffness of a screw with its bearings', default=2e7, unit='N/m', minimum=1.0,
        maximum=1e12)
    link_stiffness: float = parameter(
        'Axial stiffness of a link with its joints', default=2e7, unit='N/m', minimum=1.0,
        maximum=1e12)
    force: float = parameter(
        'Continuous force of a carriage along the rail', default=59.0, unit='N', minimum=0.1,
        maximum=1e6)
    speed: float = parameter(
        'Speed of a carriage', default=0.5, unit='m/s', minimum=1e-3, maximum=10.0)


class Worth(NamedTuple):
    """
    A pose in numbers.

    Parameters
    ----------
    y, theta : float
        The pose; x does not matter [m, rad].
    errors : tuple of three floats
        Standard deviations of the head's x, y, θ by those of the carriages and lengths
        [m, m, rad].
    stiffness : tuple of three floats
        Of the head along x and y and about z, the other two held [N/m, N/m, N m/rad].
    pressing : float
        Greatest force on the wall that the drives hold for long [N].
    speeds, forces : tuple of (float, float, float)
        Half axes of the ellipses of the head's velocity and force in the plane, without turning
        and without moment, and the angle of the greater to the rail [m/s or N, rad].

    """

    y: float
    theta: float
    errors: tuple[float, float, float]
    stiffness: tuple[float, float, float]
    pressing: float
    speeds: tuple[float, float, float]
    forces: tuple[float, float, float]


def worth(geometry: Geometry, y: float, theta: float, train: DriveTrain) -> Worth:
    """Return what a pose is worth; raises a LimitError if no x has one with this y and θ."""
    pose, mechanism = Pose(0.0, y, theta), mechanism_of(geometry)
    rates = mechanism.jacobian(pose)
    deviations = _amplification(mechanism, pose, np.linalg.inv(rates)) * (
        [train.carriage_error] * 3 + [train.length_error] * 4)
    stiffness = np.diag(head_stiffness(
        mechanism, pose, train.screw_stiffness, train.link_stiffness))
    pressing = train.force / max(map(abs, carriage_forces(mechanism, pose, PRESSING)))
    # Carriages within a ball: what does not turn the head moves it by rates[:, :2], and a force
    # without moment asks rates⁻ᵀ of them.
    return Worth(
        y, theta, tuple(np.sqrt((deviations ** 2).sum(axis=1)).tolist()),
        tuple(stiffness.tolist()), pressing, _ellipse(rates[:, :2], train.speed),
        _ellipse(np.linalg.inv(rates).T[:, :2], train.force))


def _amplification(mechanism: Mechanism, pose: Pose, inverse: np.ndarray) -> np.ndarray:
    """Return how the head moves with q1, q2, q3, l1, l2, b1 and b2, shape (3, 7)."""
    carriages, geometry = mechanism.inverse_kinematics(pose), mechanism.geometry
    l1, l2 = geometry.link_errors
    b1, b2 = geometry.platform_errors
    longer = (
        replace(geometry, link_errors=(l1 + STEP, l2)),
        replace(geometry, link_errors=(l1, l2 + STEP)),
        replace(geometry, platform_errors=(b1 + STEP, b2)),
        replace(geometry, platform_errors=(b1, b2 + STEP)))
    wanted = [np.subtract(mechanism_of(one).inverse_kinematics(pose), carriages) / STEP
              for one in longer]
    return np.hstack([inverse, -inverse @ np.array(wanted).T])


def _ellipse(demand: np.ndarray, limit: float) -> tuple[float, float, float]:
    """Return half axes and angle of what a ball of carriages of a radius allows in the plane."""
    values, vectors = np.linalg.eigh(demand.T @ demand)
    least, most = limit / np.sqrt(values[::-1])
    greater = vectors[:, 0]
    return float(most), float(least), float(np.arctan2(greater[1], greater[0]) % np.pi)


def worth_rows(geometry: Geometry, distances: list[float], train: DriveTrain) -> list[Worth]:
    """Return what the poses at distances, at θ = 0, are worth; none where there are none."""
    rows = []
    for y in distances:
        with suppress(LimitError):
            rows.append(worth(geometry, y, 0.0, train))
    return rows

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

from facade_manipulator import kinematics
from facade_manipulator.errors import LimitError
from facade_manipulator.kinematics import Geometry, Mechanism, Pose, Wrench
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


class Allowed(NamedTuple):
    """
    Velocities or forces in the plane that carriages allow, each within a limit: a polygon.

    All are in m/s or N.
    """

    along_x: float  #: the greatest
    along_y: float
    anywhere: float  #: in whichever direction
    corners: list[tuple[float, float]]  #: counter-clockwise


class Worth(NamedTuple):
    """A pose in numbers; its x does not matter."""

    y: float
    theta: float
    errors: tuple[float, float, float]  #: standard deviations of x, y and θ [m, m, rad]
    #: along x and y and about z, the other two held [N/m, N/m, N m/rad]
    stiffness: tuple[float, float, float]
    pressing: float  #: greatest force on the wall that the drives hold for long [N]
    speeds: Allowed  #: of the head without turning
    forces: Allowed  #: of the head without moment


def worth(geometry: Geometry, y: float, theta: float, train: DriveTrain) -> Worth:
    """Return what a pose is worth; raises a LimitError if no x has one with this y and θ."""
    pose, mechanism = Pose(0.0, y, theta), kinematics.mechanism_of(geometry)
    rates = mechanism.jacobian(pose)
    deviations = _amplification(mechanism, pose, np.linalg.inv(rates)) * (
        [train.carriage_error] * 3 + [train.length_error] * 4)
    stiffness = np.diag(kinematics.head_stiffness(
        mechanism, pose, train.screw_stiffness, train.link_stiffness))
    pressing = train.force / max(map(abs, kinematics.carriage_forces(mechanism, pose, PRESSING)))
    # What does not turn the head moves the carriages by rates[:, :2], and a force without moment
    # asks rates⁻ᵀ of them.
    return Worth(
        y, theta, tuple(np.sqrt((deviations ** 2).sum(axis=1)).tolist()),
        tuple(stiffness.tolist()), pressing, _allowed(rates[:, :2], train.speed),
        _allowed(np.linalg.inv(rates).T[:, :2], train.force))


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
    wanted = [np.subtract(kinematics.mechanism_of(one).inverse_kinematics(pose), carriages) / STEP
              for one in longer]
    return np.hstack([inverse, -inverse @ np.array(wanted).T])


def _allowed(demand: np.ndarray, limit: float) -> Allowed:
    """Return what carriages allow that each can do a limit, where `demand` is asked of them."""
    pairs = demand[[[0, 1], [0, 2], [1, 2]]]  # at a corner two are at their limits
    pairs = pairs[np.abs(np.linalg.det(pairs)) > 1e-9 * np.abs(demand).max() ** 2]
    found = np.concatenate([np.linalg.inv(pairs) @ (limit, other) for other in (limit, -limit)])
    found = found[np.abs(found @ demand.T).max(axis=1) <= (1.0 + 1e-9) * limit]
    corners = np.unique(np.round(np.concatenate([found, -found]), 12), axis=0)
    corners = corners[np.argsort(np.arctan2(corners[:, 1], corners[:, 0]))]
    along_x, along_y = (limit / np.abs(demand).max(axis=0)).tolist()
    anywhere = limit / np.hypot(*demand.T).max()
    return Allowed(along_x, along_y, float(anywhere), [(x, y) for x, y in corners.tolist()])


def worth_rows(geometry: Geometry, distances: list[float], train: DriveTrain) -> list[Worth]:
    """Return what the poses at distances, at θ = 0, are worth; none where there are none."""
    rows = []
    for y in distances:
        with suppress(LimitError):
            rows.append(worth(geometry, y, 0.0, train))
    return rows

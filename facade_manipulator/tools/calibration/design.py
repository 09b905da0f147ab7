"""
Which poses show most: a D-optimal choice over the permitted workspace.

The choice maximises det(T⁻² + Σ JᵀJ/σ²): J the sensitivity of what is measured, σ its noise and T
the tolerance of the drawing, so that it is defined from the first pose on.

References
----------
J.-H. Borm, C.-H. Menq, "Determination of optimal measurement configurations for robot
calibration based on observability measure", Int. J. Robotics Research 10(1), 1991.
J. M. Hollerbach, C. W. Wampler, "The calibration index and taxonomy for robot kinematic
calibration methods", Int. J. Robotics Research 15(6), 1996.

"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import product

import numpy as np

from facade_manipulator.errors import CalibrationError, LimitError, ParameterError
from facade_manipulator.kinematics import Geometry, mechanism_of, Pose
from facade_manipulator.parameters import parameter, settings
from facade_manipulator.tools.calibration.unknowns import sensitivity, Unknown

MARGIN = 0.004  # m, kept from stroke and gap while nobody knows where they really are
LEAST_CONDITIONING = 0.1
EXCHANGES = 20


@settings
class Noise:
    """How well the head is measured."""

    position: float = parameter(
        'Standard deviation of a measured x or y', default=1e-4, unit='m', minimum=1e-7,
        maximum=0.1)
    angle: float = parameter(
        'Standard deviation of a measured theta', default=3.5e-4, unit='rad', minimum=1e-7,
        maximum=0.1)

    @property
    def deviations(self) -> np.ndarray:
        """Return those of x, y and θ, shape (3,)."""
        return np.array([self.position, self.position, self.angle])


def candidates(geometry: Geometry) -> np.ndarray:
    """
    Return carriage positions all over the permitted workspace, shape (n, 3) [m].

    Raises a CalibrationError if there are none.
    """
    least, greatest = geometry.stroke
    try:
        inner = replace(geometry, stroke=(least + MARGIN, greatest - MARGIN),
                        carriage_gap=geometry.carriage_gap + MARGIN)
    except ParameterError as error:
        raise CalibrationError(f'no room for calibration: {error}') from error
    mechanism, found = mechanism_of(inner), []
    reach = geometry.link_length
    for x, y, theta in product(
            np.linspace(least, greatest, 11), np.linspace(0.05, 1.0, 14) * reach,
            np.linspace(-0.3, 0.3, 9)):
        try:
            found.append(mechanism.certify(Pose(x, y, theta), LEAST_CONDITIONING))
        except LimitError:
            continue
    if not found:
        raise CalibrationError('the geometry permits no pose to measure at')
    return np.array(found)


def information(
    geometry: Geometry, unknowns: Sequence[Unknown], carriages: np.ndarray, noise: Noise,
    measured: Sequence[bool] = (True, True, True),
) -> np.ndarray:
    """
    Return J/σ of what is measured, in tolerances of the unknowns, shape (n, k, m).

    With every unknown in units of its tolerance, the drawing's own information is the identity.
    """
    rates = sensitivity(geometry, unknowns, carriages) / noise.deviations[:, None]
    return rates[:, list(measured), :] * np.array([u.tolerance for u in unknowns])


def choose(rows: np.ndarray, count: int) -> list[int]:
    """Choose rows of `information`, all different, greedily and then by exchange (Fedorov)."""
    chosen: list[int] = []
    for _ in range(min(count, len(rows))):
        chosen.append(_best(rows, chosen))
    for _ in range(EXCHANGES):
        before = sorted(chosen)
        for old in list(chosen):
            chosen.remove(old)
            chosen.append(_best(rows, chosen))
        if sorted(chosen) == before:
            break
    return chosen


def _best(rows: np.ndarray, chosen: list[int]) -> int:
    """Return the row that raises the determinant most: det(I + R C Rᵀ)."""
    known = np.vstack([np.eye(rows.shape[2]), *rows[chosen]])
    gains = np.eye(rows.shape[1]) + rows @ np.linalg.inv(known.T @ known) @ rows.transpose(0, 2, 1)
    growth = np.linalg.slogdet(gains)[1]
    growth[chosen] = -np.inf
    return int(np.argmax(growth))


def plan(
    geometry: Geometry, unknowns: Sequence[Unknown], count: int, noise: Noise | None = None,
    measured: Sequence[bool] = (True, True, True),
) -> np.ndarray:
    """
    Choose carriage positions to measure at, shape (count, 3) [m].

    Those that show most come first: who stops early knows as much as he can by then. Where
    backlash is looked for, a fourth column has the direction to arrive in, as `heads` takes it.
    Raises a ParameterError if none are wanted, a CalibrationError if too few are permitted.
    """
    if count < 1:
        raise ParameterError(f'{count} poses cannot be planned: at least 1')
    permitted = candidates(geometry)
    if any(unknown.field == 'backlash' for unknown in unknowns):
        permitted = np.vstack([np.column_stack([
            permitted, np.full(len(permitted), direction)]) for direction in (1.0, -1.0)])
    if count > len(permitted):
        raise CalibrationError(f'{count} poses are wanted, {len(permitted)} are permitted')
    rows = information(geometry, unknowns, permitted, noise or Noise(), measured)
    chosen = np.array(choose(rows, count))
    return permitted[chosen[_telling(rows[chosen])]]


def _telling(rows: np.ndarray) -> list[int]:
    """Return all rows of `information`, each the one that adds most to those before."""
    order: list[int] = []
    while len(order) < len(rows):
        order.append(_best(rows, order))
    return order


def covariance_of(rows: np.ndarray, scatter: float = 1.0) -> np.ndarray:
    """
    Return the covariance of unknowns, in their tolerances, by rows of `information`, shape (k, m).

    Rows scatter by so many times their noise; less than once is luck.
    """
    return np.linalg.inv(rows.T @ rows / max(1.0, scatter) ** 2 + np.eye(rows.shape[1]))


def spread(geometry: Geometry, unknowns: Sequence[Unknown], covariance: np.ndarray,
           carriages: np.ndarray) -> np.ndarray:
    """Return the standard deviation of the head's x, y and θ that is left, shape (n, 3)."""
    rates = sensitivity(geometry, unknowns, carriages)
    return np.sqrt(np.einsum('nim,mk,nik->ni', rates, covariance, rates))


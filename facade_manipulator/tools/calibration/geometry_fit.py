"""
Fit of the machine's geometric errors to measured poses of its head.

The drawing counts as one more measurement of each error, with the drawing's tolerance as standard
deviation. The fit is therefore defined for any number of poses. A combination of errors that the
poses do not determine keeps the value of the drawing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import product
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import CalibrationError, LimitError, ParameterError
from facade_manipulator.kinematics import (
    Carriages,
    compose,
    Geometry,
    invert,
    Mechanism,
    Pose,
    ZERO_POSE,
)
from facade_manipulator.tools.calibration import robust

HEAD_AXES = ('x', 'y', 'theta')  # of the head
# units of the report, with their factor from SI
IN_MM = ('mm', 1e3)
IN_DEG = ('deg', 180.0 / np.pi)
HEAD_UNITS = IN_MM, IN_MM, IN_DEG  # of the head


# Description of each error, its manufacturing standard deviation [m, rad], unit of the report.
GEOMETRY_ERRORS = (
    ('length of link 1', 2e-3, IN_MM),
    ('length of link 2', 2e-3, IN_MM),
    ('platform from B1 to P', 2e-3, IN_MM),
    ('platform from P to B2', 2e-3, IN_MM),
    ('offset of carriage q1', 5e-3, IN_MM),
    ('offset of carriage q2', 5e-3, IN_MM),
    ('offset of carriage q3', 5e-3, IN_MM),
    ('angle of the rail', 0.02, IN_DEG),
    ('x of the head on the platform', 5e-3, IN_MM),
    ('y of the head on the platform', 5e-3, IN_MM),
    ('angle of the head on the platform', 0.02, IN_DEG),
    ("x of the rail in the instrument's frame", 1.0, IN_MM),
    ("y of the rail in the instrument's frame", 1.0, IN_MM),
    ("angle of the rail in the instrument's frame", 1.0, IN_DEG),
)
# The frame of the instrument replaces the two errors that move all heads in the same way.
IN_ANY_FRAME = [0, 1, 2, 3, 4, 5, 8, 9, 10, 11, 12, 13]
FIELDS = 'link_errors', 'platform_errors', 'carriage_offsets', 'rail_angle', 'tool'


class Measurements(NamedTuple):
    """Head poses measured at given carriage positions."""

    carriages: np.ndarray  #: as the drives count them, shape (n, 3) [m]
    heads: np.ndarray  #: shape (n, 3) [m, m, rad]; NaN where not measured

    def at(self, rows: np.ndarray) -> Measurements:
        """Return the measurements in the given rows."""
        return Measurements(self.carriages[rows], self.heads[rows])


class GeometryFit(NamedTuple):
    """Result of a calibration: the calibrated machine and the quality of the fit."""

    geometry: Geometry
    frame: Pose  #: pose of the rail in the instrument's frame [m, m, rad]
    sought: list[int]  #: indices in `GEOMETRY_ERRORS` of the fitted errors
    values: np.ndarray  #: values of these errors [m, rad]
    deviations: np.ndarray  #: their standard deviations [m, rad]
    residuals: np.ndarray  #: measured minus expected heads, shape (n, 3) [m, m, rad]
    #: whether a row contradicts the others and is left out, shape (n,)
    outliers: np.ndarray
    scatter: float  #: residuals over the stated noise; 1 where both agree
    unidentified: list[str]  #: combinations of errors that the poses do not determine
    head_deviation: np.ndarray  #: maximum in the workspace, shape (3,) [m, m, rad]


def machine(geometry: Geometry, values: np.ndarray) -> tuple[Geometry, Pose]:
    """Return a geometry with values of `GEOMETRY_ERRORS`, and the rail in the instrument frame."""
    link1, link2, half1, half2, q1, q2, q3, angle, *poses = values.tolist()
    changed = replace(
        geometry,
        link_errors=(link1, link2),
        platform_errors=(half1, half2),
        carriage_offsets=(q1, q2, q3),
        rail_angle=angle,
        tool=tuple(poses[:3]),
    )
    return changed, Pose(*poses[3:])


def head_poses(
    geometry: Geometry, carriages: np.ndarray, frame: Pose = ZERO_POSE
) -> np.ndarray:
    """
    Return head poses, shape (n, 3) [m, m, rad]; NaN if the kinematics has no solution.

    Parameters
    ----------
    geometry : Geometry
        With offsets of the carriages and the tool.
    carriages : array of shape (n, 3)
        Positions as the drives count them [m]. Stroke and gap are not checked.
    frame : Pose
        Pose of the rail in the frame of the returned poses [m, m, rad].

    Raises
    ------
    ParameterError
        If a position is not finite.

    """
    mechanism = Mechanism(geometry)
    heads = np.full((len(carriages), 3), np.nan)
    for row, positions in enumerate(carriages.tolist()):
        try:
            head = mechanism.forward_kinematics(Carriages(*positions))
        except LimitError:
            continue
        heads[row] = compose(frame, head)
    return heads


def head_differences(heads: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return pose differences with θ in [−π, π), shape (n, 3) [m, m, rad]."""
    differences = heads - others
    differences[:, 2] = (differences[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
    return differences


# share of its tolerance; an error measured less precisely adds little to the drawing
NEEDED_SHARE = 0.5
MOST_HEAD_DEVIATION = 5.0  # times the stated noise, anywhere in the workspace
TOLERANCES = np.array([tolerance for _, tolerance, _ in GEOMETRY_ERRORS])
IN_RAIL = list(range(11))


def fit_geometry(
    drawing: Geometry,
    measurements: Measurements,
    noise: np.ndarray,
    has_frame: bool = False,
) -> GeometryFit:
    """
    Fit the errors of a machine to measured poses; return the result.

    Parameters
    ----------
    drawing : Geometry
        The drawing, or an earlier calibration.
    measurements : Measurements
    noise : ndarray, shape (3,)
        Standard deviations of a measured x, y and θ [m, m, rad].
    has_frame : bool
        Whether the instrument has a frame other than `rail`.

    Raises
    ------
    CalibrationError
        If the links do not close at a row, or the rows are too few, contradict each other, or do
        not show the head's pose.

    """
    carriages, heads = measurements
    sought = IN_ANY_FRAME if has_frame else IN_RAIL
    frame = _first_frame(drawing, measurements) if has_frame else ZERO_POSE
    drawn = np.hstack([*(getattr(drawing, name) for name in FIELDS), frame])

    def values(scaled: np.ndarray) -> np.ndarray:
        """Convert fitted errors in units of their tolerances to all errors [m, rad]."""
        changed = drawn.copy()
        changed[sought] += TOLERANCES[sought] * scaled
        return changed

    def expected(scaled: np.ndarray, carriages: np.ndarray) -> np.ndarray:
        """Return head poses in the instrument's frame, shape (n, 3) [m, m, rad]."""
        try:
            geometry, seen_from = machine(drawing, values(scaled))
        except ParameterError:  # a step beyond the permitted range of a parameter
            return np.full((len(carriages), 3), np.nan)
        return head_poses(geometry, carriages, seen_from)

    def misses(scaled: np.ndarray) -> np.ndarray:
        """Return measured minus expected head poses in standard deviations, shape (n, 3)."""
        return head_differences(heads, expected(scaled, carriages)) / noise

    scaled, jacobian, used = _fit_rows(misses, np.isfinite(heads), len(sought))
    remain = misses(scaled)
    scatter = np.sqrt((remain[used] ** 2).sum() / max(1, used.sum() - len(sought)))

    # The rates J of the residuals and the drawing give the covariance (Jᵀ J + I)⁻¹.
    rates = jacobian[: -len(sought)] / max(1.0, scatter)
    covariance = np.linalg.inv(rates.T @ rates + np.eye(len(sought)))
    in_workspace = partial(expected, carriages=permitted_carriages(drawing))
    head_deviation = _greatest_deviation(in_workspace, scaled, covariance)
    names = [GEOMETRY_ERRORS[k][0] for k in sought]
    blind = robust.unidentified(rates, np.full(len(names), NEEDED_SHARE), names)
    if (head_deviation > MOST_HEAD_DEVIATION * noise)[used.any(axis=0)].any():
        raise CalibrationError(
            'table rejected: somewhere in the workspace the head is known only to '
            f'{in_units(head_deviation)}; the poses do not determine {"; ".join(blind)}; next: '
            'measure the poses that calibrate poses prints, or set --noise to the real noise'
        )

    found = values(scaled)
    geometry, frame = machine(drawing, found)
    return GeometryFit(
        geometry=geometry,
        frame=frame,
        sought=sought,
        values=found[sought],
        deviations=np.sqrt(np.diag(covariance)) * TOLERANCES[sought],
        residuals=remain * noise,
        outliers=np.isfinite(heads).any(axis=1) & ~used.any(axis=1),
        scatter=scatter,
        unidentified=blind,
        head_deviation=head_deviation,
    )


# m and rad: differences of heads that are equally large for the choice of the first frame
START_UNITS = np.array([5e-3, 5e-3, 0.02])


def _first_frame(drawing: Geometry, measurements: Measurements) -> Pose:
    """
    Return the approximate rail pose in the instrument's frame, even if some rows are wrong.

    Each complete row gives one pose of the rail. The best of them has the smallest median of the
    differences between measured and expected heads.
    """
    drawn = head_poses(drawing, measurements.carriages)
    complete = np.isfinite(measurements.heads + drawn).all(axis=1)
    if not complete.any():
        return ZERO_POSE

    seen = measurements.heads[complete]
    drawn = drawn[complete]
    frames = []
    misses = []
    for measured, expected in zip(seen.tolist(), drawn.tolist(), strict=True):
        frame = compose(Pose(*measured), invert(Pose(*expected)))
        placed = np.column_stack(compose(frame, Pose(*drawn.T)))
        differences = np.abs(head_differences(seen, placed)) / START_UNITS
        frames.append(frame)
        misses.append(np.median(differences.sum(axis=1)))
    return frames[int(np.argmin(misses))]


DIFFERENCE_STEP = 1e-4  # of a tolerance, for differences


def _greatest_deviation(
    expected: Callable[[np.ndarray], np.ndarray],
    scaled: np.ndarray,
    covariance: np.ndarray,
) -> np.ndarray:
    """Return the maximum standard deviation of the expected head poses, shape (3,) [m, m, rad]."""
    differences = []
    for step in DIFFERENCE_STEP * np.eye(len(scaled)):
        ahead = expected(scaled + step)
        behind = expected(scaled - step)
        differences.append(head_differences(ahead, behind))

    # The rates J of a head give its variances, the diagonal of J C Jᵀ.
    rates = np.array(differences) / (2.0 * DIFFERENCE_STEP)
    variances = np.einsum('mni,mk,kni->ni', rates, covariance, rates)
    return np.sqrt(np.nanmax(variances, axis=0))


# maximum share of contradicting rows; a larger share means another machine, unit or frame
MOST_OUTLIERS = 0.25
MOST_SCATTER = 5.0  # times the stated noise


def _fit_rows(
    misses: Callable[[np.ndarray], np.ndarray], measured: np.ndarray, count: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return errors in units of tolerances, Jacobian of the residuals, and mask of used values."""
    used = measured

    def residuals(scaled: np.ndarray) -> np.ndarray:
        """Return the residuals of the used values and the differences from the drawing."""
        return np.append(misses(scaled)[used], scaled)

    if measured.sum() <= count:
        raise CalibrationError(
            f'table rejected: {measured.sum()} measured values, more than {count} are '
            f'needed to fit {count} errors of the machine; next: measure more poses'
        )

    scaled, jacobian = robust.fit(residuals, np.zeros(count), 'soft_l1')
    for _ in range(3):  # a wrong row no longer shifts the others after it is left out
        remain = np.nan_to_num(misses(scaled), nan=robust.FAR_RESIDUAL) * measured
        scatter = robust.deviation(remain[measured]).clip(1.0, MOST_SCATTER)
        outliers = (np.abs(remain) > robust.OUTLIER_RESIDUAL * scatter).any(axis=1)
        if outliers.sum() > MOST_OUTLIERS * len(outliers):
            raise CalibrationError(
                f'table rejected: {outliers.sum()} of {len(outliers)} rows contradict the others; '
                'next: check units and order of the columns, homing, --frame and --noise'
            )
        used = measured & ~outliers[:, None]
        scaled, jacobian = robust.fit(residuals, scaled, 'linear')
    return scaled, jacobian, used


def in_units(pose: np.ndarray) -> str:
    """Format the finite values of a pose in mm and degrees."""
    finite = []
    for axis, value, (unit, factor) in zip(HEAD_AXES, pose, HEAD_UNITS, strict=True):
        if np.isfinite(value):
            finite.append(f'{axis} {value * factor:.3f} {unit}')
    return ', '.join(finite) if finite else 'the links do not close'


HELD_OUT_EVERY = 4  # rows


def held_out_errors(
    drawing: Geometry, measurements: Measurements, noise: np.ndarray, found: GeometryFit
) -> tuple[np.ndarray, np.ndarray]:
    """
    Return the head's RMS errors before and after a fit, at rows that are not used in this fit.

    Every fourth row is left out. Each array has the shape (3,) [m, m, rad]. Raises a
    CalibrationError if the other rows are not enough for a fit.
    """
    rows = np.flatnonzero(np.isfinite(measurements.heads).any(axis=1) & ~found.outliers)
    held = np.arange(len(rows)) % HELD_OUT_EVERY == HELD_OUT_EVERY - 1
    kept = measurements.at(rows[~held])
    left_out = measurements.at(rows[held])
    fitted = fit_geometry(drawing, kept, noise, found.sought is IN_ANY_FRAME)

    def rms(geometry: Geometry) -> np.ndarray:
        expected = head_poses(geometry, left_out.carriages, fitted.frame)
        off = np.ma.masked_invalid(head_differences(left_out.heads, expected))
        return np.ma.sqrt((off**2).mean(axis=0)).filled(np.nan)

    return rms(drawing), rms(fitted.geometry)


# m, distance from stroke and gap, whose true values are unknown before calibration
MEASUREMENT_MARGIN = 0.004
MIN_POSE_CONDITIONING = 0.1  # of the poses to measure at


def permitted_carriages(geometry: Geometry) -> np.ndarray:
    """Return a grid of carriage positions in the permitted workspace, shape (n, 3) [m]."""
    least, greatest = geometry.stroke
    stroke = (least + MEASUREMENT_MARGIN, greatest - MEASUREMENT_MARGIN)
    gap = geometry.carriage_gap + MEASUREMENT_MARGIN
    inner = Mechanism(replace(geometry, stroke=stroke, carriage_gap=gap))

    found = []
    xs = np.linspace(least, greatest, 11)
    ys = np.linspace(0.05, 1.0, 14) * geometry.link_length
    for pose in product(xs, ys, np.linspace(-0.3, 0.3, 9)):
        try:
            found.append(inner.certify(Pose(*pose), MIN_POSE_CONDITIONING))
        except LimitError:
            continue
    return np.array(found)


def spread_carriages(geometry: Geometry, count: int) -> np.ndarray:
    """
    Return evenly spread carriage positions in the permitted workspace, shape (count, 3) [m].

    Each position is the farthest in actuator space from the positions already chosen.
    """
    carriages = permitted_carriages(geometry)
    chosen = [int(np.argmax(np.ptp(carriages, axis=1)))]
    distances = np.full(len(carriages), np.inf)
    while len(chosen) < count:
        from_last = ((carriages - carriages[chosen[-1]]) ** 2).sum(axis=1)
        distances = np.minimum(distances, from_last)
        chosen.append(int(np.argmax(distances)))
    return carriages[chosen]

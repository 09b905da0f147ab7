"""
Fit of an estimator's mounting and delay to a recording.

A second instrument measures the pose of the head on the wall. The carriages give the pose of the
head on the rail. The published disturbance relates the two poses. The fit also finds the pose of
the instrument's frame, its slow drift and the delay of its stamps.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from facade_manipulator.errors import CalibrationError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.prediction.estimate import EstimateSettings
from facade_manipulator.tools.calibration import robust
from facade_manipulator.tools.calibration.geometry_fit import head_poses, in_units

SOUGHT = 'x of the mounting', 'y of the mounting', 'yaw of the mounting', 'delay'
LONGEST_DELAY = 0.5  # s


class EstimatorRecording(NamedTuple):
    """Recorded series, each of shape (n, 4) with the stamp [s] in the first column."""

    disturbance: np.ndarray  #: as published: x, y, θ [m, m, rad]
    joints: np.ndarray  #: positions of the carriages [m]
    wall: np.ndarray  #: head on the wall: x, y, θ [m, m, rad]


class EstimatorFit(NamedTuple):
    """Fitted mounting and delay of an estimator."""

    settings: EstimateSettings
    deviations: np.ndarray  #: of x, y, yaw and delay [m, m, rad, s], shape (4,)
    late: float  #: delay of the instrument's stamps [s]
    residual: np.ndarray  #: standard deviation on the wall without outliers, shape (3,)


# Required standard deviations [m, m, rad, s]: at 1° of yaw 0.02 m of lever arm are 0.35 mm.
NEEDED_DEVIATIONS = np.array([0.02, 0.02, 0.005, 0.01])
# The next parameters: delay of the instrument; pose, drift and bend of its frame.
SCALES = np.append(NEEDED_DEVIATIONS, np.full(10, 0.01))
# places of the parameters
DELAY = 3
LATE = 4
FRAME = 5
MOST_LEFT = 0.5  # of the motion's standard deviation
SMALL = 0.01  # m, rad; smaller residuals are not a contradiction


def fit_estimator(
    geometry: Geometry, recording: EstimatorRecording, present: EstimateSettings
) -> EstimatorFit:
    """
    Return mounting and delay of an estimator on a machine with calibrated geometry.

    `present` contains the angle of the estimator's axes and all other settings. Raises a
    CalibrationError if the recording is too short, contradicts itself or does not show mounting
    and delay.
    """
    from scipy.interpolate import CubicSpline

    disturbance, joints, wall = _in_common(recording)
    heads = head_poses(geometry, joints[:, 1:])
    impossible = joints[np.isnan(heads).any(axis=1), 0]
    if len(impossible):
        raise CalibrationError(
            f'joints rejected: the links do not close {impossible[0]:.2f} s after the first '
            'disturbance; next: check geometry and unit of the carriages'
        )

    published = _smoothed(disturbance)
    head = CubicSpline(joints[:, 0], heads)
    times = wall[:, 0]
    measured = wall[:, 1:]
    drift = np.vander(np.linspace(-1.0, 1.0, len(times)), 3, increasing=True)

    def misses(scaled: np.ndarray) -> np.ndarray:
        """Return measured minus expected head poses on the wall [m, m, rad], shape (n, 3)."""
        values = scaled * SCALES
        delay, late = np.clip(values[[DELAY, LATE]], -LONGEST_DELAY, LONGEST_DELAY)
        disturbances = published(times - late + delay)
        frames = drift @ values[FRAME:].reshape(3, 3).T
        return measured - expected_heads(
            values[:DELAY], present.axes, disturbances, head(times - late), frames
        )

    def weighed(scaled: np.ndarray) -> np.ndarray:
        return (misses(scaled) / noise).ravel()

    scaled = np.append([*present.mounting, present.delay], np.zeros(10)) / SCALES
    # x and y of the instrument's frame
    scaled[[FRAME, FRAME + 3]] = np.median(misses(scaled), axis=0)[:2] / SCALES[FRAME]
    noise = np.full(3, SMALL)
    # first with guessed weights, then with weights from the residuals
    for _ in range(4):
        scaled, jacobian = robust.fit(weighed, scaled, 'soft_l1')
        noise = np.maximum(robust.deviation(misses(scaled)), 1e-9)

    motion = published(times).std(axis=0)
    if (noise > np.maximum(SMALL, MOST_LEFT * motion)).any():
        raise CalibrationError(
            f'recording rejected: {in_units(noise)} remain of a motion of {in_units(motion)}; '
            'next: check the clocks of both computers, and unit, sign and order of the axes of '
            'estimator and instrument'
        )

    # J − Q Qᵀ J is the part of the rates J that the other parameters do not explain. A number of
    # correlated samples counts as one.
    basis, _ = np.linalg.qr(jacobian[:, LATE:])
    rates = jacobian[:, :LATE] - basis @ (basis.T @ jacobian[:, :LATE])
    inliers = np.clip(
        misses(scaled) / noise, -robust.INLIER_RESIDUAL, robust.INLIER_RESIDUAL
    )
    rates /= np.sqrt(max(map(correlated_samples, inliers.T)))
    if blind := robust.unidentified(rates, np.ones(LATE), SOUGHT):
        raise CalibrationError(
            f'recording rejected: it does not determine {"; ".join(blind)}; next: record longer, '
            'let the gondola turn for the mounting, and the head move on the rail for the delay'
        )

    found = (scaled * SCALES).tolist()
    settings = replace(present, mounting=tuple(found[:DELAY]), delay=found[DELAY])
    deviations = np.sqrt(np.diag(np.linalg.inv(rates.T @ rates))) * NEEDED_DEVIATIONS
    return EstimatorFit(settings, deviations, found[LATE], noise)


def expected_heads(
    mounting: np.ndarray,
    axes: float,
    published: np.ndarray,
    heads: np.ndarray,
    frames: np.ndarray,
) -> np.ndarray:
    """
    Return the expected head poses in the instrument's frame, shape (n, 3) [m, m, rad].

    Parameters
    ----------
    mounting : ndarray, shape (3,)
        Pose of the estimator on the rail.
    axes : float
        Angle from the axes of `facade` to those of the estimator [rad].
    published, heads, frames : ndarray, shape (n, 3)
        Published disturbances, heads on the rail, and poses of `facade` in the instrument's frame.

    """
    place = mounting[0] + 1j * mounting[1]
    yaw = published[:, 2] - mounting[2]

    # With p published, m the place of the estimator and h the head, as x + i y:
    # on the facade  e^(i axes) p + m + e^(i yaw) (h − m), then moved into the instrument's frame
    lever = _complex(heads) - place
    estimator = _complex(published) * np.exp(1j * axes) + place
    on_facade = estimator + np.exp(1j * yaw) * lever
    seen = _complex(frames) + np.exp(1j * frames[:, 2]) * on_facade
    theta = yaw + frames[:, 2] + heads[:, 2]
    return np.column_stack([seen.real, seen.imag, theta])


def _complex(poses: np.ndarray) -> np.ndarray:
    """Return the positions of poses as complex numbers x + i y [m]."""
    return poses[:, 0] + 1j * poses[:, 1]


MIN_OVERLAP = 20.0  # s
MOST_SAMPLES = 3000


def _in_common(recording: EstimatorRecording) -> EstimatorRecording:
    """Return the time span common to all series; stamps count from its first disturbance [s]."""
    # seconds since 1970 leave too few digits for a delay
    start = recording.disturbance[0, 0]
    series = [table - [start, 0.0, 0.0, 0.0] for table in recording]
    begin = max(table[0, 0] for table in series) + 2 * LONGEST_DELAY
    end = min(table[-1, 0] for table in series) - 2 * LONGEST_DELAY
    if end - begin < MIN_OVERLAP:
        raise CalibrationError(
            f'recording rejected: its series share {end - begin:.1f} s, below {MIN_OVERLAP:g} s; '
            'next: record longer, with synchronised clocks'
        )

    disturbance, joints, wall = series
    wall = wall[(begin <= wall[:, 0]) & (wall[:, 0] <= end)]
    every = max(1, len(wall) // MOST_SAMPLES)
    return EstimatorRecording(disturbance, joints, wall[::every])


CUTOFF = 3.0  # Hz, well above the sway of a gondola


def _smoothed(disturbance: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    """
    Return the published disturbance, low-pass filtered at 3 Hz, as a function of its stamps.

    Remaining noise of the yaw would count as motion and shorten the lever arm.
    """
    from scipy.interpolate import CubicSpline
    from scipy.signal import butter, sosfiltfilt

    stamps = disturbance[:, 0]
    step = float(np.median(np.diff(stamps)))
    even = np.arange(stamps[0], stamps[-1], step)
    axes = [np.interp(even, stamps, column) for column in disturbance.T[1:]]
    low_pass = butter(4, CUTOFF, fs=max(1.0 / step, 4.0 * CUTOFF), output='sos')
    smoothed = sosfiltfilt(low_pass, np.column_stack(axes), axis=0)
    return CubicSpline(even, smoothed)


def correlated_samples(series: np.ndarray) -> float:
    """Return the number of samples per independent sample: 1 + 2 Σ ρ up to the first zero of ρ."""
    spectrum = np.abs(np.fft.rfft(series - series.mean(), 2 * len(series))) ** 2
    rho = np.fft.irfft(spectrum)[: len(series)]
    rho /= max(rho[0], 1e-300)
    last = int(np.argmax(rho <= 0.0)) or len(rho)
    return float(1.0 + 2.0 * rho[1:last].sum())

"""
Signal of gusts with a known spectrum, and the minimum error of any prediction of it.

Gusts with Kaimal's spectrum along and across a mean wind of 4 m/s, 40 m above suburbs, push a
gondola of 500 kg on 30 m of cable: each axis is a sum of damped resonances. The motion is
Gaussian, and its law is exactly the one that the bound uses.

The bound is the standard deviation of the disturbance given all estimates of the last 10 s: the
error of the Wiener filter, which a Kalman filter with the true model reaches in steady state. No
prediction from the same estimates has a smaller mean square error. 80 s instead of 10 s lower the
bound by less than 0.4 %.

J. C. Kaimal et al., "Spectral characteristics of surface-layer turbulence", Quarterly Journal of
the Royal Meteorological Society 98 (1972) 563-589. N. Wiener, "Extrapolation, Interpolation, and
Smoothing of Stationary Time Series", MIT Press 1949.
"""

import numpy as np

STEP = 5e-4  # Hz, between the tones: the signal repeats after 2000 s
FREQUENCIES = STEP * np.arange(8, 10_000)  # 0.004 to 5 Hz
HEIGHT = 40.0  # m
SPEED = 4.0  # m/s
FRICTION_SPEED = 0.327  # m/s
KAIMAL = (105.0, 33.0), (17.0, 9.5)  # along and across the mean wind
DAMPING = 0.02
# of x, y and yaw: rad/s, and the acceleration by a gust of 1 m/s along and across the mean wind
RESONANCES = (
    ((0.563, 20.2e-3, -5.52e-3),),
    ((1.153, 10.96e-3, 10.04e-3), (5.306, 81.1e-6, 74.2e-6)),
    ((0.490, 3.38e-3, 3.09e-3),),
)
WINDOW = 10.0  # s


def power() -> np.ndarray:
    """Return the power of each axis at each frequency, shape (3, n) [m², m², rad²]."""
    reduced = FREQUENCIES * HEIGHT / SPEED
    scale = FRICTION_SPEED**2 / FREQUENCIES
    winds = [scale * a * reduced / (1.0 + b * reduced) ** (5 / 3) for a, b in KAIMAL]
    s = 2j * np.pi * FREQUENCIES
    powers = []
    for resonances in RESONANCES:
        responses = np.zeros((2, len(FREQUENCIES)), complex)
        for rate, *gains in resonances:
            resonance = 1.0 / (rate**2 + 2.0 * DAMPING * rate * s + s**2)
            responses += np.outer(gains, resonance)
        densities = np.abs(responses) ** 2 * winds
        powers.append(STEP * densities.sum(axis=0))
    return np.array(powers)


def gusts(seed: int, interval: float) -> np.ndarray:
    """Return x, y and yaw [m, m, rad] sampled at an interval [s] that divides 2000 s, (n, 3)."""
    random = np.random.default_rng(seed)
    real, imaginary = random.standard_normal((2, 3, len(FREQUENCIES)))
    size = round(1.0 / (STEP * interval))
    spectrum = np.zeros((3, size // 2 + 1), complex)
    amplitudes = 0.5 * size * np.sqrt(power())
    spectrum[:, 8:10_000] = amplitudes * (real + 1j * imaginary)
    return np.fft.irfft(spectrum, size).T


def bound(interval: float, noise: float, ahead: float) -> np.ndarray:
    """
    Return the minimum standard deviation of a prediction's error, shape (3,) [m, m, rad].

    Estimates come at an interval [s] with white noise of a standard deviation; the prediction is
    for a time [s] after the last one.
    """
    ages = np.arange(round(WINDOW / interval))
    lags = np.concatenate([interval * ages, ahead + interval * ages])
    angles = 2.0 * np.pi * np.outer(FREQUENCIES, lags)
    covariances = power() @ np.cos(angles)
    at_once, later = np.split(covariances, 2, axis=1)
    distances = np.abs(np.subtract.outer(ages, ages))
    estimates = at_once[:, distances] + noise**2 * np.eye(len(ages))
    weights = np.linalg.solve(estimates, later[..., None])[..., 0]
    explained = (later * weights).sum(axis=1)
    return np.sqrt(at_once[:, 0] - explained)

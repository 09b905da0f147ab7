"""
Whether the force is as late as its stamps say: it must answer in time to what the head does.

A sensor that is late but stamps its measurements as fresh looks sound. So a small sine is added to
the desired force, a watermark [1]: the wall's motion does not correlate with it, hence in the mean
its traces in force and offset have the ratio k exp(−jωd), whatever the loop does, with the
stiffness k and the latency d that is not in the stamps. Trace and scatter come from a fit to each
period; only what the scatter cannot explain counts as latency.

References
----------
[1] Y. Mo, B. Sinopoli, "Secure control against replay attacks", 47th Allerton Conference (2009).
"""

from __future__ import annotations

import cmath
from collections import deque
import math

import numpy as np

FREQUENCY = 2.4  # Hz, above what the prediction leaves of the sway
RATE = math.tau * FREQUENCY
LEAST_AMPLITUDE = 0.3  # N
AMPLITUDE, MOST_AMPLITUDE = 1.0, 0.03  # of the scatter of the force's trace; of the desired force
PERIODS = (8, 20, 60, 120)  # that means are of: the sooner, the clearer the traces
LEAST_SAMPLES = 8  # in a period
MOST_LATENCY = 0.08  # s
CERTAINTY = 3.0  # standard deviations


class LatencyCheck:
    """
    Find a latency that is not in the stamps.

    Attributes
    ----------
    latency : float
        What it is at least [s], less what the scatter can explain.

    """

    def __init__(self) -> None:
        self._traces: deque[tuple[complex, complex]] = deque(maxlen=max(PERIODS))
        self.begin()

    def begin(self) -> None:
        """Forget everything: the contact is another one."""
        self.latency, self._amplitude = 0.0, LEAST_AMPLITUDE
        self._samples: list[tuple[float, float, float]] = []
        self._traces.clear()

    def modulation(self, time: float, desired: float) -> tuple[float, float]:
        """Return what is added to a desired force [N] at a time [s], and its rate [N/s]."""
        amplitude = max(min(self._amplitude, MOST_AMPLITUDE * desired), LEAST_AMPLITUDE)
        return amplitude * math.sin(RATE * time), amplitude * RATE * math.cos(RATE * time)

    def add(self, stamp: float, force: float, offset: float) -> None:
        """Note a force [N] measured at a stamp [s] with an offset [m]."""
        if self._samples and stamp - self._samples[0][0] >= 1.0 / FREQUENCY:
            if len(self._samples) >= LEAST_SAMPLES:
                self._traces.append(_traces(np.array(self._samples)))
                self._evaluate(np.array(self._traces))
            self._samples.clear()
        self._samples.append((stamp, force, offset))

    def _evaluate(self, traces: np.ndarray) -> None:
        count = len(traces)
        self.latency = max(
            (_latency(*_mean(traces[-most:])) for most in PERIODS if most <= count), default=0.0)
        if count >= min(PERIODS):
            scatter = math.sqrt(count) * _mean(traces)[1]
            self._amplitude = AMPLITUDE * scatter


def _mean(traces: np.ndarray) -> tuple[np.ndarray, float]:
    """Return the mean traces of force and offset, and the force's standard error beside them."""
    count, mean = len(traces), traces.mean(axis=0)
    beside = traces[:, 0] - mean[0] / mean[1] * traces[:, 1]
    return mean, float(np.linalg.norm(beside)) / math.sqrt(count * (count - 1))


def _latency(mean: np.ndarray, error: float) -> float:
    """Return the least latency that mean traces leave possible."""
    share = CERTAINTY * error / abs(mean[0])
    if share >= 1.0:
        return 0.0
    return max(abs(cmath.phase(mean[0] / mean[1])) - math.asin(share), 0.0) / RATE


def _traces(samples: np.ndarray) -> tuple[complex, complex]:
    """Return the complex amplitudes of force and offset, without their mean and slope."""
    times = samples[:, 0]
    waves = np.column_stack([
        np.cos(RATE * times), np.sin(RATE * times), np.ones(len(times)), times - times[0]])
    (cosines, sines, *_), *_ = np.linalg.lstsq(waves, samples[:, 1:], rcond=None)
    return tuple(cosines - 1j * sines)

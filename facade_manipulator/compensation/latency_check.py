"""
Whether the force is as late as its stamps say: it must answer in time to what the head does.

A sensor that is late but stamps its measurements as fresh looks sound. So two small sines are
added to the desired force, a watermark [1]: the wall's motion does not correlate with them, hence
in the mean their traces in force and offset have the ratio k exp(−jωd), whatever the loop does,
with the stiffness k and the latency d that is not in the stamps. One sine sees no difference of d
and d plus its period; 1.5 and 2.4 Hz have no period in common below 3.3 s. Trace and scatter come
from a fit to each window; only what the scatter cannot explain counts as latency.

References
----------
[1] Y. Mo, B. Sinopoli, "Secure control against replay attacks", 47th Allerton Conference (2009).
"""

from __future__ import annotations

from collections import deque
import math

import numpy as np

RATES = math.tau * np.array((1.5, 2.4))  # rad/s, above what the prediction leaves of the sway
LEAST_AMPLITUDE = 0.2  # N, of each sine
AMPLITUDE, MOST_AMPLITUDE = 1.5, 0.04  # of the scatter of the force's trace; of the desired force
WINDOW = 1.7  # s, in which the sines differ by more than a period
SLOW = 7  # polynomials, that take what is slower than the sines
WINDOWS = (5, 10, 20, 40, 80)  # that means are of: the sooner, the clearer the traces
LEAST_SAMPLES = 25  # in a window
TRIED = np.array(sorted(np.arange(-20, 601) * 5e-3, key=abs))  # s; a damped brush leads
MOST_LATENCY = 0.11  # s
CERTAINTY = 3.0  # standard deviations
LEAST_ANGLE = 0.2  # rad, by which traces may always miss a latency


class LatencyCheck:
    """
    Find a latency that is not in the stamps.

    Attributes
    ----------
    latency : float
        What it is at least [s], less what the scatter can explain.

    """

    def __init__(self) -> None:
        self._traces: deque[np.ndarray] = deque(maxlen=max(WINDOWS))
        self.begin()

    def begin(self) -> None:
        """Forget everything: the contact is another one."""
        self.latency, self._amplitudes = 0.0, np.zeros(len(RATES))
        self._samples: list[tuple[float, float, float]] = []
        self._traces.clear()

    def modulation(self, time: float, desired: float) -> tuple[float, float]:
        """Return what is added to a desired force [N] at a time [s], and its rate [N/s]."""
        most = max(MOST_AMPLITUDE * desired, LEAST_AMPLITUDE)
        amplitudes = np.clip(self._amplitudes, LEAST_AMPLITUDE, most)
        return (float(amplitudes @ np.sin(RATES * time)),
                float(amplitudes * RATES @ np.cos(RATES * time)))

    def add(self, stamp: float, force: float, offset: float) -> None:
        """Note a force [N] measured at a stamp [s] with an offset [m]."""
        if self._samples and stamp - self._samples[0][0] >= WINDOW:
            if len(self._samples) >= LEAST_SAMPLES:
                self._traces.append(_traces(np.array(self._samples)))
                self._evaluate(np.array(self._traces))
            self._samples.clear()
        self._samples.append((stamp, force, offset))

    def _evaluate(self, traces: np.ndarray) -> None:
        count = len(traces)
        if count < min(WINDOWS):
            return
        self.latency = max(
            _latency(*_mean(traces[-most:])) for most in WINDOWS if most <= count)
        self._amplitudes = AMPLITUDE * math.sqrt(count) * _mean(traces)[2]


def _mean(traces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the mean traces of force and offset, and the force's standard errors beside them."""
    count, (force, offset) = len(traces), traces.mean(axis=0)
    beside = traces[:, 0] - force / offset * traces[:, 1]
    return force, offset, np.linalg.norm(beside, axis=0) / math.sqrt(count * (count - 1))


def _latency(force: np.ndarray, offset: np.ndarray, errors: np.ndarray) -> float:
    """Return the least latency that mean traces leave possible, else that which fits best."""
    share = np.minimum(CERTAINTY * errors / abs(force), 1.0)
    allowed = np.where(share < 1.0, np.arcsin(share) + LEAST_ANGLE, math.pi)
    turned = np.angle(force / offset * np.exp(1j * TRIED[:, None] * RATES))
    missed = (abs(turned) / allowed).max(axis=1)
    return max(float(TRIED[np.argmax(missed <= max(1.0, missed.min()))]), 0.0)


def _traces(samples: np.ndarray) -> np.ndarray:
    """Return the complex amplitudes of force and offset for each sine, shape (2, sines)."""
    phases = np.outer(samples[:, 0], RATES)
    slow = np.vander(samples[:, 0] - samples[:, 0].mean(), SLOW)
    waves = np.column_stack([np.cos(phases), np.sin(phases), slow])
    found = np.linalg.lstsq(waves, samples[:, 1:], rcond=None)[0].T
    return found[:, :len(RATES)] - 1j * found[:, len(RATES):2 * len(RATES)]

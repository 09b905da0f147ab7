"""Whether the measured force can be true, is held and comes in time; figures for the operator."""

from __future__ import annotations

from collections import deque
import math

import numpy as np

NOISE = 0.5  # N, usual of a force sensor; below it the head is off the wall
TOUCH = 3.0 * NOISE  # N, above which it surely touches
ODD = 6.0 * NOISE  # N, that steps, dead band and noise of a sound sensor do not come to
OLDEST_WRENCH = 0.2  # s, from which a measurement is not used
MEMORY = 10.0  # s, over which the figures are means
HOLD_TIME = 4.0  # s, over which a force that is not held shows
CHATTER_TIME, CHATTER_MEMORY = 0.1, 0.4  # s: what is faster than the loop, and for how long
CHATTER_SHARE = 0.2  # of the force to hold
CHATTER_PAUSE, CHATTER_FORGOTTEN, MOST_CHATTERS = 0.4, 10.0, 6  # s, s, and how often
MOST_FORCE, LEAST_OVER = 2.0, 15.0  # of the desired force; N beyond it
PULL_TIME = 0.05  # s: a wall cannot pull
LEAST_JUMP, JUMP_SHARE, JUMP_WAY = 10.0, 0.4, 1.5e-3  # N; of the desired force; m
RATES = math.tau * np.array((1.5, 2.4))  # rad/s, above what the prediction leaves of the sway
LEAST_AMPLITUDE = 0.2  # N, of each sine
AMPLITUDE, MOST_AMPLITUDE = 1.5, 0.04  # of the scatter of the force's trace; of the desired force
WINDOW = 1.7  # s, in which the sines differ by more than a period
SLOW = 7  # polynomials, that take what is slower than the sines
WINDOWS = (5, 10, 20, 40, 80)  # that means are of: the sooner, the clearer the traces
LEAST_SAMPLES = 25  # in a window
CREEPING = 9  # windows with offsets in order, 1 of 180,000 if they are in none
TRIED = np.array(sorted(np.arange(-20, 601) * 5e-3, key=abs))  # s; a damped brush leads
MOST_LATENCY = 0.11  # s
CERTAINTY = 3.0  # standard deviations
LEAST_ANGLE = 0.2  # rad, by which traces may always miss a latency


class ForceWatch:
    """Watch the force on the wall."""

    def __init__(self) -> None:
        self.stamp = -math.inf  #: of the last measurement [s]
        #: mean force, RMS of its error [N] and share off the wall over the last seconds
        self.mean = self.rms = self.share_off = 0.0
        self._force = 0.0
        self.begin()

    def begin(self) -> None:
        """Forget what was wrong: the head looks for the wall."""
        self._fault = ''
        self.low = self._fast = 0.0  #: force without what is faster than the loop [N]
        self._sound_at = self.stamp
        self._chatters, self._chattered_at = 0, -math.inf
        self.begin_contact()

    def begin_contact(self) -> None:
        """Forget how far the force was from the desired one: that is another one now."""
        self._error = 0.0

    def add(
        self, stamp: float, force: float, desired: float, stiffness: float, unanswered: float
    ) -> None:
        """
        Note a measurement.

        With the force that is desired, 0 while there is no contact [N], the stiffness of the
        contact [N/m] and by how much the force should have changed since it changed at all [N].
        """
        interval = min(max(stamp - self.stamp, 0.0), OLDEST_WRENCH)
        change, self._force, self.stamp = force - self._force, force, stamp
        if force > -ODD:
            self._sound_at = stamp
        if unanswered > ODD:
            self._fault = (f'contact_wrench is stuck at {force:.1f} N: it should have changed by '
                           f'{unanswered:.1f} N, bound {ODD:g} N')
        if desired > 0.0:
            self._look_for_jump(change, desired, stiffness)
        self.low += _share(interval, CHATTER_TIME) * (force - self.low)
        self._fast += _share(interval, CHATTER_MEMORY) * ((force - self.low) ** 2 - self._fast)
        error = (force - desired) ** 2
        if force > TOUCH:  # a wall that is gone is looked for again
            self._error += _share(interval, HOLD_TIME) * (error - self._error)
        share = _share(interval, MEMORY)
        self.mean += share * (force - self.mean)
        self.rms = math.sqrt(self.rms ** 2 + share * (error - self.rms ** 2))
        self.share_off += share * (float(force < NOISE) - self.share_off)

    def chatters(self, final: float) -> bool:
        """
        Return whether the force changes faster than the loop can; once for each pause.

        By the force [N] to hold in the end: while it rises, what the prediction leaves of the sway
        is already as large as it will be.
        """
        bound = max(ODD, CHATTER_SHARE * final)
        since = self.stamp - self._chattered_at
        if since > CHATTER_FORGOTTEN:
            self._chatters = 0
        if since < CHATTER_PAUSE or self._fast < bound ** 2:
            return False
        self._chatters, self._chattered_at = self._chatters + 1, self.stamp
        return True

    @property
    def fault(self) -> str:
        """What is wrong with the measurements, empty if nothing is."""
        if not self._fault and self.stamp - self._sound_at > PULL_TIME:
            return (f'the wall pulls with {-self._force:.1f} N, which no wall can: is the sign of '
                    'contact_wrench wrong, or its zero?')
        return self._fault

    def not_held(self, final: float, desired: float, most_error: float) -> str:
        """
        Return why the force cannot be held, empty if it can.

        By the forces to hold in the end and now, and by how much it may miss the latter, RMS [N].
        """
        most = max(MOST_FORCE * final, final + LEAST_OVER)
        if self._force > most:
            return f'{self._force:.1f} N on the wall, bound {most:.1f} N'
        if self._chatters > MOST_CHATTERS:
            return (f'the force chatters by {math.sqrt(self._fast):.1f} N RMS: the contact is too '
                    'stiff for what the prediction leaves over')
        error = math.sqrt(self._error)
        if error > most_error:
            return (f'the force misses the desired {desired:.1f} N by {error:.1f} N RMS, bound '
                    f'{most_error:.1f} N')
        return ''

    def _look_for_jump(self, change: float, desired: float, stiffness: float) -> None:
        bound = max(LEAST_JUMP, JUMP_SHARE * desired, JUMP_WAY * stiffness)
        if abs(change) > bound:
            self._fault = (f'contact_wrench jumped by {change:+.1f} N between two measurements, '
                           f'bound {bound:.1f} N')


def _share(interval: float, time: float) -> float:
    return 1.0 - math.exp(-interval / time)


class LatencyCheck:
    """
    Find a latency that is not in the stamps: the force must answer in time to the head.

    A sensor that is late but stamps its measurements as fresh looks sound. So two small sines are
    added to the desired force, a watermark [1]: the wall's motion does not correlate with them,
    hence in the mean their traces in force and offset have the ratio k exp(−jωd), whatever the
    loop does, with the stiffness k and the latency d that is not in the stamps. One sine sees no
    difference of d and d plus its period; 1.5 and 2.4 Hz have no period in common below 3.3 s.
    Trace and scatter come from a fit to each window; only what the scatter cannot explain counts
    as latency.

    References
    ----------
    [1] Y. Mo, B. Sinopoli, "Secure control against replay attacks", 47th Allerton Conference
    (2009).

    """

    def __init__(self) -> None:
        self._traces: deque[np.ndarray] = deque(maxlen=max(WINDOWS))
        self._places: deque[float] = deque(maxlen=CREEPING)
        self.begin()

    def begin(self) -> None:
        """Forget everything: the contact is another one."""
        #: that at least is not in the stamps [s], less what the scatter can explain
        self.latency, self._amplitudes = 0.0, np.zeros(len(RATES))
        self._samples: list[tuple[float, float, float]] = []
        self._traces.clear()
        self._places.clear()
        self.forget_stiffness()

    def forget_stiffness(self) -> None:
        """Believe no window before: the contact has become stiffer."""
        #: of the contact at most, by the last windows [N/m]; infinity before
        self.stiffness, self._windows = math.inf, 0

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
                samples = np.array(self._samples)
                self._traces.append(_traces(samples))
                self._places.append(samples[:, 2].mean())
                self._windows += 1
                self._evaluate(np.array(self._traces))
            self._samples.clear()
        self._samples.append((stamp, force, offset))

    @property
    def creep(self) -> float:
        """
        How fast the offset has crept in one direction, window by window [m/s]; 0 if it has not.

        A zero that drifts moves it so. A frame moves it for a moment, sway and strokes to and fro.
        """
        steps = np.diff(self._places)
        if len(self._places) < CREEPING or abs(np.sign(steps).sum()) < len(steps):
            return 0.0
        return float(abs(steps).min()) / WINDOW

    def _evaluate(self, traces: np.ndarray) -> None:
        count = len(traces)
        if count < min(WINDOWS):
            return
        self.latency = max(
            _latency(*_mean(traces[-most:])) for most in WINDOWS if most <= count)
        self._amplitudes = AMPLITUDE * math.sqrt(count) * _mean(traces)[2]
        if self._windows >= min(WINDOWS):
            force, offset, errors = _mean(traces[-min(WINDOWS):])
            self.stiffness = float(((abs(force) + CERTAINTY * errors) / abs(offset)).min())


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

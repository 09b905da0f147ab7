"""
Fit of a carriage's deceleration to its positions during a stop.

A carriage moves at the speed v, continues for a delay d, and brakes with the deceleration a. Its
servo follows this motion with a first-order lag L. The distance from the stop to rest is

    D = v (d + L) + v² / (2 a)

The speed and the distance are measured. For each lag and delay this equation has one deceleration.
The best deceleration gives the curve nearest to the positions. The uncertainty is the range of the
decelerations whose curves are nearly as near to the positions. The fit thus separates delay and
braking, so that a short delay does not hide a weak brake.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Deceleration(NamedTuple):
    """Estimated deceleration and its uncertainty [m/s²]."""

    best: float
    least: float
    most: float

    def __str__(self) -> str:
        return f'{self.best:.2f} m/s^2 ({self.least:.2f} to {self.most:.2f})'


POSITION_ERROR = 3e-5  # m, of a position at its time: jitter of SYNC and resolution
_REST_DISTANCE = 1e-5  # m, from the rest position: nearer carriages are at rest
# number of values tried
_DELAYS = 400
_LAGS = 4
_MOST_LAG = 1.5  # times the lag of the parameters: it differs between speeds and loads
_MOST = 200.0  # m/s², above any brake of a carriage


def fit_deceleration(
    times: np.ndarray, positions: np.ndarray, steady: int, lag: float
) -> Deceleration:
    """
    Return the deceleration of a stop that begins after the first `steady` positions.

    Parameters
    ----------
    times : array of shape (n,)
        Times of the positions [s].
    positions : array of shape (n,)
        Positions [m] at a constant speed, then until rest.
    steady : int
        Number of positions at the constant speed, at least 2.
    lag : float
        Lag of the servo according to the parameters [s].

    """
    times = times - times[steady - 1]
    direction = np.sign(positions[steady - 1] - positions[0])
    travelled = direction * (positions - positions[steady - 1])
    speed, start = np.polyfit(times[:steady], travelled[:steady], 1)
    # a weak servo overshoots its demand and returns: its brake ends at the farthest position
    travelled = np.maximum.accumulate(travelled) - start
    distance = travelled[-1]
    end = int(np.argmax(travelled >= distance - _REST_DISTANCE)) + 2
    times = times[steady:end]
    travelled = travelled[steady:end]

    errors: list[float] = []
    decelerations: list[float] = []
    for servo_lag in np.linspace(0.0, _MOST_LAG * lag, _LAGS):
        longest = max(0.0, distance / speed - servo_lag)
        for delay in np.linspace(0.0, longest, _DELAYS, endpoint=False):
            braking_distance = distance - speed * (delay + servo_lag)
            if braking_distance <= 0.5 * speed**2 / _MOST:
                continue
            deceleration = 0.5 * speed**2 / braking_distance
            curve = _travel(times, speed, delay, deceleration, servo_lag)
            errors.append(float(np.sqrt(np.mean((travelled - curve) ** 2))))
            decelerations.append(deceleration)
    if not errors:  # the carriage has stopped at once
        return Deceleration(_MOST, _MOST, np.inf)
    near = np.array(errors) <= min(errors) + POSITION_ERROR
    possible = np.array(decelerations)[near]
    best = decelerations[int(np.argmin(errors))]
    return Deceleration(best, float(possible.min()), float(possible.max()))


def _travel(
    times: np.ndarray, speed: float, delay: float, deceleration: float, lag: float
) -> np.ndarray:
    """
    Return the distances travelled by a carriage since the start of its stop [m].

    With the demanded distance s(t), a lag L lets the carriage move with the velocity u of
    L u' + u = s' from u = s' = v. The distance since the stop is s + L (v − u).

    Parameters
    ----------
    times : array of shape (n,)
        Times since the begin of the stop [s].
    speed : float
        Speed v before the stop, above 0 [m/s].
    delay : float
        Time before the demanded speed falls [s].
    deceleration : float
        Deceleration of the demand, above 0 [m/s²].
    lag : float
        Lag L of the servo [s]; 0 for none.

    """
    braking_time = speed / deceleration
    braked = np.clip(times - delay, 0.0, braking_time)  # time of braking so far [s]
    demanded = speed * (np.minimum(times, delay) + braked)
    demanded -= 0.5 * deceleration * braked**2
    if lag == 0.0:
        return demanded

    settled = 1.0 - np.exp(-braked / lag)
    rested = np.clip(times - delay - braking_time, 0.0, None)  # since the demand rests
    speed_at_rest = speed - deceleration * (braked - lag * settled)
    actual_speed = speed_at_rest * np.exp(-rested / lag)
    return demanded + lag * (speed - actual_speed)

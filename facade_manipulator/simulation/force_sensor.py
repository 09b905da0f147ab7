"""A force sensor on the head as there are: noisy, and at times broken."""

from __future__ import annotations

from collections import deque

import numpy as np

from facade_manipulator.kinematics import Wrench
from facade_manipulator.parameters import parameter, settings

FAULTS = ('none', 'silent', 'stuck', 'jump', 'reversed', 'late')


@settings
class ForceSensorSettings:
    """How well the sensor measures the wrench on the head, and how it breaks."""

    force_noise: float = parameter(
        0.5, 'Standard deviation of the forces', unit='N', minimum=0.0, maximum=100.0)
    moment_noise: float = parameter(
        0.05, 'Standard deviation of the moment', unit='N m', minimum=0.0, maximum=100.0)
    fault: str = parameter('none', 'How the sensor breaks', choices=FAULTS)
    fault_from: float = parameter(
        0.0, 'When it breaks, counted from its first measurement', unit='s', minimum=0.0)
    jump: float = parameter(
        20.0, 'By how much the force jumps', unit='N', minimum=-1e3, maximum=1e3)
    delay: float = parameter(
        0.2, 'How late a late sensor is, without saying so', unit='s', minimum=0.0, maximum=2.0)
    seed: int = parameter(1, 'Seed of the noise', minimum=0)


class ForceSensor:
    """Measure the wrench of the wall on the head."""

    def __init__(self, settings: ForceSensorSettings) -> None:
        self._settings = settings
        self._random = np.random.default_rng(settings.seed)
        self._deviation = np.array(
            (settings.force_noise, settings.force_noise, settings.moment_noise))
        self._begin: float | None = None
        self._past: deque[tuple[float, Wrench]] = deque()
        self._stuck: Wrench | None = None

    def measure(self, time: float, wrench: Wrench) -> Wrench | None:
        """Return what the sensor shows of a wrench at a time [s]; None if it is silent."""
        noise = self._deviation * self._random.standard_normal(len(self._deviation))
        measured = Wrench(*(np.array(wrench) + noise).tolist())
        self._begin = time if self._begin is None else self._begin
        self._past.append((time, measured))
        while len(self._past) > 1 and self._past[1][0] <= time - self._settings.delay:
            self._past.popleft()
        broken = time - self._begin >= self._settings.fault_from
        return self._broken(measured) if broken else measured

    def _broken(self, measured: Wrench) -> Wrench | None:
        self._stuck = self._stuck or measured
        shown = {
            'silent': None,
            'stuck': self._stuck,
            'jump': measured._replace(fy=measured.fy - self._settings.jump),
            'reversed': Wrench(*(-value for value in measured)),
            'late': self._past[0][1],
        }
        return shown.get(self._settings.fault, measured)

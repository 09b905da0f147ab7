"""The head on the wall over a run: where it was, where it should have been, in figures."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from facade_manipulator.kinematics import compose, Pose
from facade_manipulator.lab.gondola.wall import AXES, compared


class Course(NamedTuple):
    """Samples as arrays; poses on the wall have the shape (n, 3)."""

    times: np.ndarray  #: since the first of them [s]
    heads: np.ndarray
    rails: list[Pose]
    goals: np.ndarray
    references: np.ndarray  #: where on its path to the goal the head should be
    settled: np.ndarray  #: whether the goal had stood for long enough to count

    @property
    def errors(self) -> np.ndarray:
        """How far the head is from where it should be, shape (n, 3)."""
        return self.heads - self.references

    @property
    def uncompensated(self) -> np.ndarray:
        """How far a mechanism that stands still would be, shape (n, 3)."""
        return self.carried(self.references)

    @property
    def counts(self) -> np.ndarray:
        """Which samples figures are made of: all where no goal stood for long, shape (n,)."""
        return self.settled if self.settled.any() else np.ones_like(self.settled)

    def carried(self, points: np.ndarray) -> np.ndarray:
        """Return how far the gondola carries points on the wall, of shape (n, 3) or (3,)."""
        points = np.broadcast_to(points, self.heads.shape)
        return np.array([compose(rail, Pose(*point)) for rail, point in zip(
            self.rails, points, strict=True)]) - points


def figures(course: Course) -> dict[str, dict[str, float | None]]:
    """Return RMS of disturbance and error and the attenuation of each axis."""
    without, errors = (rms(values[course.counts]).tolist()
                       for values in (course.uncompensated, course.errors))
    return {axis: compared(*pair)
            for axis, *pair in zip(AXES, without, errors, strict=True)}


def between(times: np.ndarray, samples: Sequence[Sequence[float]] | np.ndarray) -> np.ndarray:
    """Return what the columns of samples after the first, the time, are at other times."""
    stamps, *columns = np.transpose(samples)
    return np.transpose([np.interp(times, stamps, column) for column in columns])


def rms(values: np.ndarray) -> np.ndarray:
    """Return the root mean square of each column."""
    return np.sqrt(np.mean(values ** 2, axis=0))


def decibels(attenuation: float | None) -> str:
    """Return an attenuation for people; there is not one of nothing."""
    return '-' if attenuation is None else f'{attenuation:.3g} dB'

"""A compensator at 100 Hz with its estimator and a head that follows it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from facade_manipulator.compensation.compensator import (
    Compensator,
    CompensatorSettings,
    CorrectedPose,
)
from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import compose, Geometry, Pose, ZERO_POSE

START, PERIOD, ESTIMATE_AGE = 1000.0, 0.01, 0.02  # s


class CompensatedHead:
    """
    Run a compensator on a motion of the rail, or on a rail that stands displaced.

    The head reaches each pose with a lag [s]. Without a lag it rests, or is not measured at all.
    """

    def __init__(
        self, motion: Callable[[float], Pose] | Pose = ZERO_POSE, goal: Pose | None = None,
        head: Pose | None = None, lag: float | None = None, **settings: Any,
    ) -> None:
        self.compensator = Compensator(Geometry(), CompensatorSettings(**settings))
        self.motion = motion if callable(motion) else lambda _: motion
        self.variances: tuple[float, ...] | None = (0.0, 0.0, 0.0)  #: None for a silent estimator
        self.set_by = 0.0  #: how far the system clock is set forward [s]
        self.outputs: list[CorrectedPose | None] = []
        self.rejected = 0  #: number of rejected messages
        self._true, self._lag, self.head = START, lag, head
        if goal is not None:
            self.compensator.set_goal(goal)

    @property
    def now(self) -> float:
        """Return the system time [s]."""
        return self._true + self.set_by

    @property
    def last(self) -> CorrectedPose | None:
        """Return the newest corrected pose."""
        return self.outputs[-1]

    @property
    def poses(self) -> np.ndarray:
        """Return the corrected poses, shape (n, 3) [m, m, rad]."""
        return np.array([output.pose for output in self.outputs])

    @property
    def on_wall(self) -> Pose:
        """Return the pose on the wall [m, m, rad] for which the newest corrected pose is meant."""
        return compose(self.motion(self.last.time - self.set_by), self.last.pose)

    def run(self, duration: float) -> CompensatedHead:
        """Run for a time [s]."""
        for _ in range(round(duration / PERIOD)):
            if self.head is not None:
                self._attempt(self.compensator.following.add_head, self.now, self.head)
            self._true += PERIOD
            if self.variances is not None:
                self._attempt(self.compensator.add_estimate, self.now, self.now - ESTIMATE_AGE,
                              self.motion(self._true - ESTIMATE_AGE), self.variances)
            self.outputs.append(self.compensator.update(self.now))
            if self._lag is not None:
                delay = round((self.compensator.settings.horizon + self._lag) / PERIOD)
                reached = self.outputs[:-delay]
                self.head = reached[-1].pose if reached and reached[-1] else self.head
        return self

    def _attempt(self, take: Callable[..., object], *arguments: Any) -> None:
        try:
            take(*arguments)
        except InputError:
            self.rejected += 1

"""A compensator at 100 Hz with its estimator and a head that follows it."""

from contextlib import suppress

import numpy as np

from facade_manipulator.compensation.pose_compensator import (
    Compensator,
    CompensatorSettings,
)
from facade_manipulator.errors import InputError
from facade_manipulator.kinematics import compose, Geometry, ZERO_POSE

START = 1000.0  # s
PERIOD = 0.01  # s


class CompensatedHead:
    """
    Run a compensator on a motion of the rail, or on a rail that stands displaced.

    The motion is a function of time [s], or a pose. The head reaches each pose with a lag [s].
    Without a lag it rests, or is not measured at all. Estimates have a rate [Hz], and an age [s]
    when they arrive.
    """

    def __init__(
        self,
        motion=ZERO_POSE,
        goal=None,
        head=None,
        lag=None,
        rate=100.0,
        age=0.02,
        **settings,
    ):
        self.compensator = Compensator(Geometry(), CompensatorSettings(**settings))
        self.motion = motion if callable(motion) else lambda _: motion
        self.variances = (0.0, 0.0, 0.0)  #: None for a silent estimator
        self.set_by = 0.0  #: how far the system clock is set forward [s]
        self.outputs = []  #: corrected poses, None without a goal
        self.accepted = 0  #: number of accepted estimates
        self.count = 0  #: number of estimates
        self._true = START
        self._lag = lag
        self.head = head
        self._rate = rate
        self._age = age
        if goal is not None:
            self.compensator.set_goal(goal)

    @property
    def now(self):
        """Return the system time [s]."""
        return self._true + self.set_by

    @property
    def last(self):
        """Return the newest corrected pose."""
        return self.outputs[-1]

    def all(self, name):
        """Return a field of the corrected poses, shape (n, 3) [m, m, rad]."""
        return np.array([getattr(output, name) for output in self.outputs])

    @property
    def on_wall(self):
        """Return the pose on the wall [m, m, rad] for which the newest corrected pose is meant."""
        return compose(self.motion(self.last.time - self.set_by), self.last.pose)

    def add_estimate(self, stamp):
        """Estimate the motion at a true time [s]."""
        if self.variances is not None:
            stamped = stamp + self.set_by
            pose = self.motion(stamp)
            self.compensator.add_estimate(self.now, stamped, pose, self.variances)

    def update(self):
        """Return the corrected pose of one cycle."""
        return self.compensator.update(self.now)

    def run(self, duration):
        """Run for a time [s]; return the compensated head."""
        for _ in range(round(duration / PERIOD)):
            if self.head is not None:
                with suppress(InputError):  # the clock was set back
                    self.compensator.following.add_head(self.now, self.now, self.head)
            self._true += PERIOD
            while (
                stamp := START + self.count / self._rate
            ) < self._true - self._age + 1e-6:
                self.count += 1
                with suppress(InputError):
                    self.add_estimate(stamp)
                    self.accepted += 1
            self.outputs.append(self.update())
            if self._lag is not None:
                delay = round((self.compensator.settings.lead + self._lag) / PERIOD)
                reached = self.outputs[:-delay]
                self.head = reached[-1].pose if reached and reached[-1] else self.head
        return self

"""
Filter steps of the last 0.4 s, with which a late measurement is applied at its stamp.

A measurement belongs to the first step that is not earlier. Inputs and measurements after this
measurement are applied again, with the same levels of the wall. The result equals the result of
measurements without latency.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right, insort
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
import math
from operator import attrgetter

from facade_manipulator.estimation.rail_pose_model import FilterState, ImuInput, Process

_stamp = attrgetter('stamp')


@dataclass(slots=True)
class Measurement:
    """Scalar measurement of one sensor."""

    sensor: str
    stamp: float
    value: float
    variance: float
    #: of the wall [m], infinite for an outlier; NaN is undecided
    level: float = math.nan
    level_variance: float = 0.0  #: of the offset of the level [m²]
    spread: float = 0.0  #: standard deviation that the state gains instead of an update


@dataclass(slots=True)
class Step:
    """Filter step: time [s], input since the previous step, and state after the updates."""

    stamp: float
    imu: ImuInput
    state: FilterState


Correct = Callable[[Step, Measurement], FilterState]


class History:
    """
    Filter steps in the order of their stamps.

    Parameters
    ----------
    process : Process
    correct : callable
        Takes a step and a measurement, and returns the state of the step after the update. The
        first call decides the level of the wall to which the measurement belongs.
    stamp : float
        Time of the initial state [s].

    """

    # s, length of the history: more than `OLDEST_MEASUREMENT` of `imu_checks`, the maximum age
    HISTORY_SPAN = 0.4
    # s, maximum step that averages inputs: two at 200 Hz lose no accuracy
    LONGEST = 0.011

    def __init__(self, process: Process, correct: Correct, stamp: float) -> None:
        self._process = process
        self._correct = correct
        self._steps = [Step(stamp, None, process.initial_state())]
        self._valid = 1  # number of steps whose states are up to date
        self._measurements: list[Measurement] = []  # in the order of their stamps

    def restart(self, state: FilterState) -> None:
        """Discard all steps, and continue with a state at the newest stamp."""
        newest = self._steps[-1]
        self._steps = [Step(newest.stamp, newest.imu, state)]
        self._valid = 1

    def update(self) -> Step:
        """Recompute all outdated steps with their measurements; return the newest step."""
        for before, step in pairwise(self._steps[self._valid - 1 :]):
            duration = step.stamp - before.stamp
            step.state = self._process.propagate(before.state, step.imu, duration)
            begin = bisect_right(self._measurements, before.stamp, key=_stamp)
            end = bisect_right(self._measurements, step.stamp, key=_stamp)
            for measurement in self._measurements[begin:end]:
                step.state = self._correct(step, measurement)
        self._valid = len(self._steps)
        return self._steps[-1]

    @property
    def oldest(self) -> float:
        """Return the oldest stamp that a measurement may have [s]."""
        return self._steps[0].stamp

    def add_input(self, stamp: float, imu: ImuInput) -> None:
        """
        Append a step at a stamp [s] without computing its state, and discard old steps.

        An input of the IMU replaces the steps without IMU from its stamp on. If the state of the
        newest step is not computed yet and the joint step is at most `LONGEST`, that step is
        extended to the stamp with the mean of both inputs. The caller ensures increasing stamps,
        except that a late input may follow a step without IMU.
        """
        steps = self._steps
        if imu:
            while len(steps) > 1 and steps[-1].stamp >= stamp and steps[-1].imu is None:
                steps.pop()
        self._valid = min(self._valid, len(steps))  # a removed step may have been valid

        last = steps[-1]
        is_pending = self._valid < len(steps)
        if is_pending and imu and last.imu and stamp - steps[-2].stamp <= self.LONGEST:
            share = (stamp - last.stamp) / (stamp - steps[-2].stamp)
            last.imu = mean_input(last.imu, imu, share)
            last.stamp = stamp
        else:
            steps.append(Step(stamp, imu, last.state))

        while self._valid > 1 and steps[1].stamp < stamp - self.HISTORY_SPAN:
            del steps[0]
            self._valid -= 1
        count = bisect_right(self._measurements, self.oldest, key=_stamp)
        del self._measurements[:count]

    def add_measurement(self, measurement: Measurement) -> None:
        """Add a measurement newer than `oldest`, which may also be newer than the newest step."""
        insort(self._measurements, measurement, key=_stamp)
        first = bisect_left(self._steps, measurement.stamp, key=_stamp)
        self._valid = min(self._valid, first)


def mean_input(
    first: Sequence[float], second: Sequence[float], share: float
) -> tuple[float, ...]:
    """Return the weighted mean of two inputs; `share` is the weight of the second, 0 to 1."""
    mean = []
    for before, after in zip(first, second, strict=True):
        mean.append((1.0 - share) * before + share * after)
    return tuple(mean)

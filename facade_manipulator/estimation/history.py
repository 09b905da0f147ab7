"""
The last 0.4 s of the filter, so that a late measurement applies at its stamp.

A measurement belongs to the step nearest to its stamp. Inputs and measurements from there on
are applied again, with the decisions already made. The result is that of measurements without
latency.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from operator import attrgetter

from facade_manipulator.estimation.model import FilterState, ImuInput, Process

SPAN = 0.4  # s, kept: no measurement may be older
LONGEST = 0.011  # s, of a step with several inputs: the mean of two at 200 Hz is as good

_stamp = attrgetter('stamp')


@dataclass(slots=True)
class Measurement:
    """One number of a sensor."""

    sensor: str
    stamp: float
    value: float
    variance: float
    level: float | None = None  #: of the wall [m], infinite for an outlier; None is undecided
    spread: float = 0.0  #: standard deviation that the state gains instead of an update


@dataclass(slots=True)
class Step:
    """A time [s], the input that led there, the measurements of that time, the state after."""

    stamp: float
    imu: ImuInput
    state: FilterState
    measurements: list[Measurement] = field(default_factory=list)


Correct = Callable[[Step, Measurement], FilterState]


class History:
    """
    Steps in the order of their stamps.

    Parameters
    ----------
    process : Process
    correct : callable
        Takes a step and a measurement, and returns the state of the step after the update. Decides
        once to which level of the wall the measurement belongs.
    stamp : float
        Time of the initial state [s].

    """

    def __init__(self, process: Process, correct: Correct, stamp: float) -> None:
        self._process, self._correct = process, correct
        self._steps = [Step(stamp, None, process.initial_state())]
        self._valid = 1  # number of steps whose states are up to date
        self._waiting: list[Measurement] = []  # newer than the newest input

    def restart(self, state: FilterState) -> None:
        """Forget all steps, and continue with a state at the newest stamp."""
        self._steps = [Step(self.stamp, self._steps[-1].imu, state)]
        self._valid = 1

    @property
    def newest(self) -> Step:
        """The newest step, up to date."""
        steps = self._steps
        for index in range(self._valid, len(steps)):
            before, step = steps[index - 1], steps[index]
            step.state = self._process.propagate(before.state, step.imu, step.stamp - before.stamp)
            for measurement in step.measurements:
                step.state = self._correct(step, measurement)
        self._valid = len(steps)
        return steps[-1]

    @property
    def stamp(self) -> float:
        """Time of the newest step [s]."""
        return self._steps[-1].stamp

    @property
    def oldest(self) -> float:
        """Time before which no measurement is used [s]."""
        return max(self._steps[0].stamp, self.stamp - SPAN)

    def add_input(self, stamp: float, imu: ImuInput) -> None:
        """Append a step; an input of the IMU replaces steps without IMU at its time."""
        steps = self._steps
        while imu and len(steps) > 1 and steps[-1].stamp >= stamp and steps[-1].imu is None:
            for measurement in steps.pop().measurements:
                insort(self._waiting, measurement, key=_stamp)
        self._valid = min(self._valid, len(steps))
        last, is_new = steps[-1], self._valid < len(steps)
        if is_new and imu and last.imu and stamp - steps[-2].stamp <= LONGEST:
            last.imu = mean_input(
                last.imu, imu, (stamp - last.stamp) / (stamp - steps[-2].stamp))
            last.stamp = stamp
        else:
            steps.append(Step(stamp, imu, last.state))
        while self._waiting and self._waiting[0].stamp <= stamp:
            self._place(self._waiting.pop(0))
        while self._valid > 1 and steps[1].stamp < stamp - SPAN:
            del steps[0]
            self._valid -= 1

    def add_measurement(self, measurement: Measurement) -> None:
        """Add a measurement that is newer than `oldest`."""
        if measurement.stamp > self.stamp:
            insort(self._waiting, measurement, key=_stamp)
        else:
            self._place(measurement)

    def _place(self, measurement: Measurement) -> None:
        steps, stamp = self._steps, measurement.stamp
        index = bisect_left(steps, stamp, lo=1, key=_stamp)
        if index > 1 and stamp - steps[index - 1].stamp < steps[index].stamp - stamp:
            index -= 1
        steps[index].measurements.append(measurement)
        self._valid = min(self._valid, index)


def mean_input(first: Sequence[float], second: Sequence[float], share: float) -> tuple[float, ...]:
    """Return the mean of two inputs; the second has a share of the time."""
    return tuple([(1.0 - share) * a + share * b for a, b in zip(first, second, strict=True)])

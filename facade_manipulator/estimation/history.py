"""
The last moments: inputs, measurements and states, so that what comes late goes where it belongs.

A measurement goes to the step nearest to its stamp, or splits the one in which that is. From
there on inputs and measurements are applied again, with the decisions already made about them: the
result is that of measurements without latency.
"""

from __future__ import annotations

from bisect import bisect_left, insort
from collections.abc import Callable
import math
from operator import attrgetter

from facade_manipulator.estimation.state import (
    COASTING,
    FilterState,
    InertialInput,
    mean_input,
    Process,
)

SPAN = 0.4  # s, that is kept: no measurement may be older
NEAR = 0.005  # s, over which a velocity is as good as constant: 13 µm at 1 m/s²
LONGEST = 0.011  # s, of a step of more than one input: two of 200 Hz, whose mean is as good
TRIM = 64  # steps that have become too old before they are dropped, all at once

_stamp = attrgetter('stamp')


class Measurement:
    """One number of a sensor; the level of the wall that it belongs to once that is decided."""

    __slots__ = ('level', 'sensor', 'spread', 'stamp', 'value', 'variance')

    def __init__(self, sensor: int, stamp: float, value: float, variance: float) -> None:
        self.sensor, self.stamp, self.value, self.variance = sensor, stamp, value, variance
        self.level: float | None = None  #: infinite for what belongs to none
        self.spread = 0.0  #: by which the state is to be less certain before it


class HistoryStep:
    """A time [s], what led there, what was measured then, and the state after it."""

    __slots__ = ('inertial', 'measurements', 'offsets', 'stamp', 'state')

    def __init__(self, stamp: float, inertial: InertialInput) -> None:
        self.stamp, self.inertial = stamp, inertial
        self.measurements: list[Measurement] = []
        self.state: FilterState
        self.offsets: FilterState  #: of the inertial sensor, as last known while the filter coasts


Correct = Callable[[float, FilterState, InertialInput, Measurement], FilterState]


class History:
    """
    Steps in the order of their stamps.

    Parameters
    ----------
    process : Process
    correct : callable
        Of a stamp, the state and the input then, and a measurement of about then: returns the
        corrected state, and decides once to which level of the wall the measurement belongs.

    """

    def __init__(self, process: Process, correct: Correct) -> None:
        self._process, self._correct = process, correct
        self._steps: list[HistoryStep] = []
        self._waiting: list[Measurement] = []
        self._settled = 0  # steps before this one are up to date

    def begin(self, stamp: float, state: FilterState, offsets: FilterState | None = None) -> None:
        """Forget everything before a time [s]; without offsets the present ones are kept."""
        step = HistoryStep(stamp, self._steps[-1].inertial if offsets is None else COASTING)
        step.state = state
        step.offsets = self._steps[-1].offsets if offsets is None else offsets
        self._steps, self._settled = [step], 1
        self._waiting = [one for one in self._waiting if one.stamp > stamp]

    @property
    def begun(self) -> bool:
        """Whether there is any state."""
        return bool(self._steps)

    @property
    def newest(self) -> HistoryStep:
        """The newest step, up to date."""
        self._settle()
        return self._steps[-1]

    @property
    def stamp(self) -> float:
        """Of the newest step [s]."""
        return self._steps[-1].stamp if self._steps else -math.inf

    @property
    def oldest(self) -> float:
        """Stamp that a measurement must not be before [s]."""
        return max(self._steps[0].stamp, self.stamp - SPAN) if self._steps else math.inf

    def add_input(self, stamp: float, inertial: InertialInput) -> None:
        """Go on to a stamp [s]; a measured input takes the place of steps that coasted there."""
        while (inertial.measured and len(self._steps) > 1 and self._steps[-1].stamp >= stamp
               and not self._steps[-1].inertial.measured):
            for measurement in self._steps.pop().measurements:
                insort(self._waiting, measurement, key=_stamp)
        self._settled = min(self._settled, len(self._steps))
        if not self._extend(stamp, inertial):
            self._steps.append(HistoryStep(stamp, inertial))
        while self._waiting and self._waiting[0].stamp <= stamp:
            self._place(self._waiting.pop(0))
        if len(self._steps) > TRIM and self._steps[TRIM].stamp < stamp - SPAN:
            self._settle()
            del self._steps[:TRIM]
            self._settled = len(self._steps)

    def _extend(self, stamp: float, inertial: InertialInput) -> bool:
        """Let the newest step last up to a stamp if nobody has made anything of it yet."""
        if self._settled == len(self._steps):
            return False
        before, last = self._steps[-2:]
        whole = stamp - before.stamp
        if not (inertial.measured and last.inertial.measured and whole <= LONGEST):
            return False
        last.inertial = mean_input(last.inertial, inertial, (stamp - last.stamp) / whole)
        last.stamp = stamp
        return True

    def add_measurement(self, measurement: Measurement) -> None:
        """Put a measurement, which is not older than `oldest`, where its stamp belongs."""
        if measurement.stamp > self.stamp:
            insort(self._waiting, measurement, key=_stamp)
        else:
            self._place(measurement)

    def _place(self, measurement: Measurement) -> None:
        steps, stamp = self._steps, measurement.stamp
        index = bisect_left(steps, stamp, key=_stamp)
        if index > 1 and stamp - steps[index - 1].stamp < min(steps[index].stamp - stamp, NEAR):
            index -= 1
        elif steps[index].stamp - stamp >= NEAR:
            steps.insert(index, HistoryStep(stamp, steps[index].inertial))
            self._settled = min(self._settled, index)
        steps[index].measurements.append(measurement)
        self._settled = min(self._settled, index)

    def _settle(self) -> None:
        for before, step in zip(
                self._steps[self._settled - 1:], self._steps[self._settled:], strict=False):
            self._advance(before, step)
            for measurement in step.measurements:
                step.state = self._correct(
                    step.stamp, step.state, step.inertial, measurement)
        self._settled = len(self._steps)

    def _advance(self, before: HistoryStep, step: HistoryStep) -> None:
        state, step.offsets = before.state, before.offsets
        if before.inertial.measured and not step.inertial.measured:
            step.offsets = self._process.offsets_of(state)
            state = self._process.without_imu(state, before.inertial)
        elif step.inertial.measured and not before.inertial.measured:
            state = self._process.with_imu(state, before.offsets)
        step.state = self._process.advanced(state, step.inertial, step.stamp - before.stamp)

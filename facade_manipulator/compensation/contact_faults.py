"""Contact faults: excessive or unsteady force, a faulty sensor, an unknown sensor zero."""

from __future__ import annotations

import math

from facade_manipulator.compensation.contact_force import (
    allowed_excess,
    filter_share,
    NOISE,
    OLDEST_WRENCH,
    TOUCH,
)
from facade_manipulator.errors import compared

MEASURING_ZERO = 'the zero of contact_wrench is being measured away from the wall'


class ForceRises:
    """
    RMS of force increases above the mean, averaged as for an oscillation.

    Falls do not count: a contact that returns, or a head that stops at a limit, is steady.

    Parameters
    ----------
    mean_time, memory : float
        Time constants of the mean, and of the average of the squares [s].

    """

    def __init__(self, mean_time: float, memory: float) -> None:
        self._mean_time = mean_time
        self._memory = memory
        self.mean = 0.0  #: low-pass of the force [N]
        self._variance = 0.0

    def forget(self) -> None:
        """Reset the RMS, but keep the mean."""
        self._variance = 0.0

    def add(self, interval: float, force: float, least: float) -> None:
        """Add a force [N] after an interval [s]; only increases above `least` count."""
        self.mean += filter_share(interval, self._mean_time) * (force - self.mean)
        rise = max(force - max(self.mean, least), 0.0)
        self._variance += filter_share(interval, self._memory) * (
            2.0 * rise**2 - self._variance
        )

    @property
    def rms(self) -> float:
        """Return the RMS [N] of an oscillation with these increases."""
        return math.sqrt(self._variance)


class ForceMonitor:
    """Monitor of the force for faults that require the head to leave the wall."""

    # N, above noise, steps and dead band of a working sensor
    SIGNIFICANT_FORCE = 6.0 * NOISE
    CHATTER_TIME = 0.1  # s, period faster than the loop
    CHATTER_MEMORY = 0.4  # s, averaging time of the chatter
    OSCILLATION_TIME = 2.0  # s, period of a loop with a late force; averaging time
    UNSTEADY_SHARE = 0.14  # of the desired force, RMS: held forces in gusts reach 0.13
    RETURNED = 0.8  # share of the desired force, below which a rise is not chatter

    def __init__(self) -> None:
        self.stamp = -math.inf  #: of the last measurement [s]
        self.force = 0.0  #: last force on the wall [N]
        self._chatter = ForceRises(self.CHATTER_TIME, self.CHATTER_MEMORY)
        self._oscillation = ForceRises(self.OSCILLATION_TIME, self.OSCILLATION_TIME)
        self._demanded = 0.0
        self.begin()

    @property
    def mean(self) -> float:
        """Return the force [N] without components that are too fast for the control loop."""
        return self._chatter.mean

    def begin(self) -> None:
        """Clear previous faults before a new approach to the wall."""
        self._chatter.forget()
        self._oscillation.forget()
        self._answered = self._demanded

    def add(
        self,
        stamp: float,
        force: float,
        demanded: float,
        desired: float,
        final: float,
        is_repeated: bool,
    ) -> None:
        """
        Record a force [N] measured at a stamp [s].

        The demanded force [N] is the force of the offset on a wall at the goal; only changes of
        this force count. A force far below the present desired force [N] is not chatter but a
        contact that returns. A first touch, and a slow rise to the final desired force [N], are
        not an oscillation.
        """
        interval = min(max(stamp - self.stamp, 0.0), OLDEST_WRENCH)
        self.stamp = stamp
        self.force = force
        self._chatter.add(interval, force, self.RETURNED * desired)
        self._oscillation.add(interval, force, min(desired + TOUCH, final))
        self._demanded = demanded
        if not is_repeated:
            self._answered = demanded

    def fault(self, desired: float) -> str:
        """Return the fault of the contact for a final desired force [N]; empty without a fault."""
        limit = desired + allowed_excess(desired)
        if self.force > limit:
            force, limit_text = compared(self.force, limit, '.1f', 4)
            return (
                f'force on the wall = {force} N is above the limit {limit_text} N; '
                'next: use a softer brush'
            )
        unanswered = abs(self._demanded - self._answered)
        if unanswered > self.SIGNIFICANT_FORCE:
            return (
                f'contact_wrench is frozen at {self.force:.1f} N while the demanded force '
                f'changes by {unanswered:.1f} N; next: check the force sensor'
            )
        chatter = self._chatter.rms
        oscillation = self._oscillation.rms
        bound = max(self.SIGNIFICANT_FORCE, self.UNSTEADY_SHARE * desired)
        if chatter > bound:
            chatter_text, limit_text = compared(chatter, bound, '.1f', 4)
            return (
                f'the force chatters by {chatter_text} N RMS, above the limit {limit_text} N; '
                'next: increase contact.stiffness or use a softer brush'
            )
        if oscillation > bound:
            rms_text, limit_text = compared(oscillation, bound, '.1f', 4)
            return (
                f'the force oscillates by {rms_text} N RMS, above the limit '
                f'{limit_text} N; next: check the delay of contact_wrench and contact.stiffness'
            )
        if self.mean < -self.SIGNIFICANT_FORCE:
            return (
                f'the wall pulls with {-self.mean:.1f} N; '
                'next: check sign and zero of contact_wrench'
            )
        return ''


class SensorZero:
    """Zero of the force sensor, measured while the head waits off the wall."""

    ZERO_TIME = 0.2  # s, low-pass of the sensor's zero
    MOST_ZERO = 10.0  # N, maximum of the sensor's zero
    ZERO_WAIT = 1.0  # s, off the wall until the zero is known

    def __init__(self) -> None:
        self.force = 0.0  #: reading off the wall [N]
        self.moment = 0.0  #: reading off the wall [N m]
        self._free_from = math.inf  # time from which the head is off the wall [s]

    def note_place(self, time: float, is_free: bool) -> None:
        """Record whether the head is off the wall at a time [s]."""
        self._free_from = min(self._free_from, time) if is_free else math.inf

    def add_measurement(
        self, stamp: float, interval: float, force: float, moment: float
    ) -> None:
        """Update the zero with readings off the wall [N, N m], an interval [s] after the last."""
        if stamp <= self._free_from:
            return
        share = filter_share(interval, self.ZERO_TIME)
        self.force += share * (force - self.force)
        self.moment += share * (moment - self.moment)

    def fault(self, now: float) -> str:
        """Return why the zero is invalid at a time [s]; empty if it is valid."""
        if now < self._free_from + self.ZERO_WAIT:
            return MEASURING_ZERO
        if abs(self.force) > self.MOST_ZERO:
            return (
                f'zero of the force = {self.force:.1f} N is beyond {self.MOST_ZERO:g} N; '
                'next: tare the sensor'
            )
        return ''

"""
Force control of the head on the wall: the law that moves the head, and a wall tracker.

The brush is the softest spring in series with the wall, so the stiffness k of the contact is at
most the stiffness k̂ of the brush. k̂ is a parameter. The force F(t) = k (a(t) + w(t)), with the
offset a and the motion w of the wall, is known at a stamp. An offset that is decided now acts only
one horizon later. With the offset â that was decided for the stamp, and the latency T since the
stamp,

    da/dt = (F_d − F − k̂ (a − â)) / (k̂ τ),    τ = 1.7 T.

The term k̂ (a − â) predicts the force of the offsets decided since the stamp. This law alone is
stable for every k ≤ 4.1 k̂. For k = k̂ no latency remains in the loop; for a smaller k the law is
slower. For k = k̂ and T = 70 ms the law halves the motion of the wall below 0.43 Hz, and amplifies
this motion above 1.0 Hz, at most by the factor 1.37. The moment follows the same law with k̂ w²/4
for a brush of the width w.

The remaining errors of the force are mostly noise of the estimator in the predicted disturbance d.
The force shows the distance of the wall from the rail, z = a − d − F/k̂, without that noise.
`WallTracker` follows z while the force is held. The offset becomes z + d + F_d/k̂, limited to a
bound around the offset of the law.

The tracker reduces the margins of the law. For k above 2 k̂, or with a latency that no stamp
shows, the loop of law and tracker oscillates within the bound. The bound is therefore
`TRACKING_BOUND` times a trust. The law alone holds the force for `TRIAL_TIME`. Then the trust
rises from 0 to 1. The trust falls while the RMS error of the force is above `WELL_HELD` and above
the RMS error of the law without the tracker, and always while it is above `BADLY_HELD`. After each
fall to 0 the trust rises half as fast, so that only the law remains if the tracker fails.

Beyond its margins, or with a latency H that no stamp shows, the law oscillates as well. The head
then moves towards the wall until T + H after the force has reached the desired force. The velocity
towards the wall is at most E / (k̂ `RISE_TIME`), with the excess E of the force limit over the
desired force. So the force F_d rises by at most E k (T + H) / (k̂ `RISE_TIME`) beyond the motion
of the wall. This rise is at most half of E while k (T + H) ≤ 0.75 k̂ s. Without a hidden latency,
this condition holds up to k = 10 k̂. For k = k̂, it holds up to H = 0.68 s. The velocity away from
the wall has no such limit. `contact_faults.py` then detects the oscillation, and the head
retracts.

A fade of the correction moves the head but not the gondola. While the head presses, the shift on
the wall absorbs the fade.
"""

from __future__ import annotations

import math

from facade_manipulator.motion.timed_buffer import TimedBuffer

OLDEST_WRENCH = 0.2  # s; an older wrench is not used
NOISE = 0.5  # N, standard deviation of usual force sensors
TOUCH = 3.0 * NOISE  # N; a larger force is a touch

SPEED = 0.04  # m/s, maximum of the offset


class ForceLaw:
    """
    Force law of one axis: along the wall's normal, or in yaw.

    `Pressing` adds each measurement and, in each cycle, moves the offset with the law's velocity.
    """

    FILTER_TIME = 0.01  # s, low-pass of force and offset alike
    TIME_CONSTANT = 1.7  # τ / T
    DELAYS = (0.02, 0.5)  # s, minimum and maximum of T

    def __init__(self) -> None:
        self.offset = 0.0  #: decided by the law alone [m or rad]
        self.tracked = 0.0  #: added to the offset by a tracker [m or rad]
        self.force = 0.0  #: force on the wall, low-pass [N or N m]
        #: total offset when the force was measured, low-pass [m or rad]
        self.measured_offset = 0.0
        self._stamp = -math.inf
        self._totals: TimedBuffer[float, float] = TimedBuffer()

    @property
    def total(self) -> float:
        """Return the current offset of the goal [m or rad]."""
        return self.offset + self.tracked

    def begin(self, offset: float) -> None:
        """Start with the head at an offset [m or rad]."""
        self.offset = offset
        self.measured_offset = offset

    def add_measurement(self, stamp: float, force: float) -> None:
        """Record a force [N or N m] measured at a stamp [s]."""
        share = filter_share(max(stamp - self._stamp, 0.0), self.FILTER_TIME)
        self._stamp = stamp
        self.force += share * (force - self.force)
        total = nearest_value(self._totals, stamp, self.total)
        self.measured_offset += share * (total - self.measured_offset)

    def velocity(
        self, desired: float, stiffness: float, time: float, dead_band: float = 0.0
    ) -> float:
        """
        Return the offset's velocity [m/s or rad/s] for a desired force at a time [s].

        An error within the dead band [N or N m] counts as zero.
        """
        delay = min(max(time - self._stamp, self.DELAYS[0]), self.DELAYS[1])
        error = desired - self.force - stiffness * (self.total - self.measured_offset)
        error -= min(max(error, -dead_band), dead_band)
        return error / (stiffness * self.TIME_CONSTANT * delay)

    def move(self, time: float, offset: float, tracked: float = 0.0) -> None:
        """Set the offset and its tracked part [m or rad] at a time [s]."""
        self.offset = offset
        self.tracked = tracked
        self._totals.append(time, self.total)


class WallTracker:
    """
    Tracker that estimates the wall's distance from the rail from the force.

    The tracker is a steady-state Kalman-Bucy filter for a distance whose jerk is white noise. Its
    bandwidth ω grows with the third root of the stiffness k̂ of the brush, because the noise of
    the distance is the noise of F/k̂. The gains of the filter for distance, velocity and
    acceleration are 2 ω, 2 ω² and ω³. An interval T between measurements multiplies these gains by
    T.
    """

    TRACKING_BANDWIDTH = 8.0  # rad/s, of the wall's distance at 5 N/mm; noise is F/k̂
    TRACKING_STIFFNESS = 5000.0  # N/m

    def __init__(self) -> None:
        self._stamp = -math.inf
        self._distance = 0.0
        self._velocity = 0.0
        self._acceleration = 0.0
        self._places: TimedBuffer[float, float] = TimedBuffer()

    def note_place(self, time: float, place: float) -> None:
        """Record the head's distance from the rail [m] at a time [s]: offset minus disturbance."""
        self._places.append(time, place)

    def add_measurement(self, stamp: float, force: float, stiffness: float) -> None:
        """
        Update distance, velocity and acceleration of the wall from a force [N] at a stamp [s].

        `stiffness` is the stiffness k̂ of the brush [N/m]. The first measurement, and one after a
        gap of `OLDEST_WRENCH`, only sets the distance.
        """
        measured = nearest_value(self._places, stamp, 0.0) - force / stiffness
        interval = stamp - self._stamp
        self._stamp = stamp
        if not 0.0 < interval < OLDEST_WRENCH:
            self._distance = measured
            self._velocity = 0.0
            self._acceleration = 0.0
            return
        gain = (
            interval
            * self.TRACKING_BANDWIDTH
            * (stiffness / self.TRACKING_STIFFNESS) ** (1.0 / 3.0)
        )
        expected = self._distance + interval * (
            self._velocity + 0.5 * interval * self._acceleration
        )
        error = measured - expected
        self._distance = expected + 2.0 * gain * error
        self._velocity += (
            interval * self._acceleration + 2.0 * gain**2 * error / interval
        )
        self._acceleration += gain**3 * error / interval**2

    def distance(self, time: float) -> float:
        """Return the predicted distance of the wall [m] at a time [s]."""
        return self._distance + min(time - self._stamp, OLDEST_WRENCH) * self._velocity


class TrackerTrust:
    """Trust in the tracker, which rises while the force error is small; updated once a cycle."""

    TRIAL_TIME = 5.0  # s in which the law holds the force alone and shows its error
    TRUST_TIME = 10.0  # s, then, in which the trust in the tracker rises from 0 to 1
    # s: averaging time of the squared error, fall of the trust to 0
    DISTRUST_TIME = 0.5
    WELL_HELD = 0.08  # RMS error as a share of the desired force; never distrust below this share
    BADLY_HELD = 0.12  # the same; always distrust above this share

    def __init__(self) -> None:
        self.share = 0.0  #: of the tracker's bound, from 0 to 1
        self._squared_error = 0.0  # of the force, averaged [N²]
        self._largest = 0.0  # squared error of the law alone, averaged [N²]
        self._held_for = 0.0  # s
        self._rise_time = self.TRUST_TIME  # s

    def reset(self, desired: float) -> None:
        """Reset the trust to zero before a final desired force [N] is applied."""
        self.share = 0.0
        self._squared_error = 0.0
        self._largest = max(self.WELL_HELD * desired, TOUCH) ** 2
        self._held_for = 0.0
        self._rise_time = self.TRUST_TIME

    def update(self, interval: float, error: float, desired: float) -> None:
        """Increase the trust while the force error [N] is small; otherwise decrease it."""
        self._squared_error += filter_share(interval, self.DISTRUST_TIME) * (
            error**2 - self._squared_error
        )
        self._held_for += interval
        if self._held_for < self.TRIAL_TIME:
            largest = max(self._largest, self._squared_error)
            self._largest = min(largest, max(self.BADLY_HELD * desired, TOUCH) ** 2)
        elif self._squared_error <= self._largest:
            self.share = min(self.share + interval / self._rise_time, 1.0)
        elif self.share > 0.0:
            self.share = max(self.share - interval / self.DISTRUST_TIME, 0.0)
            if self.share == 0.0:
                self._rise_time *= 2.0


class NormalForce:
    """
    Force control along the wall's normal: law, tracker, and a shift that absorbs fades.

    `Pressing` decides the offset of the law in each cycle and calls `move` with this offset.
    """

    RISE_TIME = 1.5  # s, minimum, in which a force on the brush rises by the excess of its limit
    # m, of the change of the law's offset: 3 σ of the prediction
    TRACKING_BOUND = 0.002

    def __init__(self) -> None:
        self.law = ForceLaw()
        self.tracker = WallTracker()
        self.trust = TrackerTrust()
        #: shift that absorbs fades of the correction while the head presses [m]
        self.absorbed = 0.0

    @property
    def shift(self) -> float:
        """Return the shift of the goal towards the wall [m]."""
        return self.law.total + self.absorbed

    @property
    def is_at_goal(self) -> bool:
        """Return whether all parts of the shift are zero."""
        return not (self.law.offset or self.law.tracked or self.absorbed)

    def begin(self, offset: float) -> None:
        """Start with the head at an offset [m] from its goal, before the path begins."""
        self.law.begin(offset)
        self.law.tracked = 0.0
        self.absorbed = 0.0

    def add_measurement(self, stamp: float, force: float, stiffness: float) -> None:
        """Record a force [N] at a stamp [s], on a brush with the given stiffness [N/m]."""
        self.law.add_measurement(stamp, force)
        self.tracker.add_measurement(stamp, force, stiffness)

    def velocity(
        self, desired: float, final: float, stiffness: float, time: float
    ) -> float:
        """Return the velocity of the law's offset [m/s] for a current and a final force [N]."""
        velocity = self.law.velocity(desired, stiffness, time)
        limit = allowed_excess(final) / (stiffness * self.RISE_TIME)
        return min(max(velocity, -SPEED), SPEED, limit)

    def absorb_fade(self, interval: float, fading: float, largest: float) -> None:
        """Absorb a fade of the correction [m/s], so that it does not move the head on the wall."""
        absorbed = self.absorbed + interval * fading
        self.absorbed = min(max(absorbed, -largest), largest)

    def release_fade(self, interval: float) -> None:
        """Release the absorbed fades over an interval [s] while the head is off the wall."""
        self.absorbed = towards(self.absorbed, 0.0, SPEED * interval)

    def move(
        self,
        time: float,
        interval: float,
        offset: float,
        rail_y: float,
        compression: float | None,
    ) -> None:
        """
        Set the law's offset [m] at a time [s]; move the tracker's part over an interval [s].

        `rail_y` is the y of the rail at this time [m]. The tracker acts while the desired
        compression of the brush [m] is known.
        """
        place_of_rail = rail_y - self.absorbed
        wanted = 0.0
        if compression is not None:
            expected = self.tracker.distance(time) + compression + place_of_rail
            bound = self.trust.share * self.TRACKING_BOUND
            wanted = min(max(expected - offset, -bound), bound)
        tracked = towards(self.law.tracked, wanted, SPEED * interval)
        self.law.move(time, offset, tracked)
        self.tracker.note_place(time, self.law.total - place_of_rail)


MOST_EXCESS = 1.0  # excess of the force limit, as a share of the desired force
LEAST_EXCESS = 15.0  # N, minimum of this excess


def allowed_excess(desired: float) -> float:
    """Return by how much the force may exceed a final desired force [N]."""
    return max(MOST_EXCESS * desired, LEAST_EXCESS)


def nearest_value(
    values: TimedBuffer[float, float], time: float, default: float
) -> float:
    """
    Return the value interpolated at a time [s], outside the recorded times the nearest value.

    Without recorded values, return the default.
    """
    between = values.interpolated(time)
    if between is not None:
        return between
    before, after = values.around(time)
    nearest = before or after
    return default if nearest is None else nearest[1]


def filter_share(interval: float, time_constant: float) -> float:
    """Return the weight of a new value in a low-pass filter after an interval [s]."""
    return 1.0 - math.exp(-interval / time_constant)


def towards(value: float, target: float, limit: float) -> float:
    """Move a value towards a target by at most a limit; return the new value."""
    step = target - value
    return target if abs(step) <= limit else value + math.copysign(limit, step)

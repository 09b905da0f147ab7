"""
Contact with the wall: offsets of the goal by the measured force, moment and lateral slip.

The brush is the softest spring in series with the wall, so the stiffness k of the contact is at
most that of the brush, k̂, which is a parameter. The force F(t) = k (a(t) + w(t)), with the offset
a and the motion w of the wall, is known at a stamp; an offset that is decided now acts only a
horizon later. With â the offset that was meant for the stamp, and T the latency since the stamp,

    da/dt = (F_d − F − k̂ (a − â)) / (k̂ τ),    τ = 1.7 T.

The term k̂ (a − â) predicts the force of the offsets decided since the stamp. This law alone is
stable for every k ≤ 4.1 k̂: for k = k̂ no latency remains in the loop, and for a smaller k it is
slower. With T = 70 ms it halves the motion of the wall below 0.35 Hz and amplifies it above
0.97 Hz, at most by 1.25. The moment follows the same law with k̂ w²/4 for a brush of the width w.

The remaining errors of the force are mostly noise of the estimator in the predicted disturbance d.
The force shows the distance of the wall from the rail, z = a − d − F/k̂, without that noise.
`WallTracker` follows z while the force is held. The offset becomes z + d + F_d/k̂ as far as that
differs from the law's by less than a bound.

The tracker reduces the margins of the law: for k above 2 k̂, or with a latency that no stamp
shows, the loop of law and tracker oscillates within the bound. The bound is therefore
`TRACKING_BOUND` times a trust. The law holds the force alone for `TRIAL_TIME`. Then the trust
rises from 0 to 1. It falls while the RMS error of the force is above `WELL_HELD` and above that
of the law alone, and in any case above `BADLY_HELD`. After each fall to 0 it rises half as fast,
so that the law alone remains where the tracker fails.

Beyond its margins, or with a latency H that no stamp shows, the law oscillates as well. It then
moves towards the wall until T + H after the force has reached the desired force. The velocity
towards the wall is at most E / (k̂ `RISE_TIME`), with the excess E of the force limit over the
desired force. So the force F_d rises by at most E k (T + H) / (k̂ `RISE_TIME`) beyond the motion
of the wall: by half of E while k (T + H) ≤ 0.75 k̂ s. Without a hidden latency, this holds up
to k = 10 k̂; for k = k̂, up to H = 0.68 s. The velocity away from the wall has no such limit.
`ForceMonitor` then sees the oscillation, and the head retracts.

A fade of the correction moves the head but not the gondola. While the head presses, the shift on
the wall absorbs the fade.
"""

from __future__ import annotations

from collections.abc import Iterable
import enum
import math
from typing import NamedTuple

from facade_manipulator.errors import InputError, require_recent
from facade_manipulator.kinematics import add, Pose, Wrench, ZERO_POSE
from facade_manipulator.motion.timed_buffer import KEPT_TIME, TimedBuffer
from facade_manipulator.parameters import parameter, settings

# Measurements
FUTURE_TOLERANCE = 0.02  # s
OLDEST_WRENCH = 0.2  # s: an older wrench is not used
OLDEST_OFFSET = 0.3  # s: an older lateral offset is not used
NOISE = 0.5  # N, standard deviation of usual force sensors
TOUCH = 3.0 * NOISE  # N: a larger force is a touch
SIGNIFICANT = (
    6.0 * NOISE
)  # N: noise, steps and dead band of a working sensor are smaller

# Law
FILTER_TIME = 0.01  # s, low-pass of force and offset alike
TIME_CONSTANT = 1.7  # τ / T
DELAYS = (0.02, 0.5)  # s, minimum and maximum of T
LEAST_STIFFNESS = (
    600.0  # N/m: with less, a damping of the brush of 25 N s/m makes the law ring
)
TRACKING_BANDWIDTH = 8.0  # rad/s, of the wall's distance at 5 N/mm; noise is F/k̂
TRACKING_STIFFNESS = 5000.0  # N/m
TRACKING_BOUND = 0.002  # m, of the change of the law's offset: 3 σ of the prediction
TRIAL_TIME = 5.0  # s in which the law holds the force alone and shows its error
TRUST_TIME = 10.0  # s, then, in which the trust in the tracker rises from 0 to 1
DISTRUST_TIME = 0.5  # s: averaging time of the squared error, fall of the trust to 0
# RMS error as a share of the desired force: below it no distrust, above it always distrust
WELL_HELD, BADLY_HELD = 0.08, 0.12
SPEED, YAW_SPEED = 0.04, 0.25  # m/s, rad/s, maximum of the offsets
RISE_TIME = (
    1.5  # s, minimum, in which a force on the brush rises by the excess of its limit
)
APPROACH_SPEED = 0.004  # m/s: a wall of 100 N/mm is touched with 28 N
FIRST_SHARE = 0.1  # share of the desired force at the beginning of the ramp
FRICTION = 0.3  # coefficient of friction of brushes on a wall
YAW_RANGE = 0.12  # rad

# Faults
MOST_EXCESS, LEAST_EXCESS = (
    1.0,
    15.0,
)  # of the force limit over the desired force: share of it; minimum [N]
CHATTER_TIME, CHATTER_MEMORY = (
    0.1,
    0.4,
)  # s, period faster than the loop; averaging time
OSCILLATION_TIME = 2.0  # s, period of a loop with a late force; averaging time
UNSTEADY_SHARE = (
    0.14  # of the desired force, RMS: with 0.2, late forces reach 47 of 30 N
)
RETURNED = 0.8  # share of the desired force, below which a rise is not chatter
LOST_AFTER = 1.0  # s without touch, after which the head approaches the wall again
ZERO_TIME, MOST_ZERO = 0.2, 10.0  # s, low-pass of the sensor's zero; N, its maximum
ZERO_WAIT = 1.0  # s, off the wall until the zero is known
NEAR_GOAL = 0.005  # m: maximum distance of the path past its goal
LEAST_BOUND, BOUND_SHARE = (
    2.0,
    0.1,
)  # N; share of the desired force: bounds of a held force

MEASURING_ZERO = 'the zero of contact_wrench is being measured away from the wall'

# Lateral regulator
LATERAL_GAIN = 1.5  # 1/s, integral gain: the measurement is late
LATERAL_SPEED, LATERAL_RANGE = 0.05, 0.1  # m/s, m, maximum speed and range of the shift


@settings
class ContactSettings:
    """Force on the wall, and the brush between head and wall."""

    enabled: bool = parameter(
        'Whether the head presses on the wall', default=False, live=True
    )
    force: float = parameter(
        'Desired force on the wall',
        default=30.0,
        unit='N',
        minimum=0.1,
        maximum=1000.0,
        live=True,
    )
    stiffness: float = parameter(
        'Stiffness of the brush, 600 N/m for a softer brush',
        default=600.0,
        unit='N/m',
        minimum=LEAST_STIFFNESS,
        maximum=1e6,
    )
    ramp_time: float = parameter(
        'Time in which the force rises from a tenth to its desired value',
        default=8.0,
        unit='s',
        minimum=0.5,
        maximum=120.0,
    )
    retreat: float = parameter(
        'Distance of the waiting head before the goal',
        default=0.05,
        unit='m',
        minimum=0.0,
        maximum=0.5,
    )
    range: float = parameter(
        'Maximum offset from the goal',
        default=0.08,
        unit='m',
        minimum=1e-4,
        maximum=0.5,
    )
    yaw_enabled: bool = parameter(
        'Whether the yaw of the head yields to the moment of the wall',
        default=False,
        live=True,
    )
    brush_width: float = parameter(
        'Width of the brush along the wall',
        default=0.3,
        unit='m',
        minimum=0.01,
        maximum=5.0,
    )
    brush_depth: float = parameter(
        'Distance of the wall from the head: lever of the friction',
        default=0.05,
        unit='m',
        minimum=0.0,
        maximum=1.0,
    )


@settings
class LateralSettings:
    """Settings of the lateral regulator."""

    enabled: bool = parameter(
        'Whether lateral_offset is regulated', default=False, live=True
    )


class PressMode(enum.Enum):
    """Phases of pressing on the wall, as messages."""

    OFF = 'not pressing'
    RETRACTED = 'retracted'
    SEARCHING = 'looking for the wall'
    RAISING = 'raising the force'
    HOLDING = 'holding the force'


IN_CONTACT = (PressMode.RAISING, PressMode.HOLDING)


class Surroundings(NamedTuple):
    """Inputs of the contact in addition to its measurements."""

    saturation_error: Pose = (
        ZERO_POSE  #: part removed at the workspace limit [m, m, rad]
    )
    rail_y: float = 0.0  #: disturbance in y that is corrected [m]
    silence: str = ''  #: reason why a disturbance that should be corrected is not
    beyond: float = 0.0  #: distance of the path past its goal, towards the wall [m]
    fading_y: float = 0.0  #: velocity of that disturbance by a fade alone [m/s]


class ForceLaw:
    """Force law of one axis: its offset, its measured force, and the offset at the measurement."""

    def __init__(self) -> None:
        self.offset = 0.0  #: last decided offset [m or rad]
        self.force = 0.0  #: force on the wall, low-pass [N or N m]
        self.offset_then = (
            0.0  #: offset when the force was measured, low-pass [m or rad]
        )
        self._stamp = -math.inf
        self._offsets: TimedBuffer[float, float] = TimedBuffer()

    def add_measurement(self, stamp: float, force: float) -> None:
        """Record a force [N or N m] measured at a stamp [s]."""
        share = _share(max(stamp - self._stamp, 0.0), FILTER_TIME)
        self._stamp = stamp
        self.force += share * (force - self.force)
        self.offset_then += share * (self._offset_at(stamp) - self.offset_then)

    def velocity(
        self, desired: float, stiffness: float, time: float, dead_band: float = 0.0
    ) -> float:
        """
        Return the velocity [m/s or rad/s] of the offset for a desired force at a time [s].

        An error within the dead band [N or N m] counts as zero.
        """
        delay = min(max(time - self._stamp, DELAYS[0]), DELAYS[1])
        error = desired - self.force - stiffness * (self.offset - self.offset_then)
        error -= min(max(error, -dead_band), dead_band)
        return error / (stiffness * TIME_CONSTANT * delay)

    def move(self, time: float, offset: float) -> None:
        """Set the offset [m or rad] for a time [s]."""
        self.offset = offset
        self._offsets.append(time, offset)

    def _offset_at(self, time: float) -> float:
        return _interpolate(self._offsets, time, self.offset)


class WallTracker:
    """
    Tracker of the wall's distance from the rail, by the force.

    The tracker is a steady-state Kalman-Bucy filter for a distance whose jerk is white noise. Its
    bandwidth ω grows with the third root of the stiffness k̂ of the brush, because the noise of
    the distance is that of F/k̂. The gains of the filter for distance, velocity and acceleration
    are 2 ω, 2 ω² and ω³. An interval T between measurements multiplies them by T.
    """

    def __init__(self) -> None:
        self._stamp = -math.inf
        self._distance = self._velocity = self._acceleration = 0.0
        self._places: TimedBuffer[float, float] = TimedBuffer()

    def note_place(self, time: float, place: float) -> None:
        """Record the head's distance from the rail at a time [s]: offset minus disturbance [m]."""
        self._places.append(time, place)

    def add_measurement(self, stamp: float, force: float, stiffness: float) -> None:
        """
        Update distance, velocity and acceleration of the wall by a force [N] at a stamp [s].

        The stiffness k̂ is that of the brush [N/m]. The first measurement, and one after a gap of
        `OLDEST_WRENCH`, only sets the distance.
        """
        measured = _interpolate(self._places, stamp, 0.0) - force / stiffness
        interval, self._stamp = stamp - self._stamp, stamp
        if not 0.0 < interval < OLDEST_WRENCH:
            self._distance, self._velocity, self._acceleration = measured, 0.0, 0.0
            return
        gain = (
            interval
            * TRACKING_BANDWIDTH
            * (stiffness / TRACKING_STIFFNESS) ** (1.0 / 3.0)
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
        """Return the expected distance of the wall [m] at a time [s]."""
        return self._distance + min(time - self._stamp, OLDEST_WRENCH) * self._velocity


class ForceRises:
    """
    RMS of the rises of a force above its mean, averaged like an oscillation.

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
        """Forget the rises, but not the mean."""
        self._variance = 0.0

    def add(self, interval: float, force: float, least: float) -> None:
        """Add a force [N] after an interval [s]; only rises above the least force count."""
        self.mean += _share(interval, self._mean_time) * (force - self.mean)
        rise = max(force - max(self.mean, least), 0.0)
        self._variance += _share(interval, self._memory) * (
            2.0 * rise**2 - self._variance
        )

    @property
    def rms(self) -> float:
        """Return the RMS [N] of an oscillation with these rises."""
        return math.sqrt(self._variance)


class ForceMonitor:
    """Monitor of reasons to leave the wall: excessive or unsteady force, a faulty sensor."""

    def __init__(self) -> None:
        self.stamp = -math.inf  #: of the last measurement [s]
        self.force = 0.0  #: last force on the wall [N]
        self._chatter = ForceRises(CHATTER_TIME, CHATTER_MEMORY)
        self._oscillation = ForceRises(OSCILLATION_TIME, OSCILLATION_TIME)
        self._demanded = 0.0
        self.begin()

    @property
    def mean(self) -> float:
        """Return the force without components faster than the loop [N]."""
        return self._chatter.mean

    def begin(self) -> None:
        """Forget previous faults before a new approach to the wall."""
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

        The demanded force [N] is that of the offset on a wall at the goal; only its changes count.
        A force far below the present desired force [N] is not chatter but a contact that returns.
        A first touch, and a slow rise to the final desired force [N], are not an oscillation.
        """
        interval = min(max(stamp - self.stamp, 0.0), OLDEST_WRENCH)
        self.stamp, self.force = stamp, force
        self._chatter.add(interval, force, RETURNED * desired)
        self._oscillation.add(interval, force, min(desired + TOUCH, final))
        self._demanded = demanded
        if not is_repeated:
            self._answered = demanded

    def fault(self, desired: float) -> str:
        """Return the fault of the contact for a final desired force [N]; empty without a fault."""
        limit = desired + _allowed_excess(desired)
        if self.force > limit:
            return (
                f'force on the wall = {self.force:.1f} N is above the limit {limit:.1f} N; '
                'next: use a softer brush'
            )
        unanswered = abs(self._demanded - self._answered)
        if unanswered > SIGNIFICANT:
            return (
                f'contact_wrench is frozen at {self.force:.1f} N while the demanded force '
                f'changes by {unanswered:.1f} N; next: check the force sensor'
            )
        chatter = self._chatter.rms
        oscillation = self._oscillation.rms
        bound = max(SIGNIFICANT, UNSTEADY_SHARE * desired)
        if chatter > bound:
            return (
                f'the force chatters by {chatter:.1f} N RMS, above the limit {bound:.1f} N; '
                'next: increase contact.stiffness or use a softer brush'
            )
        if oscillation > bound:
            return (
                f'the force oscillates by {oscillation:.1f} N RMS, above the limit '
                f'{bound:.1f} N; next: check the delay of contact_wrench and contact.stiffness'
            )
        if self.mean < -SIGNIFICANT:
            return (
                f'the wall pulls with {-self.mean:.1f} N; '
                'next: check sign and zero of contact_wrench'
            )
        return ''


class Pressing:
    """
    Pressing on the wall: approach, raise the force, hold it; retract with a reason.

    The head waits at the distance `retreat` before the goal and measures the zero of the sensor
    there. After a fault the head stays there until pressing is disabled and enabled again. After a
    silent sensor or a lost estimate, the head approaches the wall again without a request.
    """

    def __init__(self, settings: ContactSettings) -> None:
        self.settings = settings
        self.y, self.theta = ForceLaw(), ForceLaw()
        self._tracker = WallTracker()
        self._offset = self._change = (
            0.0  # of the law in y, and its change by the tracker [m]
        )
        self.absorbed = (
            0.0  #: shift that absorbs fades of the correction while pressing [m]
        )
        self._squared_error = 0.0  # of the force, averaged [N²]
        self._trust = 0.0  # share of the tracker's bound, from 0 to 1
        self._trust_time = TRUST_TIME  # s, of its rise
        self._held_for = 0.0  # s
        self._largest = 0.0  # squared error of the law alone, averaged [N²]
        self.monitor = ForceMonitor()
        self.mode = PressMode.OFF
        #: reason of the present wait off the wall, reason of the last retreat; empty for no reason
        self.reason = self.last_reason = ''
        self.desired = 0.0  #: present desired force [N]; 0 without contact
        self.zero = self.zero_moment = 0.0  #: readings off the wall [N, N m]
        self.moment = 0.0  #: last moment on the wall [N m]
        self._is_latched = False
        self._progress = self._untouched = 0.0  # progress of the ramp; s without touch
        self._free_from = math.inf  # time from which the head is off the wall [s]
        if settings.enabled:
            self.mode = PressMode.RETRACTED
            self._offset = self.y.offset = self.y.offset_then = -settings.retreat

    @property
    def outcome(self) -> str:
        """Return the phase of pressing on the wall, with the reason if the head does not press."""
        reason = self.reason or self._range_fault()
        return f'{self.mode.value}: {reason}' if reason else self.mode.value

    @property
    def is_hindered(self) -> bool:
        """Return whether the force is not reached without a change by the operator."""
        return self.reason not in ('', MEASURING_ZERO) or bool(self._range_fault())

    @property
    def bound(self) -> float:
        """Return the maximum error of a held force [N]."""
        return LEAST_BOUND + BOUND_SHARE * self.settings.force

    @property
    def is_held(self) -> bool:
        """Return whether the force is held, or no force is desired."""
        return not self.settings.enabled or (
            self.mode is PressMode.HOLDING
            and abs(self.monitor.mean - self.desired) <= self.bound
        )

    def add_measurement(
        self, stamp: float, force: float, moment: float, is_repeated: bool
    ) -> None:
        """
        Record the readings of force and moment on the wall [N, N m] at a stamp [s].

        While the head waits off the wall, they update the zeros of the sensor. The readings minus
        the zeros go to the force laws, the tracker and the monitor. `is_repeated` marks a wrench
        that is identical to the previous one.
        """
        if self.mode is PressMode.RETRACTED and stamp > self._free_from:
            share = _share(stamp - self.monitor.stamp, ZERO_TIME)
            self.zero += share * (force - self.zero)
            self.zero_moment += share * (moment - self.zero_moment)
        force, self.moment = force - self.zero, moment - self.zero_moment
        self.y.add_measurement(stamp, force)
        self._tracker.add_measurement(stamp, force, self.settings.stiffness)
        self.theta.add_measurement(stamp, self.moment)
        self.monitor.add(
            stamp,
            force,
            self.settings.stiffness * self.y.offset_then,
            self.desired,
            self.settings.force,
            is_repeated,
        )

    def step(
        self, now: float, time: float, interval: float, around: Surroundings
    ) -> None:
        """Move the offsets over an interval [s] to a later time [s]."""
        is_fresh = -FUTURE_TOLERANCE <= now - self.monitor.stamp <= OLDEST_WRENCH
        silence = (
            around.silence if is_fresh else f'no contact_wrench for {OLDEST_WRENCH:g} s'
        )
        if not self.settings.enabled:
            self._enter(PressMode.OFF)
            self._is_latched, self.reason, self._free_from = False, '', math.inf
            if not (self._offset or self._change or self.theta.offset or self.absorbed):
                return  # no offset remains; at 100 Hz this saves 0.3 % of a processor
        elif self.mode in (PressMode.OFF, PressMode.RETRACTED):
            self._wait(now, silence)
        elif fault := self.monitor.fault(self.settings.force):
            self._retract(fault, is_latched=True)
        elif silence:
            self._retract(silence)
        else:
            self._follow_touch(interval)
        self._absorb_fade(interval, around.fading_y)
        self._move_y(time, interval, around, is_fresh)
        self._move_theta(time, interval, around.saturation_error.theta, is_fresh)
        is_free = (
            self.mode is PressMode.RETRACTED
            and around.beyond <= NEAR_GOAL
            and self.y.offset <= -self.settings.retreat
        )
        self._free_from = min(self._free_from, time) if is_free else math.inf

    def _retract(self, reason: str, is_latched: bool = False) -> None:
        self.reason = self.last_reason = reason
        self._is_latched = is_latched
        self._enter(PressMode.RETRACTED)

    def _enter(self, mode: PressMode) -> None:
        self.mode, self._progress, self._untouched, self.desired = mode, 0.0, 0.0, 0.0

    def _wait(self, now: float, silence: str) -> None:
        """Wait off the wall until no reason remains, then approach the wall."""
        self.mode = PressMode.RETRACTED
        if not self._is_latched:
            self.reason = silence or self._zero_fault(now)
        if not self.reason:
            self.monitor.begin()
            self._enter(PressMode.SEARCHING)

    def _zero_fault(self, now: float) -> str:
        """Return why the zero of the sensor cannot be used; empty if it can."""
        if now < self._free_from + ZERO_WAIT:
            return MEASURING_ZERO
        return (
            ''
            if abs(self.zero) <= MOST_ZERO
            else (
                f'zero of the force = {self.zero:.1f} N is beyond {MOST_ZERO:g} N; '
                'next: tare the sensor'
            )
        )

    def _range_fault(self) -> str:
        """Return why the range of the offset does not suffice; empty while it does."""
        limit = f'{1e3 * self.settings.range:g} mm (contact.range) beyond the goal'
        if self._offset < self.settings.range or self.is_held:
            return ''
        if self.mode is PressMode.SEARCHING:
            return (
                f'no wall within {limit}, so that the place of the wall is unknown; '
                'next: send a goal on the wall'
            )
        if self.mode in IN_CONTACT:
            return (
                f'the force needs an offset above {limit}; '
                'next: send a goal nearer to the wall'
            )
        return ''

    def _follow_touch(self, interval: float) -> None:
        """Raise the force after a touch; approach the wall again after a loss of touch."""
        is_touching = self.y.force > min(
            TOUCH, 0.5 * (self.desired or self.settings.force)
        )
        self._untouched = 0.0 if is_touching else self._untouched + interval
        if self.mode is PressMode.SEARCHING and is_touching:
            self._enter(PressMode.RAISING)
        elif self.mode in IN_CONTACT and self._untouched > LOST_AFTER:
            self._enter(PressMode.SEARCHING)
        elif self.mode is PressMode.RAISING:
            self._progress += interval / self.settings.ramp_time
            if self._progress >= 1.0:
                self.mode = PressMode.HOLDING

    def _velocity(self, time: float, is_fresh: bool) -> float:
        """Return the velocity of the offset in y [m/s]."""
        force = self.settings.force
        if self.mode is PressMode.SEARCHING:
            return APPROACH_SPEED if is_fresh else 0.0
        share = min(self._progress, 1.0) if self.mode is PressMode.RAISING else 1.0
        ramp = 0.5 - 0.5 * math.cos(math.pi * share)
        self.desired = force * (FIRST_SHARE + (1.0 - FIRST_SHARE) * ramp)
        velocity = self.y.velocity(self.desired, self.settings.stiffness, time)
        limit = _allowed_excess(force) / (self.settings.stiffness * RISE_TIME)
        return min(max(velocity, -SPEED), SPEED, limit)

    def _move_y(
        self, time: float, interval: float, around: Surroundings, is_fresh: bool
    ) -> None:
        settings, before = self.settings, self._offset
        if self.mode in (PressMode.OFF, PressMode.RETRACTED):
            target = min(before, -settings.retreat) if settings.enabled else 0.0
            moved = _towards(before, target, SPEED * interval)
        else:
            moved = before + interval * self._velocity(time, is_fresh)
            moved = min(
                max(moved, -max(settings.retreat, settings.range)), settings.range
            )
        # At the workspace limit the offset moves only back inside: no wind-up.
        if around.saturation_error.y * (moved - before) <= 0.0:
            self._offset = moved
        self._trust_tracker(interval)
        change, rail_y = 0.0, around.rail_y - self.absorbed
        if self.mode is PressMode.HOLDING and is_fresh:
            distance = self._tracker.distance(time) + self.desired / settings.stiffness
            tracked, bound = distance + rail_y, self._trust * TRACKING_BOUND
            change = min(max(tracked - self._offset, -bound), bound)
        self._change = _towards(self._change, change, SPEED * interval)
        self.y.move(time, self._offset + self._change)
        self._tracker.note_place(time, self.y.offset - rail_y)

    def _absorb_fade(self, interval: float, fading: float) -> None:
        """Keep a fade of the correction [m/s] from moving the head on the wall."""
        if self.mode in (PressMode.OFF, PressMode.RETRACTED):
            self.absorbed = _towards(self.absorbed, 0.0, SPEED * interval)
            return
        largest, absorbed = self.settings.range, self.absorbed + interval * fading
        self.absorbed = min(max(absorbed, -largest), largest)

    def _trust_tracker(self, interval: float) -> None:
        """Increase the trust in the tracker while the force is held well, else decrease it."""
        force = self.settings.force
        if self.mode is not PressMode.HOLDING:
            self._squared_error = self._trust = self._held_for = 0.0
            self._largest = max(WELL_HELD * force, TOUCH) ** 2
            self._trust_time = TRUST_TIME
            return
        error = self.y.force - self.desired
        self._squared_error += _share(interval, DISTRUST_TIME) * (
            error**2 - self._squared_error
        )
        self._held_for += interval
        if self._held_for < TRIAL_TIME:
            largest = max(self._largest, self._squared_error)
            self._largest = min(largest, max(BADLY_HELD * force, TOUCH) ** 2)
        elif self._squared_error <= self._largest:
            self._trust = min(self._trust + interval / self._trust_time, 1.0)
        elif self._trust > 0.0:
            self._trust = max(self._trust - interval / DISTRUST_TIME, 0.0)
            if self._trust == 0.0:
                self._trust_time *= 2.0

    def _move_theta(
        self, time: float, interval: float, saturation_error: float, is_fresh: bool
    ) -> None:
        settings, before = self.settings, self.theta.offset
        limit = YAW_SPEED * interval
        moved = _towards(before, 0.0, limit)
        if settings.yaw_enabled and is_fresh and self.mode in IN_CONTACT:
            stiffness = 0.25 * self.settings.stiffness * settings.brush_width**2
            dead_band = FRICTION * settings.force * settings.brush_depth
            change = interval * self.theta.velocity(0.0, stiffness, time, dead_band)
            wanted = min(max(before + change, -YAW_RANGE), YAW_RANGE)
            moved = _towards(before, wanted, limit)
        is_blocked = saturation_error * (moved - before) > 0.0
        self.theta.move(time, before if is_blocked else moved)


class Contact:
    """
    Contact: the measured force, moment and lateral offset shift the goal on the wall.

    The lateral offset is regulated to zero by an integral regulator without wind-up. It corrects
    errors that the prediction cannot contain: slip of the head, drift of the estimator.

    References
    ----------
    Park et al., conclusion: the lateral disturbance compensated by a conventional regulator.

    """

    def __init__(self, press: ContactSettings, lateral: LateralSettings) -> None:
        self.pressing = Pressing(press)
        self.lateral = lateral
        self.yaw = (
            0.0  #: yaw of the head on the wall [rad], which turns measured forces
        )
        self._shift = 0.0  # along the wall [m]
        self._lateral_offset = -math.inf, 0.0  # s, m
        self._stamps: dict[str, float] = {}
        self._wrench: Wrench | None = None

    @property
    def present(self) -> Pose:
        """Return the present shift of the goal [m, m, rad]."""
        pressing = self.pressing
        y = pressing.y.offset + pressing.absorbed
        return Pose(self._shift, y, pressing.theta.offset)

    def add_wrench(self, now: float, stamp: float, wrench: Wrench) -> None:
        """
        Record a wrench of the wall on the head, in the head's frame, measured at a stamp [s].

        Raises an InputError if it is not finite, stale, from the future or out of order.
        """
        self._check('contact_wrench', now, stamp, OLDEST_WRENCH, wrench)
        force = -(math.sin(self.yaw) * wrench.fx + math.cos(self.yaw) * wrench.fy)
        self.pressing.add_measurement(stamp, force, -wrench.mz, wrench == self._wrench)
        self._wrench = wrench

    def add_lateral_offset(self, now: float, stamp: float, offset: float) -> None:
        """
        Store the measured lateral offset: the head's missing motion along the wall [m].

        Raises an InputError if it is not finite, stale, from the future or out of order.
        """
        self._check('lateral_offset', now, stamp, OLDEST_OFFSET, (offset,))
        self._lateral_offset = stamp, offset

    def shift(
        self,
        now: float,
        time: float,
        interval: float,
        reference: Pose,
        around: Surroundings,
    ) -> Pose:
        """
        Return the reference with the shift of the contact [m, m, rad].

        The reference is that of the time at which the head reaches it [s], an interval [s] after
        the previous time.
        """
        stamp, offset = self._lateral_offset
        if self.lateral.enabled and -FUTURE_TOLERANCE <= now - stamp <= OLDEST_OFFSET:
            limit = LATERAL_SPEED * interval
            step = min(max(LATERAL_GAIN * interval * offset, -limit), limit)
            if around.saturation_error.x * step <= 0.0:
                self._shift = min(
                    max(self._shift + step, -LATERAL_RANGE), LATERAL_RANGE
                )
        self.pressing.step(now, time, interval, around)
        shifted = add(reference, self.present)
        self.yaw = shifted.theta
        return shifted

    def _check(
        self,
        quantity: str,
        now: float,
        stamp: float,
        oldest: float,
        values: Iterable[float],
    ) -> None:
        for value in values:
            if not math.isfinite(value):
                raise InputError.not_finite(quantity, value)
        require_recent(quantity, now - stamp, oldest, FUTURE_TOLERANCE)
        lateness = self._stamps.get(quantity, -math.inf) - stamp
        if 0.0 <= lateness <= KEPT_TIME:
            raise InputError.out_of_order(quantity, lateness)
        self._stamps[quantity] = stamp


def _allowed_excess(desired: float) -> float:
    """Return the excess of the force limit over a final desired force [N]."""
    return max(MOST_EXCESS * desired, LEAST_EXCESS)


def _interpolate(
    values: TimedBuffer[float, float], time: float, default: float
) -> float:
    before, after = values.around(time)
    if before is None or after is None:
        return (before or after or (time, default))[1]
    (begin, a), (end, b) = before, after
    return a + (b - a) * (time - begin) / (end - begin)


def _share(interval: float, time_constant: float) -> float:
    return 1.0 - math.exp(-interval / time_constant)


def _towards(value: float, target: float, limit: float) -> float:
    step = target - value
    return target if abs(step) <= limit else value + math.copysign(limit, step)

"""
Phases of pressing on the wall: approach, raise the force, hold it, retract.

`contact_force.py` contains the law of the force, `contact_faults.py` the reasons to retract.
"""

from __future__ import annotations

import enum
import math
from typing import NamedTuple

from facade_manipulator.compensation.contact_faults import (
    ForceMonitor,
    MEASURING_ZERO,
    SensorZero,
)
from facade_manipulator.compensation.contact_force import (
    allowed_excess,
    ForceLaw,
    NormalForce,
    OLDEST_WRENCH,
    SPEED,
    TOUCH,
    towards,
)
from facade_manipulator.kinematics import Pose, ZERO_POSE
from facade_manipulator.parameters import parameter, settings
from facade_manipulator.rejections import Rejections

CONTACT_CLOCK_TOLERANCE = 0.02  # s


@settings
class ContactSettings:
    """Settings of the force on the wall, and of the brush between head and wall."""

    # N/m; with a softer brush, its damping of 25 N s/m makes the law oscillate
    LEAST_STIFFNESS = 600.0

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
        'Stiffness of the brush; 600 N/m also for a softer brush',
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
        'Distance in front of the goal at which the head waits',
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
        'Distance of the wall from the head: lever arm of the friction',
        default=0.05,
        unit='m',
        minimum=0.0,
        maximum=1.0,
    )


class PressMode(enum.Enum):
    """Phases of pressing on the wall; the values are used in messages."""

    OFF = 'not pressing'
    RETRACTED = 'retracted'
    SEARCHING = 'looking for the wall'
    RAISING = 'raising the force'
    HOLDING = 'holding the force'


class Surroundings(NamedTuple):
    """Inputs of the contact other than its measurements."""

    saturation_error: Pose = (
        ZERO_POSE  #: part removed at the workspace limit [m, m, rad]
    )
    rail_y: float = 0.0  #: disturbance in y that is corrected [m]
    silence: str = ''  #: reason why a disturbance that should be corrected is not
    beyond: float = 0.0  #: distance of the path past its goal, towards the wall [m]
    fading_y: float = 0.0  #: velocity of `rail_y` due to fades only [m/s]


class ForceRamp:
    """Ramp of the desired force after the head has touched the wall, with the untouched time."""

    FALL_TIME = 1.5  # s in which a lowered force falls by the excess of its limit
    FIRST_SHARE = 0.1  # share of the desired force at the beginning of the ramp
    LOST_AFTER = 1.0  # s without touch, after which the head approaches the wall again

    def __init__(self) -> None:
        self.desired = 0.0  #: [N]; 0 without contact
        self._first = 0.0  # at the beginning of the rise [N]
        self._final = 0.0  # final desired force of the rise [N]; 0 before the rise
        self._progress = 0.0  # of the rise, from 0 to 1
        self._untouched = 0.0  # s

    def restart(self) -> None:
        """Reset the desired force to zero before another phase."""
        self.desired = 0.0
        self._final = 0.0
        self._progress = 0.0
        self._untouched = 0.0

    def is_touching(self, force: float, final: float) -> bool:
        """Return whether a force [N] counts as touch, for a final desired force [N]."""
        return force > min(TOUCH, 0.5 * (self.desired or final))

    def note_touch(self, interval: float, is_touching: bool) -> None:
        """Record whether the head touches the wall during an interval [s]."""
        self._untouched = 0.0 if is_touching else self._untouched + interval

    @property
    def is_touch_lost(self) -> bool:
        """Return whether the head has not touched the wall for `LOST_AFTER`."""
        return self._untouched > self.LOST_AFTER

    def follow(self, final: float) -> bool:
        """
        Begin a rise if the final force [N] is new or raised; return whether it begins.

        A lowered force needs no rise: `update` lets it fall.
        """
        is_raised = final > self._final
        if is_raised:
            self._first = self.desired or self.FIRST_SHARE * final
            self._progress = 0.0
        self._final = final
        return is_raised

    def advance(self, interval: float, ramp_time: float) -> bool:
        """Advance a ramp of a given duration by an interval [s]; return whether it is complete."""
        self._progress += interval / ramp_time
        return self._progress >= 1.0

    def update(self, interval: float, final: float, is_raising: bool) -> float:
        """
        Return the current desired force [N] on its way to the final desired force [N].

        After the operator has lowered the final force, the desired force falls over intervals [s]
        so slowly that the force on the wall follows it.
        """
        share = min(self._progress, 1.0) if is_raising else 1.0
        ramp = 0.5 - 0.5 * math.cos(math.pi * share)
        raised = self._first + (final - self._first) * ramp
        fall = interval * allowed_excess(final) / self.FALL_TIME
        self.desired = max(raised, self.desired - fall)
        return self.desired


class Pressing:
    """
    Pressing on the wall: approach, raise the force, hold it, or retract for a reason.

    The head waits at the distance `retreat` before the goal and measures the zero of the sensor
    there. After a fault the head stays at this distance until pressing is disabled and enabled
    again, and a new goal follows. After a silent sensor or a lost estimate, the head approaches
    the wall again without a request. After pressing is disabled or ended, the head stays at this
    distance until the next goal. The owner calls `change_settings` for changed live parameters,
    `follow_goal` for each new goal, and `end` when a goal is no longer followed.
    """

    NEAR_GOAL = 0.005  # m, maximum distance of the path past its goal
    APPROACH_SPEED = 0.004  # m/s; touches a wall of 100 N/mm with 28 N
    YAW_SPEED = 0.25  # rad/s
    YAW_RANGE = 0.12  # rad
    FRICTION = 0.3  # coefficient of friction of brushes on a wall
    LEAST_BOUND = 2.0  # N, of the error of a held force
    BOUND_SHARE = 0.1  # of the desired force, added to it
    IN_CONTACT = (PressMode.RAISING, PressMode.HOLDING)

    def __init__(self, settings: ContactSettings) -> None:
        self.settings = settings
        self.mode = PressMode.OFF
        self.normal = NormalForce()
        self.theta = ForceLaw()
        self.ramp = ForceRamp()
        self.monitor = ForceMonitor()
        self.sensor_zero = SensorZero()
        self.rejections = Rejections()  #: of the wrenches
        self.moment = 0.0  #: last measured moment on the wall [N m]
        #: reason of the present wait off the wall; empty without a wait
        self.reason = ''
        #: reason of the last retreat; empty before the first
        self.last_reason = ''
        # whether the head presses at its present goal
        self._is_active = settings.enabled
        self._is_latched = False  # whether the wait lasts until pressing is disabled
        #: offset of the head off the wall [m], below 0 from pressing until the next goal
        self._rest = 0.0
        if settings.enabled:
            self.mode = PressMode.RETRACTED
            # the head moves to its first goal off the wall; an offset below 0 is off the wall
            self._rest = -settings.retreat
            self.normal.begin(self._rest)

    @property
    def desired(self) -> float:
        """Return the current desired force [N]; 0 without contact."""
        return self.ramp.desired

    @property
    def distance_at_rest(self) -> float:
        """Return the distance before the goal at which the head waits without pressing [m]."""
        return -self._rest

    @property
    def zero(self) -> float:
        """Return the zero of the force sensor [N]."""
        return self.sensor_zero.force

    @property
    def outcome(self) -> str:
        """Return the phase of pressing, with a reason if the head does not press."""
        reason = self.reason or self._range_fault()
        if not reason and self.settings.enabled and not self._is_active:
            reason = 'the head presses from its next goal on; next: send a goal'
        return f'{self.mode.value}: {reason}' if reason else self.mode.value

    @property
    def is_hindered(self) -> bool:
        """Return whether the operator must act before the force can be reached."""
        return self.reason not in ('', MEASURING_ZERO) or bool(self._range_fault())

    @property
    def bound(self) -> float:
        """Return the maximum permitted error of a held force [N]."""
        return self.LEAST_BOUND + self.BOUND_SHARE * self.settings.force

    @property
    def is_force_reached(self) -> bool:
        """Return whether the desired force is reached and held, or the goal needs no force."""
        return not (self.settings.enabled and self._is_active) or (
            self.mode is PressMode.HOLDING
            and abs(self.monitor.mean - self.settings.force) <= self.bound
        )

    def add_measurement(
        self, stamp: float, force: float, moment: float, is_repeated: bool
    ) -> None:
        """
        Record measured force and moment on the wall [N, N m] at a stamp [s].

        While the head waits off the wall, the readings update the zeros of the sensor. The
        readings minus the zeros go to the force laws, the tracker and the monitor. `is_repeated`
        marks a wrench that is identical to the previous one.
        """
        self.rejections.clear()
        if self.mode is PressMode.RETRACTED:
            interval = stamp - self.monitor.stamp
            self.sensor_zero.add_measurement(stamp, interval, force, moment)
        force -= self.sensor_zero.force
        moment -= self.sensor_zero.moment
        self.normal.add_measurement(stamp, force, self.settings.stiffness)
        self.theta.add_measurement(stamp, moment)
        demanded = self.settings.stiffness * self.normal.law.measured_offset
        self.moment = moment
        self.monitor.add(
            stamp, force, demanded, self.desired, self.settings.force, is_repeated
        )

    def change_settings(self, settings: ContactSettings) -> None:
        """
        Change the live parameters; disabling ends pressing and clears the fault.

        The fault is cleared at once, because `step` is not called without a goal, and pressing may
        be enabled again before the next cycle.
        """
        self.settings = settings
        if not settings.enabled:
            self._is_latched = False
            self.end()

    def follow_goal(self) -> None:
        """
        Press at a new goal if pressing is enabled, and continue to press after another goal.

        Otherwise the offset changes at once, and the path to the goal must begin at the pose of
        the head.
        """
        if self.settings.enabled and self._is_active:
            return
        self._is_active = self.settings.enabled
        self._rest = 0.0
        mode = PressMode.OFF
        if self._is_active:
            self._rest = -self.settings.retreat
            mode = PressMode.RETRACTED
        self._enter(mode)
        self.normal.begin(self._rest)

    def end(self) -> None:
        """Stop pressing until the next goal, and leave the wall. A fault stays latched."""
        self._is_active = False
        self._enter(PressMode.OFF)
        if not self._is_latched:
            self.reason = ''

    def step(
        self, now: float, time: float, interval: float, around: Surroundings
    ) -> None:
        """Move the offsets over an interval [s] to a later time [s]."""
        is_fresh = -CONTACT_CLOCK_TOLERANCE <= now - self.monitor.stamp <= OLDEST_WRENCH
        if not self._is_active:
            self.sensor_zero.note_place(time, is_free=False)
            if self.normal.is_at_goal and not self.theta.offset:
                return  # no offset remains; at 100 Hz this saves 0.3 % of a processor
        else:
            silence = around.silence if is_fresh else self._wrench_silence(now)
            self._choose_phase(now, interval, silence)
        if self._is_off_wall:
            self.normal.release_fade(interval)
        else:
            self.normal.absorb_fade(interval, around.fading_y, self.settings.range)
        self._move_y(time, interval, around, is_fresh)
        self._move_theta(time, interval, around.saturation_error.theta, is_fresh)
        is_free = (
            self.mode is PressMode.RETRACTED
            and around.beyond <= self.NEAR_GOAL
            and self.normal.law.total <= -self.settings.retreat
        )
        self.sensor_zero.note_place(time, is_free)

    @property
    def _is_off_wall(self) -> bool:
        return self.mode in (PressMode.OFF, PressMode.RETRACTED)

    def _choose_phase(self, now: float, interval: float, silence: str) -> None:
        """Choose to wait, retract or follow the touch; `silence` explains a missing input."""
        if self._is_off_wall:
            self._wait(now, silence)
            return
        fault = self.monitor.fault(max(self.settings.force, self.desired))
        if fault:
            self._retract(fault, is_latched=True)
        elif silence:
            self._retract(silence)
        elif self.mode is PressMode.SEARCHING and self._is_at_range:
            # A dead sensor reads no force either, so the head may press with the whole range.
            self._retract(
                f'no wall within {self._range_text}: force on the wall = '
                f'{self.monitor.force:.1f} N; next: check the force sensor and the place '
                'of the wall',
                is_latched=True,
            )
        else:
            self._follow_touch(interval)

    def _retract(self, reason: str, is_latched: bool = False) -> None:
        """Leave the wall for a reason; if it is latched, until pressing is switched off and on."""
        self.reason = reason
        self.last_reason = reason
        self._is_latched = is_latched
        self._enter(PressMode.RETRACTED)

    def _enter(self, mode: PressMode) -> None:
        """Begin a phase with a desired force of zero."""
        self.mode = mode
        self.ramp.restart()

    def _wrench_silence(self, now: float) -> str:
        """Return why no fresh contact_wrench is received at a time [s], with the next step."""
        if rejection := self.rejections.message(now):
            return f'no valid contact_wrench for {OLDEST_WRENCH:g} s: {rejection}'
        return (
            f'no contact_wrench for {OLDEST_WRENCH:g} s; next: check the force sensor'
        )

    def _wait(self, now: float, silence: str) -> None:
        """Wait off the wall until there is no reason to wait, then approach the wall."""
        self.mode = PressMode.RETRACTED
        if not self._is_latched:
            self.reason = silence or self.sensor_zero.fault(now)
        if not self.reason:
            self.monitor.begin()
            self._enter(PressMode.SEARCHING)

    @property
    def _is_at_range(self) -> bool:
        return self.normal.law.offset >= self.settings.range

    @property
    def _range_text(self) -> str:
        return f'{1e3 * self.settings.range:g} mm (contact.range) beyond the goal'

    def _range_fault(self) -> str:
        """Return why the range of the offset is too small; empty if it is sufficient."""
        is_short = self.mode in self.IN_CONTACT and self._is_at_range
        if not is_short or self.is_force_reached:
            return ''
        return (
            f'the force needs an offset above {self._range_text}; '
            'next: send a goal nearer to the wall'
        )

    def _follow_touch(self, interval: float) -> None:
        """Raise the force over an interval [s] after a touch; approach again without touch."""
        ramp = self.ramp
        is_touching = ramp.is_touching(self.normal.law.force, self.settings.force)
        ramp.note_touch(interval, is_touching)
        if self.mode is PressMode.SEARCHING and is_touching:
            self._enter(PressMode.RAISING)
            ramp.follow(self.settings.force)
        elif self.mode in self.IN_CONTACT and ramp.is_touch_lost:
            self._enter(PressMode.SEARCHING)
        elif self.mode in self.IN_CONTACT and ramp.follow(self.settings.force):
            self.mode = PressMode.RAISING
        elif self.mode is PressMode.RAISING:
            if ramp.advance(interval, self.settings.ramp_time):
                self.mode = PressMode.HOLDING

    def _velocity(self, time: float, interval: float, is_fresh: bool) -> float:
        """Return the velocity of the offset in y [m/s]."""
        if self.mode is PressMode.SEARCHING:
            return self.APPROACH_SPEED if is_fresh else 0.0
        force = self.settings.force
        is_raising = self.mode is PressMode.RAISING
        desired = self.ramp.update(interval, force, is_raising)
        return self.normal.velocity(desired, force, self.settings.stiffness, time)

    def _wanted_y(self, time: float, interval: float, is_fresh: bool) -> float:
        """Return the next offset in y [m] for the current phase."""
        settings = self.settings
        before = self.normal.law.offset
        if self._is_off_wall:
            # The goal of a pressing head may be behind the wall, so the head never moves towards
            # it.
            return towards(before, min(before, self._rest), SPEED * interval)
        wanted = before + interval * self._velocity(time, interval, is_fresh)
        least = -max(settings.retreat, settings.range)
        return min(max(wanted, least), settings.range)

    def _move_y(
        self, time: float, interval: float, around: Surroundings, is_fresh: bool
    ) -> None:
        """Move the offset in y over an interval [s] to a time [s]."""
        normal = self.normal
        before = normal.law.offset
        offset = self._wanted_y(time, interval, is_fresh)
        # At the workspace limit the offset moves only back inside: no wind-up.
        if around.saturation_error.y * (offset - before) > 0.0:
            offset = before
        compression = None
        if self.mode is PressMode.HOLDING:
            error = normal.law.force - self.desired
            normal.trust.update(interval, error, self.settings.force)
            if is_fresh:
                compression = self.desired / self.settings.stiffness
        else:
            normal.trust.reset(self.settings.force)
        normal.move(time, interval, offset, around.rail_y, compression)

    def _move_theta(
        self, time: float, interval: float, saturation_error: float, is_fresh: bool
    ) -> None:
        """
        Move the offset in yaw over an interval [s] to a time [s].

        Without contact or fresh measurements, it returns to 0.
        """
        settings = self.settings
        before = self.theta.offset
        limit = self.YAW_SPEED * interval
        moved = towards(before, 0.0, limit)
        if settings.yaw_enabled and is_fresh and self.mode in self.IN_CONTACT:
            stiffness = 0.25 * settings.stiffness * settings.brush_width**2
            dead_band = self.FRICTION * settings.force * settings.brush_depth
            change = interval * self.theta.velocity(0.0, stiffness, time, dead_band)
            wanted = min(max(before + change, -self.YAW_RANGE), self.YAW_RANGE)
            moved = towards(before, wanted, limit)
        is_blocked = saturation_error * (moved - before) > 0.0
        self.theta.move(time, before if is_blocked else moved)

"""
Press on the wall: look for it slowly, raise the force, hold it; retract with a reason.

The head waits a retreat before the goal, where the zero of the sensor is taken. Then it looks for
the wall at a speed at which even a stiff one is touched gently, and comes faster where it has been
touched before. The force rises from a tenth to the desired one while the stiffness of the contact
is learnt, and faster once that is known. What is wrong with the sensor or the contact makes the
head retract until pressing is switched off and on; after what has another cause it begins again.
"""

from __future__ import annotations

import enum
import math
from typing import NamedTuple

from facade_manipulator.compensation.force_watch import (
    ForceWatch,
    HOLD_TIME,
    LatencyCheck,
    MOST_LATENCY,
    NOISE,
    OLDEST_WRENCH,
    TOUCH,
)
from facade_manipulator.compensation.impedance import (
    ContactStiffness,
    ForceLaw,
    ImpedanceSettings,
    LATENCY,
    LEARNING_RAMP,
    LEAST_STIFFNESS,
    YawImpedanceSettings,
)
from facade_manipulator.compensation.sensor_zero import MOST_DRIFT, SensorZero
from facade_manipulator.compensation.suspension import SwayWatch
from facade_manipulator.compensation.wall_sense import Deflection
from facade_manipulator.kinematics import Pose, ZERO_POSE
from facade_manipulator.motion.timed_buffer import TimedBuffer

FIRST_SHARE = 0.1  # of the desired force, with which the ramp begins
LOST_AFTER = 1.0  # s without touch, after which the wall is looked for again
TOUCH_SHARE = 0.25  # of the desired force, by which a touch in search of the wall may miss it
LEAST_ERROR = 2.0  # N, RMS that counts as not held, and of the desired force:
RISING_ERROR, HOLDING_ERROR = 0.5, 0.1  # of the force, while it rises and once it holds
NEAR = 0.005  # m, by which the path may end beyond its goal
AT_WALL = 0.002  # m before where the wall was: more than what is left of the sway, 1.4 mm
BRAKING = 0.1  # s, from a distance to the speed of its approach: longer than the latency
KNOWN_RAMP = 1.2  # s, where the stiffness is known: with approach and touch 4 s in all
CREEP_PAUSE = 600.0  # s between two retreats for which a creeping offset is the reason


class PressMode(enum.Enum):
    """What the head does on the wall, as a message."""

    OFF = 'not pressing'
    RETRACTED = 'retracted'
    SEARCHING = 'looking for the wall'
    RAISING = 'raising the force'
    HOLDING = 'holding the force'


IN_CONTACT = (PressMode.RAISING, PressMode.HOLDING)


class Surroundings(NamedTuple):
    """What pressing depends on beside the wrench."""

    place: float = 0.0  #: where the head should be without its offset, y in frame facade [m]
    saturation_error: Pose = ZERO_POSE  #: by how much each axis is held back at the workspace
    rail: Pose = ZERO_POSE  #: disturbance of the gondola
    silence: str = ''  #: why the disturbance is not corrected though it should be
    held_back: str = ''  #: what holds the head back in y
    beyond: float = 0.0  #: how much nearer to the wall the path still is than its goal [m]


class Pressing:
    """The offsets of y and θ that press on the wall."""

    def __init__(self, press: ImpedanceSettings, turn: YawImpedanceSettings) -> None:
        self.press = press
        self.turn = turn
        self.y, self.theta = ForceLaw(), ForceLaw()  #: the axes
        self.stiffness = ContactStiffness(press.contact_stiffness)
        self.watch = ForceWatch()  #: finds what is wrong and keeps the figures
        #: finds a force that is late with fresh stamps, or whose zero drifts
        self.latency = LatencyCheck()
        self.zero = SensorZero()  #: what is measured off the wall
        #: where the wall was touched, y in frame facade [m]; None where that is not known
        self.wall: float | None = None
        self.mode = PressMode.OFF
        #: why the head waits off the wall now and was retracted last; empty for nothing
        self.reason = self.last_reason = ''
        self.desired = 0.0  #: force of the moment [N], 0 without contact
        self._felt: TimedBuffer[tuple[float, float]] = TimedBuffer()  # force, moment
        self._latched = False
        self._progress = 0.0
        self._untouched = 0.0
        self._is_blocked = False
        self._place = 0.0  # of the head
        self._free_from = math.inf  # when the head was back off the wall
        self._same_at = 0.0  # offset at which the wrench last changed
        self._has_changed = False
        self._held_back, self._held_back_until = '', -math.inf
        self._crept_at = -math.inf
        self.sway = SwayWatch()  #: how the gondola takes it
        if press.enabled:
            self.mode = PressMode.RETRACTED
            self.y.begin(-press.retreat)

    @property
    def idle(self) -> bool:
        """Whether nothing changes without a step: switched off and back at the goal."""
        return not (self.press.enabled or self.turn.enabled) and (
            self.mode is PressMode.OFF and self.y.offset == 0.0 == self.theta.offset)

    @property
    def outcome(self) -> str:
        """What the head does on the wall, and why it does not press."""
        return f'{self.mode.value}: {self.reason}' if self.reason else self.mode.value

    @property
    def bound(self) -> float:
        """By how much the force may miss the desired one while it is held [N]."""
        return LEAST_ERROR + HOLDING_ERROR * self.press.force

    @property
    def is_held(self) -> bool:
        """Whether nothing is to be pressed, or the force is held."""
        return not self.press.enabled or (
            self.mode is PressMode.HOLDING and abs(self.watch.low - self.desired) <= self.bound)

    @property
    def is_holding(self) -> bool:
        """Whether the head presses, so that the wall says where the gondola is."""
        return self.mode is PressMode.HOLDING

    def add_measurement(
        self, stamp: float, force: float, moment: float, is_repeated: bool
    ) -> None:
        """
        Learn from a measurement.

        Of force and moment on the wall, as the sensor has them [N, N m], at a stamp [s]; repeated
        is a wrench that is to the last digit the one before.
        """
        self._has_changed |= not is_repeated
        if self.mode is PressMode.RETRACTED and stamp >= self._free_from:
            self.zero.add(stamp, force, moment)
        self.y.add_measurement(stamp, force - self.zero.force)
        self.theta.add_measurement(stamp, moment - self.zero.moment)
        self._felt.append(stamp, (self.y.measured, self.theta.measured))
        if self.press.enabled or self.turn.enabled:
            self.watch.add(stamp, self.y.measured, self.desired, self.stiffness.value,
                           self._unanswered(is_repeated))
        if self.mode is not PressMode.RETRACTED and self.stiffness.add(
                stamp, self.y.force, self.y.offset_then):
            self.latency.forget_stiffness()
        if self.mode is PressMode.HOLDING:
            self.latency.add(stamp, self.y.force, self.y.offset_then)
            self.stiffness.limit(self.latency.stiffness)

    def deflection(self, stamp: float) -> Deflection | None:
        """Return how the wall was pressed in at a stamp [s]; None where that is not known."""
        before, after = self._felt.around(stamp)
        if not self.is_holding or before is None or after is None:
            return None
        (begin, first), (end, second) = before, after
        share = (stamp - begin) / (end - begin)
        force, moment = (a + share * (b - a) for a, b in zip(first, second, strict=True))
        if end - begin > OLDEST_WRENCH or force < TOUCH:
            return None
        stiffness, arm = self.stiffness.likely, 0.5 * self.press.brush_width
        return Deflection(
            force / stiffness, moment / (stiffness * arm * arm), NOISE / stiffness,
            NOISE / (stiffness * arm) if self.turn.enabled else math.inf)

    def _unanswered(self, is_repeated: bool) -> float:
        """Return by how much the force should have changed since the wrench last did [N]."""
        offset, is_beyond = self.y.offset_then, self.wall is not None and self._place > self.wall
        if not is_repeated or not (self.mode in IN_CONTACT or is_beyond):
            self._same_at = offset
        stiffness = LEAST_STIFFNESS
        if self.mode is PressMode.HOLDING:
            stiffness = self.stiffness.value
        return stiffness * abs(offset - self._same_at)

    def step(self, now: float, time: float, interval: float, around: Surroundings) -> None:
        """Move the offsets on, over an interval [s] to a time at present."""
        self.sway.note(interval, around.rail, self.mode in IN_CONTACT)
        if around.held_back:
            self._held_back, self._held_back_until = around.held_back, now + HOLD_TIME
        self._place = around.place + self.y.offset
        fresh = now - self.watch.stamp <= OLDEST_WRENCH
        self._change_mode(now, fresh, interval, around.silence)
        self._move_y(time, interval, around.saturation_error.y, fresh)
        if self.mode is PressMode.RETRACTED:
            self._look_whether_free(time, around.beyond)
        self._move_theta(time, interval, around.saturation_error.theta, fresh)

    def _change_mode(self, now: float, fresh: bool, interval: float, silence: str) -> None:
        if not self.press.enabled:
            self._switch_off()
            return
        if self.mode is PressMode.OFF:
            self._enter(PressMode.RETRACTED)
        retracted = self.mode is PressMode.RETRACTED
        if fault := '' if retracted else self._fault():
            self._retract(fault, latched=True)
        elif reason := self._why_wait(now, fresh, silence):
            self._retract(reason, latched=False)
        elif missed := '' if retracted else self._not_held():
            first = f'{self._held_back}: ' if now < self._held_back_until else ''
            self._retract(first + missed, latched=not first)
        elif retracted:
            self._leave_retreat()
        else:
            self._look_for_touch(interval)

    def _fault(self) -> str:
        """Return what is wrong with the measurements."""
        if self.latency.latency > MOST_LATENCY:
            return (f'contact_wrench answers at least {self.latency.latency:.2f} s late, bound '
                    f'{MOST_LATENCY:g} s, and its stamps do not say so')
        return self.watch.fault

    def _not_held(self) -> str:
        if self.y.offset <= -self._furthest_back and self.y.force > TOUCH + self.desired:
            return (f'{self.y.force:.1f} N are measured {1e3 * self._furthest_back:.0f} mm before '
                    'the goal, where nothing should touch: is the zero of contact_wrench wrong?')
        return self.watch.not_held(self.press.force, self.desired, self._most_error)

    @property
    def _most_error(self) -> float:
        """By how much the force may miss the desired one, RMS [N]; only a rising one by far."""
        if self.mode is PressMode.RAISING:
            return LEAST_ERROR + RISING_ERROR * self.desired
        return self.bound if self.mode is PressMode.HOLDING else math.inf

    @property
    def _furthest_back(self) -> float:
        return max(self.press.retreat, self.press.range)

    def _switch_off(self) -> None:
        if self.mode is not PressMode.OFF:
            self._enter(PressMode.OFF)
            self._latched, self.reason, self.wall = False, '', None
            self.stiffness = ContactStiffness(self.press.contact_stiffness)

    def _why_wait(self, now: float, fresh: bool, silence: str) -> str:
        """Return what the head has to wait for off the wall, empty for nothing."""
        if not fresh and self.mode is not PressMode.SEARCHING:  # there it stands still
            return f'no contact_wrench for {OLDEST_WRENCH:g} s'
        drift = self.latency.creep * self.stiffness.value
        if self.mode is PressMode.HOLDING and drift > MOST_DRIFT and (
                now - self._crept_at > CREEP_PAUSE):
            self._crept_at = now
            return (f'the head creeps as if contact_wrench drifted by {drift:.2f} N/s, bound '
                    f'{MOST_DRIFT:g} N/s: its zero is taken again')
        return silence or self.sway.obstacle(
            self.press, 1.0 if self.mode is PressMode.RETRACTED else 2.0)

    def _retract(self, reason: str, latched: bool) -> None:
        if not self._latched:
            self.reason, self._latched = reason, latched
        if self.mode is not PressMode.RETRACTED:
            self.last_reason = self.reason
            self._enter(PressMode.RETRACTED)

    def _enter(self, mode: PressMode) -> None:
        self.mode, self._progress, self._untouched, self.desired = mode, 0.0, 0.0, 0.0
        if mode is PressMode.RETRACTED:
            self._free_from = math.inf
            self.zero.begin()
        elif mode is PressMode.SEARCHING:
            self.stiffness.begin()

    def _leave_retreat(self) -> None:
        """Look for the wall once the head is back and off it, and its zero is known."""
        if self._latched or self._free_from == math.inf:
            return
        self.reason = self.zero.obstacle
        if not self._has_changed:
            self.reason = (f'contact_wrench is {self.y.measured + self.zero.force:.1f} N to the '
                           'last digit since it came: push the head by hand to show that it lives')
        if self.reason:
            return
        self.watch.begin()
        self.latency.begin()
        self._enter(PressMode.SEARCHING)

    def _look_for_touch(self, interval: float) -> None:
        touching = self.y.force > min(TOUCH, 0.5 * (self.desired or self.press.force))
        self._untouched = 0.0 if touching else self._untouched + interval
        if self.mode is PressMode.SEARCHING and touching:
            self._enter(PressMode.RAISING)
            self.wall = self._place
            self.watch.begin_contact()
        elif self.mode in IN_CONTACT and self._untouched > LOST_AFTER:
            self._enter(PressMode.SEARCHING)
        elif self.mode is PressMode.RAISING:
            self._raise(interval, touching)
        elif self.wall is not None and touching:
            self.wall = min(self.wall, self._place - self.y.force / self.stiffness.value)

    def _raise(self, interval: float, touching: bool) -> None:
        self._progress += interval / self._ramp_time
        if touching:
            self.stiffness.add_rising(self.desired, self.y.force, self.y.offset_then)
        if self._progress >= 1.0:
            self.stiffness.finish()
            self.latency.begin()
            self.watch.begin_contact()
            self.mode = PressMode.HOLDING

    @property
    def _ramp_time(self) -> float:
        """How long the force rises [s]: one longer than usual lets the gondola swing less."""
        chosen = self.press.ramp_time
        is_to_learn = chosen <= LEARNING_RAMP
        return min(chosen, KNOWN_RAMP) if is_to_learn and self.stiffness.learnt else chosen

    def _wanted_force(self) -> float:
        """Return the force of the moment: ramp, guard against the gondola's sway, stiffness."""
        share = min(self._progress if self.mode is PressMode.RAISING else 1.0, 1.0)
        smooth = 0.5 - 0.5 * math.cos(math.pi * share)
        ramp = FIRST_SHARE + (1.0 - FIRST_SHARE) * smooth
        wanted = self.press.force * ramp * self.sway.share(self.press)
        return wanted - self.press.stiffness * self.y.offset

    def _velocity(self, time: float, fresh: bool) -> float:
        press = self.press
        if self.mode is PressMode.RETRACTED:
            return -press.speed
        if self.mode is PressMode.SEARCHING:
            return self._search_speed() if fresh else 0.0
        if self.watch.chatters(press.force):
            self.stiffness.stiffen()
            self.latency.forget_stiffness()
        self.desired = self._wanted_force()
        wave, rate = 0.0, 0.0
        if self.mode is PressMode.HOLDING:
            wave, rate = self.latency.modulation(time, self.desired)
        velocity = self.y.velocity(self.desired + wave, self.stiffness.for_law, time)
        velocity += rate / self.stiffness.value
        if self.y.force < TOUCH:  # the wall may be touched any moment
            allowed = TOUCH_SHARE * press.force / (self.stiffness.value * LATENCY)
            velocity = min(velocity, allowed)
        return min(max(velocity, -press.speed), press.speed)

    def _search_speed(self) -> float:
        """Return how fast to look for the wall: as fast as its place is known to be far [m/s]."""
        far = 0.0 if self.wall is None else self.wall - AT_WALL - self._place
        return min(max(far / BRAKING, self.press.approach_speed), self.press.speed)

    def _move_y(
        self, time: float, interval: float, saturation_error: float, fresh: bool
    ) -> None:
        press, before = self.press, self.y.offset
        if self.mode is PressMode.OFF:
            moved = _towards(before, 0.0, press.speed * interval)
        else:
            moved = before + interval * self._velocity(time, fresh)
            moved = min(max(moved, -self._furthest_back), press.range)
            if self.mode is PressMode.RETRACTED:
                moved = min(max(moved, -press.retreat), before)
        self._is_blocked = saturation_error * (moved - before) > 0.0
        self.y.move(time, before if self._is_blocked else moved)

    def _look_whether_free(self, time: float, beyond: float) -> None:
        """Find since when the head is off the wall: back, and its path where the goal is."""
        if beyond > NEAR:
            self._free_from = math.inf
            self.zero.begin()
            self.reason = self.reason if self._latched else ''
        elif self._free_from == math.inf and (
                self._is_blocked or self.y.offset <= -self.press.retreat):
            self._free_from = time

    def _move_theta(
        self, time: float, interval: float, saturation_error: float, fresh: bool
    ) -> None:
        turn, before = self.turn, self.theta.offset
        limit = turn.speed * interval
        if turn.enabled and fresh and (self.mode in IN_CONTACT or not self.press.enabled):
            stiffness = 0.25 * self.stiffness.for_law * self.press.brush_width ** 2
            desired = turn.force - turn.stiffness * before
            change = interval * self.theta.velocity(desired, stiffness, time)
            moved = min(max(before + change, -turn.range), turn.range)
            moved = _towards(before, moved, limit)
        else:
            moved = _towards(before, 0.0, limit)
        if saturation_error * (moved - before) > 0.0:
            moved = before
        self.theta.move(time, moved)


def _towards(value: float, target: float, limit: float) -> float:
    step = target - value
    return target if abs(step) <= limit else value + math.copysign(limit, step)

"""
Press on the wall: look for it slowly, raise the force, hold it; retract with a reason.

The head waits a retreat before the goal, looks for the wall at a speed at which even a stiff one
is touched gently, then the force rises from a tenth to the desired one while the stiffness of the
contact is learnt. What makes the head retract for good (a broken sensor, a force that cannot be
held) stays until pressing is switched off and on; without measurements it waits for them.
"""

from __future__ import annotations

import enum
import math

from facade_manipulator.compensation.force_watch import (
    ForceWatch,
    LatencyCheck,
    MOST_LATENCY,
    OLDEST_WRENCH,
)
from facade_manipulator.compensation.impedance import (
    ContactStiffness,
    ForceLaw,
    ImpedanceSettings,
    YawImpedanceSettings,
)
from facade_manipulator.compensation.suspension import SwayWatch
from facade_manipulator.kinematics import MotionState, Pose

FIRST_SHARE = 0.1  # of the desired force, with which the ramp begins
TOUCH = 1.5  # N, three times a sensor's usual noise
LOST_AFTER = 1.0  # s without touch, after which the wall is looked for again
TOUCH_SHARE = 0.25  # of the desired force, by which a touch in search of the wall may miss it
LEAST_ERROR = 2.0  # N, RMS that counts as not held, and of the desired force:
RISING_ERROR, HOLDING_ERROR = 0.5, 0.1  # of the force, while it rises and once it holds
LATENCY = 0.07  # s, usual from a force to the head's answer
NEGLIGIBLE = 1e-9  # m or rad


class PressMode(enum.Enum):
    """What the head does on the wall, as a message."""

    OFF = 'not pressing'
    RETRACTED = 'retracted'
    SEARCHING = 'looking for the wall'
    RAISING = 'raising the force'
    HOLDING = 'holding the force'


IN_CONTACT = (PressMode.RAISING, PressMode.HOLDING)


class Pressing:
    """
    The offsets of y and θ that press on the wall.

    Attributes
    ----------
    y, theta : ForceLaw
        The axes.
    stiffness : ContactStiffness
    watch : ForceWatch
        Finds what is wrong and keeps the figures.
    latency : LatencyCheck
        Finds a force that is late with fresh stamps.
    mode : PressMode
    reason, last_reason : str
        Why the head waits off the wall now, and why it was retracted last; empty for nothing.
    desired : float
        Force of the moment [N], 0 without contact.
    sway : SwayWatch
        How the gondola takes it.

    """

    def __init__(self, press: ImpedanceSettings, turn: YawImpedanceSettings) -> None:
        self.press = press
        self.turn = turn
        self.y, self.theta = ForceLaw(), ForceLaw()
        self.stiffness = ContactStiffness(press.contact_stiffness)
        self.watch = ForceWatch()
        self.latency = LatencyCheck()
        self.mode = PressMode.OFF
        self.reason = self.last_reason = ''
        self.desired = 0.0
        self._latched = False
        self._progress = 0.0
        self._untouched = 0.0
        self._is_blocked = False
        self.sway = SwayWatch()
        if press.enabled:
            self.mode = PressMode.RETRACTED
            self.y.begin(-press.retreat)

    @property
    def idle(self) -> bool:
        """Whether nothing changes without a step: switched off and back at the goal."""
        return not (self.press.enabled or self.turn.enabled) and (
            self.mode is PressMode.OFF and self.y.offset == 0.0 == self.theta.offset)

    def add_measurement(
        self, stamp: float, force: float, moment: float, is_repeated: bool
    ) -> None:
        """Learn from force [N] and moment [N m] on the wall measured at a stamp [s]."""
        self.y.add_measurement(stamp, force)
        self.theta.add_measurement(stamp, moment)
        if self.press.enabled or self.turn.enabled:
            self.watch.add(stamp, force, self.desired, self.stiffness.value, is_repeated)
            self.stiffness.add(stamp, self.y.force, self.y.offset_then)
        if self.mode is PressMode.HOLDING:
            self.latency.add(stamp, self.y.force, self.y.offset_then)

    def step(
        self, now: float, time: float, interval: float, saturation_error: Pose, rail: MotionState
    ) -> None:
        """
        Move the offsets on to a time.

        Parameters
        ----------
        now, time, interval : float
            Present time, the time that the offsets are for, and the time since the last step [s].
        saturation_error : Pose
            By how much each axis is held back at the workspace limit: its offset stops there.
        rail : MotionState
            Disturbance of the gondola.

        """
        self.sway.note(interval, rail, self.mode in IN_CONTACT)
        fresh = now - self.watch.stamp <= OLDEST_WRENCH
        self._change_mode(fresh, interval)
        self._move_y(time, interval, saturation_error.y, fresh)
        self._move_theta(time, interval, saturation_error.theta, fresh)

    def _change_mode(self, fresh: bool, interval: float) -> None:
        if not self.press.enabled:
            self._switch_off()
            return
        if self.mode is PressMode.OFF:
            self._enter(PressMode.RETRACTED)
        reason = self._why_wait(fresh)
        fault = self._fault()
        if fault or reason:
            self._retract(fault or reason, bool(fault))
        elif self.mode is PressMode.RETRACTED:
            self._leave_retreat()
        else:
            self._look_for_touch(interval)

    def _fault(self) -> str:
        if self.mode is PressMode.RETRACTED:
            return ''
        if self.y.offset <= -self._furthest_back and self.y.force > TOUCH + self.desired:
            return (f'{self.y.force:.1f} N are measured {1e3 * self._furthest_back:.0f} mm before '
                    'the goal, where nothing should touch: is the zero of contact_wrench wrong?')
        if self.latency.latency > MOST_LATENCY:
            return (f'contact_wrench answers at least {self.latency.latency:.2f} s late, bound '
                    f'{MOST_LATENCY:g} s, and its stamps do not say so')
        return self.watch.fault(self.press.force, self.desired, self._most_error)

    @property
    def _most_error(self) -> float:
        """By how much the force may miss the desired one, RMS [N]; only a rising one by far."""
        return LEAST_ERROR + {
            PressMode.RAISING: RISING_ERROR * self.desired,
            PressMode.HOLDING: HOLDING_ERROR * self.press.force}.get(self.mode, math.inf)

    @property
    def _furthest_back(self) -> float:
        return max(self.press.retreat, self.press.range)

    def _switch_off(self) -> None:
        if self.mode is not PressMode.OFF:
            self._enter(PressMode.OFF)
            self._latched = False
            self.stiffness = ContactStiffness(self.press.contact_stiffness)

    def _why_wait(self, fresh: bool) -> str:
        """Return what the head has to wait for off the wall, empty for nothing."""
        if not fresh and self.mode is not PressMode.SEARCHING:  # there it stands still
            return f'no contact_wrench for {OLDEST_WRENCH:g} s'
        return self.sway.obstacle(self.press, 1.0 if self.mode is PressMode.RETRACTED else 2.0)

    def _retract(self, reason: str, latched: bool) -> None:
        if not self._latched:
            self.reason, self._latched = reason, latched
        if self.mode is not PressMode.RETRACTED:
            self.last_reason = self.reason
            self._enter(PressMode.RETRACTED)

    def _enter(self, mode: PressMode) -> None:
        self.mode, self._progress, self._untouched, self.desired = mode, 0.0, 0.0, 0.0

    def _leave_retreat(self) -> None:
        """Look for the wall once the head is back and off it, as if it had never been touched."""
        is_back = self._is_blocked or self.y.offset <= -self.press.retreat
        if self._latched or not is_back:
            return
        if self.y.force > TOUCH:  # where the head began on the wall, it is still on its way back
            self.reason = f'{self.y.force:.1f} N are measured before the wall is looked for'
            return
        self.watch.begin()
        self.latency.begin()
        self.stiffness = ContactStiffness(self.press.contact_stiffness)
        self.reason = ''
        self._enter(PressMode.SEARCHING)

    def _look_for_touch(self, interval: float) -> None:
        touching = self.y.force > min(TOUCH, 0.5 * (self.desired or self.press.force))
        self._untouched = 0.0 if touching else self._untouched + interval
        if self.mode is PressMode.SEARCHING and touching:
            self._enter(PressMode.RAISING)
            self.stiffness.begin()
            self.watch.begin_contact()
        elif self.mode in IN_CONTACT and self._untouched > LOST_AFTER:
            self._enter(PressMode.SEARCHING)
        elif self.mode is PressMode.RAISING:
            self._raise(interval, touching)

    def _raise(self, interval: float, touching: bool) -> None:
        self._progress += interval / self.press.ramp_time
        if touching:
            self.stiffness.add_rising(self.desired, self.y.force, self.y.offset_then)
        if self._progress >= 1.0:
            self.stiffness.finish()
            self.latency.begin()
            self.watch.begin_contact()
            self.mode = PressMode.HOLDING

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
            return press.approach_speed if fresh else 0.0
        if self.watch.chatters(self.desired):
            self.stiffness.stiffen()
        self.desired = self._wanted_force()
        wave, rate = 0.0, 0.0
        if self.mode is PressMode.HOLDING:
            wave, rate = self.latency.modulation(time, self.desired)
        stiffness = self.stiffness.value
        velocity = self.y.velocity(self.desired + wave, stiffness, time) + rate / stiffness
        if self.y.force < TOUCH:  # the wall may be touched any moment
            allowed = TOUCH_SHARE * press.force / (self.stiffness.value * LATENCY)
            velocity = min(velocity, allowed)
        return min(max(velocity, -press.speed), press.speed)

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

    def _move_theta(
        self, time: float, interval: float, saturation_error: float, fresh: bool
    ) -> None:
        turn, before = self.turn, self.theta.offset
        limit = turn.speed * interval
        if turn.enabled and fresh and (self.mode in IN_CONTACT or not self.press.enabled):
            stiffness = 0.25 * self.stiffness.value * self.press.brush_width ** 2
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
    moved = value + min(max(target - value, -limit), limit)
    return target if abs(target - moved) < NEGLIGIBLE else moved

"""What the compensator says: its diagnostics, and what becomes of a goal for who sent it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
import math

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus
from rclpy.node import Node

from facade_manipulator.compensation import (
    ArrivalSettings,
    ArrivalWatch,
    Compensator,
    CorrectedPose,
    CorrectionMode,
    GoalProgress,
    GoalState,
    PressMode,
)
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import OutOfPlane
from facade_manipulator.ros import declare, diagnostic_status, LATCHED, stamp_text

LEAST_ERROR = 1e-4  # m or rad, from which an axis counts as held back
SHOWN_FOR = 1.0  # s, so that a person can read it
LEVELS = {
    CorrectionMode.ACTIVE: 'ok',
    CorrectionMode.SETTLING: 'ok',
    CorrectionMode.DISABLED: 'warn',
    CorrectionMode.NO_ESTIMATE: 'warn',
    CorrectionMode.SILENT: 'error',
}
HOLDS = {'saturation_error': 'at the workspace limit', 'tracking_error': 'by the limits of motion'}

GOAL_STATUS = 'compensator/goal_status'
GOAL_LEVELS = {GoalState.HELD_BACK: 'warn', GoalState.REJECTED: 'error'}
FOLLOWED = {  # key of the goal that is followed, and its factor
    'followed x [mm]': 1e3, 'followed y [mm]': 1e3, 'followed angle [deg]': math.degrees(1.0)}
HOLD = 'compensator/hold was called'
PERIOD = 0.2  # s, between messages while the head moves


class CompensatorReport:
    """Keep what an operator should know."""

    def __init__(self, compensator: Compensator) -> None:
        self._compensator = compensator
        self._last: CorrectedPose | None = None
        self._pose_count = 0
        self._held_until: dict[tuple[str, str], float] = {}
        self._published_outcome = ('', '')
        self.out_of_plane = OutOfPlane(0.0, 0.0)  # of the newest estimate

    def note(self, now: float, corrected: CorrectedPose) -> None:
        """Note a corrected pose and what held it back."""
        self._last = corrected
        self._pose_count += 1
        for what in HOLDS:
            amounts = getattr(corrected, what)
            if max(amounts) > LEAST_ERROR or min(amounts) < -LEAST_ERROR:
                self._note_held(what, amounts, now + SHOWN_FOR)

    def _note_held(self, what: str, amounts: Pose, until: float) -> None:
        for axis, amount in zip(Pose._fields, amounts, strict=True):
            if abs(amount) > LEAST_ERROR:
                self._held_until[what, axis] = until

    def changed(self, now: float) -> bool:
        """Return whether level or message are others than last published."""
        return self._outcome(now) != self._published_outcome

    def components(self, now: float, rejections: Mapping) -> list[DiagnosticStatus]:
        """Return the diagnostics of this moment."""
        self._published_outcome = self._outcome(now)
        components = [diagnostic_status(
            'correction', *self._published_outcome, {**self._values(now), **rejections})]
        contact = self._compensator.contact
        pressing = contact.pressing
        if any(part.enabled for part in (
                contact.lateral.settings, pressing.press, pressing.turn)):
            components.append(diagnostic_status(
                'contact', *self._contact_outcome(), self._contact_values()))
        return components

    def _contact_outcome(self) -> tuple[str, str]:
        pressing = self._compensator.contact.pressing
        if pressing.mode is PressMode.RETRACTED and pressing.reason:
            return 'error', f'{pressing.mode.value}: {pressing.reason}'
        if self._compensator.obstacle:
            return 'warn', f'{pressing.mode.value}; {self._compensator.obstacle}'
        if pressing.mode is PressMode.OFF:
            return 'ok', 'giving way to the wall'
        return 'ok', pressing.mode.value

    def _outcome(self, now: float) -> tuple[str, str]:
        """Return level and message; no number that changes, so that a change means something."""
        mode = self._compensator.correction.mode
        held_back = self.held_back(now)
        if held_back:
            level = 'error' if LEVELS[mode] == 'error' else 'warn'
            return level, f'{mode.value}; {held_back}'
        return LEVELS[mode], mode.value

    def held_back(self, now: float) -> str:
        """Return what holds back which axes, empty if nothing ever did."""
        if not self._held_until:
            return ''
        parts = []
        for what, text in HOLDS.items():
            axes = [axis for axis in Pose._fields
                    if self._held_until.get((what, axis), 0.0) > now]
            if axes:
                parts.append(f'held back in {", ".join(axes)} {text}')
        return '; '.join(parts)

    def _values(self, now: float) -> dict:
        correction = self._compensator.correction
        values = {
            'horizon [ms]': 1e3 * self._compensator.settings.horizon,
            'corrected poses': self._pose_count,
            'age of the estimate [ms]': 1e3 * correction.age(now),
            'lag of the head [ms]': 1e3 * self._compensator.following.lag,
            'initialisations': self._compensator.initialisations,
        }
        if any(self.out_of_plane):
            values['left out of the estimate'] = (
                f'z {1e3 * self.out_of_plane.height:+.1f} mm, '
                f'tilt {math.degrees(self.out_of_plane.tilt):.2f} deg')
        if self._compensator.stamp_delay is not None:
            values['estimate.delay by the slip [ms]'] = '{:.1f} +- {:.1f}'.format(
                *(1e3 * time for time in self._compensator.stamp_delay))
        if self._last is not None:
            values['corrected disturbance'] = millimetres(self._last.disturbance)
            values['saturation error'] = millimetres(self._last.saturation_error)
            values['tracking error'] = millimetres(self._last.tracking_error)
        deviations = correction.deviations()
        if deviations is not None:
            x, y, theta = deviations
            values['standard deviation of the prediction'] = (
                f'x {1e3 * x:.2f} mm, y {1e3 * y:.2f} mm, theta {math.degrees(theta):.3f} deg')
        return values

    def _contact_values(self) -> dict:
        contact = self._compensator.contact
        pressing, watch = contact.pressing, contact.pressing.watch
        sway, energy = pressing.sway, self._compensator.sway_energy
        return {
            'force on the wall [N]': pressing.y.measured,
            'desired force [N]': pressing.press.force,
            'force of the moment desired [N]': pressing.desired,
            'force, mean of 10 s [N]': watch.mean,
            'force, RMS error of 10 s [N]': watch.rms,
            'share off the wall of 10 s [%]': 100.0 * watch.share_off,
            'stiffness of the contact [N/mm]': 1e-3 * pressing.stiffness.value,
            'moment on the wall [N m]': pressing.theta.measured,
            'push-back of the gondola [mm]': 1e3 * sway.push_back,
            'sway of the gondola, envelope': millimetres(sway.envelope),
            'energy of the sway': _joules(energy) if energy else 'suspension.mass is not known',
            'retracted last because': pressing.last_reason or 'never',
            'shift of the goal': millimetres(contact.present),
        }


def _joules(energy: Sequence[float]) -> str:
    return ', '.join(
        f'{axis} {value:.2f} J' for axis, value in zip(Pose._fields, energy, strict=True))


def millimetres(pose: Pose) -> str:
    """Return a pose as an operator reads it."""
    return (f'x {1e3 * pose.x:+.1f} mm, y {1e3 * pose.y:+.1f} mm, '
            f'theta {math.degrees(pose.theta):+.2f} deg')


class GoalReport:
    """
    Publish the progress of the newest goal, on change and while it is not reached.

    Parameters
    ----------
    node : rclpy.node.Node
    compensator : Compensator
    held_back : callable
        Takes the time [s], returns what holds the head back; '' if nothing does.

    """

    def __init__(
        self, node: Node, compensator: Compensator, held_back: Callable[[float], str]
    ) -> None:
        self._compensator, self._held_back = compensator, held_back
        self._watch = ArrivalWatch(declare(
            node, ArrivalSettings, 'arrival',
            lambda settings: setattr(self._watch, 'settings', settings)))
        self._publisher = node.create_publisher(DiagnosticStatus, GOAL_STATUS, LATCHED)
        self._stamp = ''
        self._is_open = False
        self._published: tuple[GoalState | None, str] = (None, '')
        self._next = -math.inf

    def accept(self, stamp: Time) -> None:
        """Report on another goal from now on."""
        self._stamp, self._is_open = stamp_text(stamp), True
        self._watch.begin()
        self._publish(GoalProgress(GoalState.ACCEPTED), '')

    def reject(self, stamp: Time, reason: str) -> None:
        """Say why a goal is not followed; the one before, if any, is reported on further."""
        self._send(stamp_text(stamp), GoalProgress(GoalState.REJECTED), reason)

    def end(self, reason: str) -> None:
        """Say why the goal that was followed is not followed any more."""
        if self._is_open:
            self._is_open = False
            self._publish(GoalProgress(GoalState.REJECTED), reason)

    def update(self, now: float) -> None:
        """Publish what has changed, and where the head is now and then."""
        if not self._is_open or self._compensator.goal is None:
            return
        held_back = self._held_back(now)
        progress = self._watch.update(
            now, self._compensator.goal_error(now), self._compensator.path_time(now),
            bool(held_back))
        due = now >= self._next or now < self._next - PERIOD  # or the clock was set back
        is_still = progress.state is GoalState.REACHED
        if self._published != (progress.state, held_back) or due and not is_still:
            self._next = now + PERIOD
            self._publish(progress, held_back)

    def _publish(self, progress: GoalProgress, reason: str) -> None:
        self._published = progress.state, reason
        self._send(self._stamp, progress, reason)

    def _send(self, stamp: str, progress: GoalProgress, reason: str) -> None:
        values = {
            'goal stamp': stamp,
            'state': progress.state.value,
            'distance [mm]': 1e3 * progress.distance,
            'angle [deg]': math.degrees(progress.angle),
            'time to go [s]': progress.time_to_go,
            'reason': reason,
        }
        if self._compensator.goal is not None:
            values.update((key, scale * value) for (key, scale), value in zip(
                FOLLOWED.items(), self._compensator.goal, strict=True))
        message = f'{progress.state.value}: {reason}' if reason else progress.state.value
        self._publisher.publish(diagnostic_status(
            'goal', GOAL_LEVELS.get(progress.state, 'ok'), message, values))


def followed_goal(status: DiagnosticStatus) -> Pose | None:
    """Return the goal that is followed when a goal_status is sent, None if there is none."""
    values = {item.key: item.value for item in status.values}
    if FOLLOWED.keys() <= values.keys():
        return Pose(*(float(values[key]) / scale for key, scale in FOLLOWED.items()))
    return None

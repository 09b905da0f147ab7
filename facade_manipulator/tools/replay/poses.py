"""Compensator and inverse kinematics fed with what was recorded, and what comes out of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from heapq import merge
from typing import Any, NamedTuple

import numpy as np

from facade_manipulator import messages
from facade_manipulator.blackbox import RecordedRun
from facade_manipulator.compensation import Compensator, CompensatorSettings
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Pose
from facade_manipulator.motion import GoalSettings, Setpoint, SetpointStream
from facade_manipulator.parameters import settings_from
from facade_manipulator.tools.replay.parameters import geometry_of

# s: what the compensator learnt before the recording it has to learn again; in a short one half
SETTLING = 20.0


class Comparison(NamedTuple):
    """What was recorded and what the replay made of the same input: poses or setpoints."""

    times: np.ndarray  #: stamps, shape (n,) [s]
    recorded: np.ndarray  #: x, y, θ or q1, q2, q3, shape (n, 3) [m, rad]
    replayed: np.ndarray  #: the same, shape (n, 3)
    settled: np.ndarray  #: where the two should be alike, shape (n,)
    rejections: list[str]  #: what the replay rejected
    #: replayed setpoints, if these are what is compared, and when they are to be sent [s]
    setpoints: Sequence[tuple[float, Setpoint]] = ()

    @classmethod
    def of(
        cls, pairs: list[tuple[Any, ...]], settled_at: float, rejections: list[str]
    ) -> Comparison:
        """Compare time, recorded and replayed value of each, from a time on [s]."""
        times = np.array([pair[0] for pair in pairs])
        recorded, replayed = (
            np.array([pair[column] for pair in pairs]).reshape(-1, 3) for column in (1, 2))
        return cls(times, recorded, replayed, times >= settled_at, rejections)

    @property
    def errors(self) -> np.ndarray:
        """Replayed minus recorded where they should be alike, shape (m, 3)."""
        return (self.replayed - self.recorded)[self.settled]

    def first_deviation(self, bound: float) -> float | None:
        """Return when they first differ by more than a bound [s], None if they never do."""
        far = np.abs(self.replayed - self.recorded).max(axis=1, initial=0.0) > bound
        return float(self.times[far & self.settled][0]) if any(far & self.settled) else None


def carriages(message: Any) -> tuple[float, float, float]:
    """Return the positions of q1, q2, q3 in a JointState [m], finite or not."""
    return messages.in_order(message.name, message.position, 'position')


def settling_of(run: RecordedRun) -> float:
    """Return from when on corrected poses should be as they were [s, from the beginning]."""
    return min(SETTLING, 0.5 * (run.end - run.begin))


def replay_poses(run: RecordedRun) -> Comparison:
    """
    Correct the recorded goals by the recorded disturbance.

    The compensator runs at the instants at which it ran. It does not know what it had learnt
    before the recording, so the first `SETTLING` seconds do not count.
    """
    geometry, values = geometry_of(run, 'compensator'), run.parameters['compensator']
    compensator = Compensator(geometry, CompensatorSettings.of(values))
    horizon = compensator.settings.horizon
    ticks = [(messages.seconds(one.message.header.stamp) - horizon, '', one.message)  # no topic
             for one in run.topics['corrected_pose']]
    rejections: list[str] = []
    pairs = []
    streams = [[(one.time, topic, one.message) for one in run.topics[topic]] for topic in INPUTS]
    for now, topic, message in merge(*streams, ticks, key=lambda item: item[0]):
        if topic:
            with noted(rejections):
                INPUTS[topic](compensator, now, message)
            continue
        corrected = compensator.update(now)
        if corrected is not None:
            pairs.append(
                (messages.seconds(message.header.stamp), _corrected(message), corrected.pose))
    return Comparison.of(pairs, run.begin + settling_of(run), rejections)


def recorded_setpoints(run: RecordedRun) -> list[tuple[float, Setpoint]]:
    """Return the recorded setpoints and when they were received [s]."""
    return [(one.time, Setpoint(
        messages.seconds(one.message.header.stamp), carriages(one.message),
        messages.in_order(one.message.name, one.message.velocity, 'velocity')))
        for one in run.topics['joint_setpoints']]


def replay_setpoints(run: RecordedRun, poses: Comparison | None = None) -> Comparison:
    """
    Turn the recorded corrected poses into setpoints; every one should be as it was.

    With the replayed poses, what the machine would have sent with them.
    """
    stream = SetpointStream(
        geometry_of(run, 'ik_service'),
        settings_from(GoalSettings, run.parameters['ik_service']))
    recorded = {setpoint.time: setpoint.position for _, setpoint in recorded_setpoints(run)}
    replayed = dict(zip(poses.times, poses.replayed, strict=True)) if poses else None
    rejections: list[str] = []
    pairs, setpoints = [], []
    for received, message in run.topics['corrected_pose']:
        time = messages.seconds(message.header.stamp)
        with noted(rejections):
            pose = _corrected(message) if replayed is None else Pose(*replayed[time])
            setpoint = stream.setpoint(time, pose)
            setpoints.append((received, setpoint))
            if time in recorded:
                pairs.append((time, recorded[time], setpoint.position))
    return Comparison.of(pairs, run.begin, rejections)._replace(setpoints=setpoints)


def _corrected(message: Any) -> Pose:
    return messages.planar_pose(message.pose, 'corrected_pose')


def _add_estimate(compensator: Compensator, now: float, message: Any) -> None:
    *pose, x, y, yaw = messages.estimate_numbers(message)
    place, (_, tilt) = messages.projected(pose, 'disturbance')
    if not messages.is_of_rail(message):
        place = compensator.gate.displacement(place)
    compensator.add_estimate(now, messages.seconds(message.header.stamp), place, (x, y, yaw), tilt)


def _hold(compensator: Compensator, now: float, message: Any) -> None:
    if messages.status_values(message).get('reason') == messages.HOLD:
        with suppress(ManipulatorError):  # there was a way before the recording only
            compensator.hold(now)


INPUTS: dict[str, Callable[[Compensator, float, Any], None]] = {
    'goal_pose': lambda compensator, _, message: compensator.set_goal(
        messages.planar_pose(message.pose, 'goal_pose')),
    'compensator/goal_status': _hold,
    'disturbance': _add_estimate,
    'disturbance_odometry': _add_estimate,
    'end_effector_pose': lambda compensator, _, message: compensator.following.add_head(
        messages.seconds(message.header.stamp),
        messages.planar_pose(message.pose, 'end_effector_pose')),
    'contact_wrench': lambda compensator, now, message: compensator.contact.add_wrench(
        now, messages.seconds(message.header.stamp), messages.planar_wrench(message)),
    'lateral_offset': lambda compensator, now, message: compensator.contact.add_lateral_offset(
        now, messages.seconds(message.header.stamp), message.point.x),
}


@contextmanager
def noted(rejections: list[str]) -> Iterator[None]:
    """Note what the block rejects, and go on after it."""
    try:
        yield
    except ManipulatorError as error:
        rejections.append(str(error))

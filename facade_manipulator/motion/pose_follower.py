"""
Setpoints for poses in frame `rail`: follow a stream, approach a single pose.

A pose after a pause of `STREAM_GAP` begins a stream. If no other pose follows it within that time,
the head approaches it on a jerk-limited straight path.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from facade_manipulator.kinematics import Pose
from facade_manipulator.motion.head_path import HeadMotion, ReferencePath
from facade_manipulator.motion.setpoints import Setpoint, SetpointStream, STREAM_GAP


class RailPose(NamedTuple):
    """Pose of the head in frame `rail` for a given time."""

    time: float  #: [s]
    pose: Pose
    received: float  #: [s]


class PoseFollower:
    """
    Follower of a pose stream; it approaches a single pose from the measured head pose.

    The ik_service calls `follow` for each pose, and `step` 100 times a second while the follower
    `is_approaching`. All times are on one clock [s].

    Parameters
    ----------
    stream : SetpointStream
        Certifies the poses.
    path : ReferencePath
        Path of an approach.

    Attributes
    ----------
    is_approaching : bool
        Whether an approach continues, or begins unless another pose follows.

    """

    # s, by which the setpoints of an approach are sent ahead of their time
    APPROACH_LEAD = 0.05

    def __init__(self, stream: SetpointStream, path: ReferencePath) -> None:
        self._stream = stream
        self._path = path
        self._newest_time = -math.inf  # of the newest pose
        self._first: RailPose | None = None  # of a stream that has no second pose yet
        self._is_at_rest = True  # before the approach has begun
        self.is_approaching = False

    def is_first(self, command: RailPose) -> bool:
        """Return whether a pose begins a stream, or is a single pose to approach."""
        return abs(command.time - self._newest_time) > STREAM_GAP

    def follow(self, command: RailPose, head: Pose | None) -> Setpoint | None:
        """
        Return the setpoint of a pose; None while it is unknown whether the pose begins a stream.

        Without a measured head nothing can be approached, and each pose has a setpoint. Raises a
        LimitError with the limit that the pose violates.
        """
        is_first = self.is_first(command)
        self._newest_time = command.time
        if not is_first or head is None:
            self.end()
            return self._stream.setpoint(command.time, command.pose)

        self._stream.certify(command.pose)
        self._first = command
        if not self.is_approaching:
            self.is_approaching = True
            self._is_at_rest = True
            # the next pose of a stream has a velocity
            self._stream.setpoint(command.time, command.pose)
        return None

    def step(self, now: float, head: Pose | None) -> Setpoint | None:
        """
        Return the next setpoint of an approach; None before the approach begins.

        Raises a LimitError with the limit that the path violates.
        """
        if not self.is_approaching:
            return None

        time = now + self.APPROACH_LEAD
        first = self._first
        if first is not None and now - first.received > STREAM_GAP:
            self._first = None
            self._begin(time, first.pose, head)
        if self._is_at_rest:
            return None

        if time >= self._path.arrival() and self._first is None:
            self.is_approaching = False
        return self._stream.setpoint(time, self._path.at(time).position)

    def end(self) -> None:
        """End an approach; the next pose begins another approach."""
        self._first = None
        self.is_approaching = False

    def _begin(self, time: float, pose: Pose, head: Pose | None) -> None:
        """Plan the path to a pose, from the head's pose or from the current approach."""
        if self._is_at_rest:
            start = pose if head is None else head
            self._path.initialise(time, HeadMotion(start), pose)
        else:
            self._path.retarget(time, pose)
        self._is_at_rest = False

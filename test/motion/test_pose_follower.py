"""Follower of poses: a stream is followed, a single pose is approached."""

import numpy as np
import pytest

from facade_manipulator.errors import LimitError
from facade_manipulator.kinematics import (
    Geometry,
    inverse_kinematics,
    MIN_CONDITIONING,
    Pose,
)
from facade_manipulator.motion.head_path import ReferencePath, ReferenceSettings
from facade_manipulator.motion.pose_follower import PoseFollower, RailPose
from facade_manipulator.motion.setpoints import SetpointStream, STREAM_GAP

PERIOD = 0.01
HEAD = Pose(-0.05, 0.25, 0.0)
POSE = Pose(0.05, 0.25, 0.1)
OTHER = Pose(0.0, 0.25, 0.0)
UNREACHABLE = Pose(0.0, 0.5, 0.0)


class Machine:
    """Pose follower, its clock, and its setpoints."""

    def __init__(self):
        self.poses = PoseFollower(
            SetpointStream(Geometry(), MIN_CONDITIONING),
            ReferencePath(ReferenceSettings()),
        )
        self.now = 100.0
        self.setpoints = []

    def _note(self, setpoint):
        if setpoint is not None:
            self.setpoints.append(setpoint)

    def follow(self, pose, head=HEAD):
        rail_pose = RailPose(self.now, pose, self.now)
        self._note(self.poses.follow(rail_pose, head))

    def run(self, duration, head=HEAD):
        for _ in range(round(duration / PERIOD)):
            self.now += PERIOD
            self._note(self.poses.step(self.now, head))

    @property
    def ends(self):
        """Return q3 of the first and the last setpoint."""
        return self.setpoints[0].position[2], self.setpoints[-1].position[2]


@pytest.fixture
def machine():
    return Machine()


def test_single_pose_is_approached_after_a_pause(machine):
    machine.follow(POSE)
    machine.run(STREAM_GAP - PERIOD)
    assert machine.setpoints == []
    machine.run(5.0)
    assert machine.ends == pytest.approx((HEAD.x, POSE.x), abs=1e-6)
    assert not machine.poses.is_approaching


def test_setpoints_of_an_approach_lead_their_time(machine):
    machine.follow(POSE)
    machine.run(STREAM_GAP + 0.1)
    assert machine.setpoints[-1].time == pytest.approx(
        machine.now + PoseFollower.APPROACH_LEAD
    )


def test_second_pose_makes_a_stream_without_an_approach(machine):
    machine.follow(POSE)
    machine.run(0.05)
    machine.follow(POSE._replace(x=POSE.x + 0.01))
    machine.run(1.0)
    (setpoint,) = machine.setpoints
    assert setpoint.velocity[2] == pytest.approx(0.01 / 0.05)


def test_pose_without_a_measured_head_is_followed_at_once(machine):
    machine.follow(POSE, head=None)
    (setpoint,) = machine.setpoints
    assert setpoint.position == pytest.approx(inverse_kinematics(Geometry(), POSE))
    assert not machine.poses.is_approaching


def test_pose_during_an_approach_continues_its_motion(machine):
    machine.follow(POSE)
    machine.run(STREAM_GAP + 0.3)
    machine.follow(OTHER)
    machine.run(5.0)
    q3 = [one.position[2] for one in machine.setpoints]
    changes = np.diff(q3, n=2)
    assert np.abs(changes).max() < 1e-4
    assert q3[-1] == pytest.approx(OTHER.x, abs=1e-6)


@pytest.mark.parametrize('delay', [0.1, STREAM_GAP + 0.3])
def test_ended_approach_has_no_further_setpoint(machine, delay):
    machine.follow(POSE)
    machine.run(delay)
    machine.poses.end()
    machine.setpoints.clear()
    machine.run(1.0)
    assert machine.setpoints == []


def test_approach_after_an_ended_approach_begins_at_the_head(machine):
    machine.follow(POSE)
    machine.run(STREAM_GAP + 0.3)
    machine.poses.end()
    machine.setpoints.clear()
    machine.follow(OTHER, head=HEAD)
    machine.run(5.0)
    assert machine.ends == pytest.approx((HEAD.x, OTHER.x), abs=1e-6)


@pytest.mark.parametrize('head', [HEAD, None])
def test_impossible_pose_is_rejected_at_once(machine, head):
    with pytest.raises(LimitError, match='link_length'):
        machine.follow(UNREACHABLE, head)
    machine.run(1.0)
    assert machine.setpoints == []


def test_clock_that_is_set_back_begins_another_approach(machine):
    machine.follow(POSE)
    machine.run(5.0)
    machine.now -= 600.0
    machine.setpoints.clear()
    machine.follow(OTHER)
    assert machine.setpoints == []
    assert machine.poses.is_approaching

"""Progress of a goal: each change once, the distance periodically, and the reason of its end."""

from __future__ import annotations

from itertools import groupby

import pytest

from facade_manipulator.compensation.compensator import Compensator
from facade_manipulator.kinematics import Geometry, Pose
from facade_manipulator.nodes.compensator_report import GOAL_PERIOD, GoalReport
from facade_manipulator.nodes.conversions import stamp
from facade_manipulator.nodes.messages import status_values

STEP = 0.02
GOAL, NEXT, FAR = Pose(0.05, 0.25, 0.0), Pose(-0.05, 0.25, 0.0), Pose(0.3, 0.25, 0.0)
LONG = 2.0  # s, in which a goal is reached


class Machine:
    """A compensator whose head follows exactly, and the reports on its goals."""

    def __init__(self) -> None:
        self.sent: list[dict[str, str]] = []
        self.compensator = Compensator(Geometry())
        self.report = GoalReport(
            lambda status: self.sent.append(status_values(status)), self.compensator)
        self.now, self.head = 100.0, GOAL._replace(x=0.0)
        self.compensator.correction.enabled = False

    def follow(self, goal: Pose, at: float) -> None:
        self.compensator.set_goal(goal)
        self.report.accept(stamp(at))

    def run(self, duration: float) -> list[dict[str, str]]:
        """Return the reports of a duration [s]."""
        before = len(self.sent)
        for _ in range(round(duration / STEP)):
            self.now += STEP
            self.compensator.following.add_head(self.now, self.head)
            corrected = self.compensator.update(self.now)
            self.head = corrected.pose if corrected else self.head
            self.report.update(self.now)
        return self.sent[before:]


@pytest.fixture
def machine():
    return Machine()


def states(sent):
    return [state for state, _ in groupby(one['state'] for one in sent)]


def test_reached_goal_is_reported_in_each_of_its_states(machine):
    machine.follow(GOAL, 1.0)
    sent = machine.run(LONG)
    assert states(machine.sent) == ['accepted', 'moving', 'reached']
    assert {one['goal stamp'] for one in machine.sent} == {'1.000000000'}
    to_go = [float(one['time to go [s]']) for one in sent]
    assert all(a > b for a, b in zip(to_go, to_go[1:], strict=False)) and to_go[-1] == 0.0
    assert to_go[0] == pytest.approx(GOAL_PERIOD * (len(sent) - 1), abs=2.0 * GOAL_PERIOD)
    assert machine.run(1.0) == []


@pytest.mark.parametrize('duration, before', [(0.2, ['superseded']), (LONG, [])])
def test_newer_goal_supersedes_an_unreached_goal(machine, duration, before):
    machine.follow(GOAL, 1.0)
    machine.run(duration)
    machine.sent.clear()
    for _ in range(2):  # it is sent again
        machine.follow(NEXT, 2.0)
        assert states(machine.sent) == [*before, 'accepted']
    assert states(machine.run(LONG)) == ['moving', 'reached']


@pytest.mark.parametrize('duration', [0.0, 0.2, LONG])
def test_end_is_reported_once_with_its_reason(machine, duration):
    machine.report.end('nothing was followed')
    assert machine.sent == []
    machine.follow(GOAL, 1.0)
    machine.run(duration)
    machine.sent.clear()
    machine.report.end('the drives are halted')
    machine.report.end('the driver is silent')
    ended, = machine.sent
    assert (ended['state'], ended['reason']) == ('ended', 'the drives are halted')
    assert machine.run(1.0) == []


def test_rejected_goal_is_reported_beside_the_followed_goal(machine):
    machine.follow(GOAL, 1.0)
    machine.report.reject(stamp(2.0), 'far')
    rejected, *later = [machine.sent[-1], *machine.run(1.0)]
    assert [rejected[key] for key in ('state', 'reason', 'goal stamp', 'followed x [mm]')] == [
        'rejected', 'far', '2.000000000', '50']
    assert {(one['goal stamp'], one['rejection']) for one in later} == {('1.000000000', 'far')}
    machine.follow(NEXT, 3.0)
    assert 'rejection' not in machine.sent[-1]


def test_held_back_head_is_reported_with_the_axis(machine):
    machine.follow(FAR, 1.0)
    machine.run(0.1)
    machine.compensator.held_back.note(machine.now, *[Pose(0.0, 0.01, 0.0)] * 2)
    sent = machine.run(2.0)
    assert states(sent) == ['held back', 'moving'] and 'in y' in sent[0]['reason']
    assert sent[-1]['reason'] == ''
    machine.now -= 50.0  # the clock is set back
    machine.report.update(machine.now)
    before = len(machine.sent)
    machine.report.update(machine.now + GOAL_PERIOD)
    assert len(machine.sent) == before + 1

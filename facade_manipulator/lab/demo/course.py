"""The head on the wall over a run of the demo, from the file that the recorder wrote of it."""

from __future__ import annotations

import numpy as np

from facade_manipulator.blackbox import RecordedRun
from facade_manipulator.errors import RecordError
from facade_manipulator.kinematics import compose, invert, Pose, Wrench
from facade_manipulator.lab.gondola import between, Course, Facade
from facade_manipulator.messages import by_stamp, planar_pose, planar_wrench

HEAD = 'gondola_simulator/head_pose'
TOPICS = (HEAD, 'goal_pose', 'compensator/reference', 'end_effector_pose', 'contact_wrench')
LEAST_SAMPLES = 10


def course_of(run: RecordedRun, settling_time: float) -> Course:
    """
    Return what a run shows from its first goal on; a goal counts after the settling time [s].

    Raises a RecordError if that is too little.
    """
    goals = _poses(run, 'goal_pose')
    heads = _poses(run, HEAD)
    heads = heads[heads[:, 0] >= goals[:1, 0].max(initial=run.begin)]
    if not len(goals) or len(heads) < LEAST_SAMPLES:
        raise RecordError(f'{len(heads)} poses of the head and {len(goals)} goals are too few')
    times = heads[:, 0]
    new = np.r_[True, np.any(np.diff(goals[:, 1:], axis=0), axis=1)]  # one is sent several times
    at = np.searchsorted(goals[new, 0], times, 'right') - 1
    goal = goals[new][at]
    reference = _poses(run, 'compensator/reference')
    on_rail = between(times, _poses(run, 'end_effector_pose'))
    return Course(
        times - times[0], heads[:, 1:],
        [compose(Pose(*head), invert(Pose(*place)))
         for head, place in zip(heads[:, 1:], on_rail, strict=True)],
        goal[:, 1:], between(times, reference) if len(reference) else goal[:, 1:],
        times - goal[:, 0] >= settling_time)


def forces_of(run: RecordedRun, course: Course) -> tuple[np.ndarray, np.ndarray]:
    """Return times [s] of the course and force on the wall [N], empty without a contact."""
    begin = _poses(run, HEAD)[-1, 0] - course.times[-1]
    rows = [(time - begin, wrench) for time, *wrench in by_stamp(
        (one.message for one in run.topics['contact_wrench']), planar_wrench)
        if 0.0 <= time - begin <= course.times[-1]]
    times = np.array([time for time, _ in rows])
    yaws = np.interp(times, course.times, course.heads[:, 2])
    return times, np.array([Facade.force_on_wall(Pose(0.0, 0.0, yaw), Wrench(*wrench))
                            for yaw, (_, wrench) in zip(yaws, rows, strict=True)])


def _poses(run: RecordedRun, topic: str) -> np.ndarray:
    """Return stamps and poses of a topic, shape (n, 4)."""
    return np.array(by_stamp((one.message for one in run.topics[topic]),
                             lambda message: planar_pose(message.pose, topic))).reshape(-1, 4)

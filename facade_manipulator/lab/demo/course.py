"""The head on the wall over a run of the demo, from what the collector received."""

from __future__ import annotations

import numpy as np

from facade_manipulator import interfaces
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import compose, invert, Pose, Wrench
from facade_manipulator.lab.demo.collector import Collector
from facade_manipulator.lab.gondola.course import between, Course
from facade_manipulator.lab.gondola.facade import Facade

LEAST_SAMPLES = 10


def course_of(collector: Collector, settling_time: float) -> Course:
    """
    Return the samples of a run from its first goal on; a goal counts after the settling time [s].

    Raises a ManipulatorError if there are too few samples.
    """
    heads, goals, references, on_rail = map(collector.table, (
        interfaces.HEAD_POSE, interfaces.GOAL_POSE, interfaces.REFERENCE,
        interfaces.END_EFFECTOR_POSE))
    # only samples after the first goal, and within the times for which all topics were collected
    begin = max((table[0, 0] for table in (goals, references, on_rail) if len(table)),
                default=0.0)
    end = min((table[-1, 0] for table in (references, on_rail) if len(table)), default=0.0)
    heads = heads[(heads[:, 0] >= begin) & (heads[:, 0] <= end)]
    if not len(goals) or not len(on_rail) or len(heads) < LEAST_SAMPLES:
        raise ManipulatorError(
            f'{len(heads)} poses of the head and {len(goals)} goals are too few for a report; '
            'next: look into the logs of the nodes')
    times = heads[:, 0]
    new = np.r_[True, np.any(np.diff(goals[:, 1:], axis=0), axis=1)]  # one is sent several times
    goal = goals[new][np.searchsorted(goals[new, 0], times, 'right') - 1]
    return Course(
        times - times[0], heads[:, 1:],
        [compose(Pose(*head), invert(Pose(*place)))
         for head, place in zip(heads[:, 1:], between(times, on_rail), strict=True)],
        goal[:, 1:], between(times, references) if len(references) else goal[:, 1:],
        times - goal[:, 0] >= settling_time)


def forces_of(collector: Collector, course: Course) -> tuple[np.ndarray, np.ndarray]:
    """Return times [s] of the course and force on the wall [N], empty without a contact."""
    begin = collector.table(interfaces.HEAD_POSE)[-1, 0] - course.times[-1]
    rows = collector.table(interfaces.CONTACT_WRENCH)
    times = rows[:, 0] - begin
    is_inside = (times >= 0.0) & (times <= course.times[-1])
    times, wrenches = times[is_inside], rows[is_inside, 1:]
    yaws = np.interp(times, course.times, course.heads[:, 2])
    return times, np.array([Facade.force_on_wall(Pose(0.0, 0.0, yaw), Wrench(*wrench))
                            for yaw, wrench in zip(yaws, wrenches, strict=True)])

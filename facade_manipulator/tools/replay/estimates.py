"""The estimator of the disturbance fed with the recorded sensors once more."""

from __future__ import annotations

from heapq import merge

import numpy as np

from facade_manipulator import estimation
from facade_manipulator.blackbox import RecordedRun
from facade_manipulator.errors import RecordError
from facade_manipulator.kinematics import Pose
from facade_manipulator.messages import estimate_numbers, projected, seconds
from facade_manipulator.tools.replay.parameters import ESTIMATOR
from facade_manipulator.tools.replay.poses import Comparison, noted, settling_of

ESTIMATES = 'disturbance_odometry'


def replay_estimates(run: RecordedRun) -> Comparison:
    """
    Estimate the disturbance from the recorded sensors at the instants at which it was estimated.

    Where the wall is not known from the parameters, constant offsets do not count: the rail was
    at 0 where it was at the start.
    """
    if ESTIMATOR not in run.parameters:
        raise RecordError(f'the parameters of {ESTIMATOR} are not in the recording')
    setup = estimation.EstimatorSetup.of(run.parameters[ESTIMATOR])
    taken = estimation.inputs(setup)
    estimator = estimation.DisturbanceEstimator(setup)
    rejections: list[str] = []
    pairs = []
    for now, topic, message in merge(*(
            [(one.time, topic, one.message) for one in run.topics[topic]]
            for topic in (*taken, ESTIMATES)), key=lambda item: item[0]):
        if topic in taken:
            with noted(rejections):
                taken[topic].add(estimator, topic, now, seconds(message.header.stamp),
                                 taken[topic].numbers_of(message))
            continue
        motion = estimator.advance(now)
        if motion is not None:
            stamp = seconds(message.header.stamp)
            pairs.append((stamp, projected(estimate_numbers(message)[:7], topic)[0], Pose(*(
                place + speed * (stamp - motion.stamp)  # the same instant, not a sample beside
                for place, speed in zip(motion.pose, motion.velocity, strict=True)))))
    compared = Comparison.of(pairs, run.begin + settling_of(run), rejections)
    return compared if setup.is_wall_known or not len(compared.errors) else compared._replace(
        replayed=compared.replayed - np.median(compared.errors, axis=0))

"""
A recording of the black box once more: what the software of today does with what came in then.

In: a `RecordedRun`. Out: corrected poses and setpoints beside the recorded ones (`replay_poses`),
and how simulated drives stop for the recorded causes (`replay_stop`); `python -m` makes a report.
"""

from facade_manipulator.replay.poses import Comparison, replay_poses, replay_setpoints
from facade_manipulator.replay.stop import replay_stop, StopReplay

__all__ = [
    'Comparison',
    'replay_poses',
    'replay_setpoints',
    'replay_stop',
    'StopReplay',
]

"""
A recording of the black box once more: what the software of today does with what came in then.

In: a `RecordedRun`. Out: estimates of the disturbance, corrected poses and setpoints beside the
recorded ones (`replay_estimates`, `replay_poses`, `replay_setpoints`), and how simulated drives
stop for the recorded causes (`replay_stop`); `python -m` makes a report.
"""

from .estimates import replay_estimates as replay_estimates
from .poses import Comparison as Comparison
from .poses import replay_poses as replay_poses
from .poses import replay_setpoints as replay_setpoints
from .stop import replay_stop as replay_stop
from .stop import StopReplay as StopReplay

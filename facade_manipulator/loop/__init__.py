"""
The control loop in a process of its own, which no library of the node's can hold up.

In: a `LoopSetup`, setpoints, requests and live parameters, over a channel that never waits. Out:
one state a cycle, replies, rejections. When the node ends or hangs, the loop ramps the carriages
down and powers them off; when the loop ends, the drives miss its heartbeat and stop.
"""

from facade_manipulator.loop.control_loop import (
    assemble,
    checked_follower,
    LoopSetup,
    StreamStatus,
)
from facade_manipulator.loop.process import LoopProcess, start_process
from facade_manipulator.loop.stopping import Outcome, StoppingAnalysis

__all__ = [
    'assemble',
    'checked_follower',
    'LoopProcess',
    'LoopSetup',
    'Outcome',
    'start_process',
    'StoppingAnalysis',
    'StreamStatus',
]

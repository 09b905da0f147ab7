"""
The control loop in a process of its own, which no library of the node's can hold up.

In: a `LoopSetup`, setpoints, requests and live parameters, over a channel that never waits. Out:
one state a cycle, replies, rejections. When the node ends or hangs, the loop ramps the carriages
down and powers them off; when the loop ends, the drives miss its heartbeat and stop.
"""

from .control_loop import assemble as assemble
from .control_loop import checked_follower as checked_follower
from .control_loop import LoopSetup as LoopSetup
from .control_loop import Simulator as Simulator
from .control_loop import StreamStatus as StreamStatus
from .process import LoopClient as LoopClient
from .process import start_process as start_process
from .stopping_analysis import Outcome as Outcome
from .stopping_analysis import StoppingAnalysis as StoppingAnalysis

"""
The control loop in a separate process, so that no library of the node can delay it.

In: a `LoopSetup`, setpoints, requests and live parameters, over a channel that never waits. Out:
states, replies, rejections. When the node ends or hangs, the loop ramps the carriages
down and powers them off; when the loop ends, the drives miss its heartbeat and stop.
"""

"""
Control loop in a separate process, which libraries of the node cannot delay.

The loop receives a `LoopSetup`, setpoints, requests and live parameters over a channel that never
waits. The loop sends states, replies and rejections. When the node ends or hangs, the loop ramps
the carriages down and powers them off. When the loop ends, the drives miss its heartbeat and stop.
"""

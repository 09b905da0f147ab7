"""
The drive controller: one control thread that owns the bus.

In: an axis configuration, access to the bus, the mechanism that is moved, and an operator's
requests. Out: targets on the bus once per SYNC, and a snapshot of one cycle for whoever asks.
"""

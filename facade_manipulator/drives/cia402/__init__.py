"""
Drives after CiA 402: state tables, units, profiles, homing, and three axes as one group.

In: what a drive has sent (statusword, mode, position, age). Out: controlwords, modes and targets
of the next cycle, and causes of stops. Knows no bus and no clock: time and feedback are
arguments.
"""

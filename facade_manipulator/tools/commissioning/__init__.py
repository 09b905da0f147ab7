"""
From a box of new drives to a machine that homes: the tool `commission`.

In: a CAN bus, a parameter file, somebody at the machine. Out: node ids, stored objects, a
parameter file with what was measured. It talks CAN itself, and never beside a driver.
"""

"""
From a box of new drives to a machine that homes: the tool `commission`.

In: a CAN bus, a parameter file, an operator at the machine. Out: node ids, stored objects, a
parameter file with the results. It opens the CAN bus itself, and never beside a driver.
"""

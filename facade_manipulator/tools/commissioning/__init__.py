"""
The tool `commission`: set up new drives until the machine homes.

In: a CAN bus, a parameter file, an operator at the machine. Out: node ids, stored objects, a
parameter file with the results. The tool opens the CAN bus itself, and never beside a driver.
"""

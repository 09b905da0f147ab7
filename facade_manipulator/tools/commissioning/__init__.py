"""
Tool `commission`: sets up new drives until the machine can home.

The tool needs a CAN bus, a parameter file and an operator at the machine. Its results are node
ids, stored objects and a parameter file. The tool opens the CAN bus itself, and never while a
driver uses it.
"""

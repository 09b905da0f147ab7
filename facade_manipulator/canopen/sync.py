"""
SYNC of a drive that sends it itself, as its object 1005h says.

References
----------
CiA 301: synchronisation object.

"""

PRODUCER = 1 << 30  # bit of 1005h: the node sends SYNC with the period 1006h

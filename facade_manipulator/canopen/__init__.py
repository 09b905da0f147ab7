"""
CANopen (CiA 301) on a python-can bus: frames, SYNC, NMT, SDO, PDO and EMCY as tables and codecs.

In: an open interface and bytes. Out: frames, decoded messages, and errors that name object,
value and next step. The package is independent of motors.
"""

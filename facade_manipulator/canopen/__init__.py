"""
CANopen (CiA 301) on a python-can bus: frames, SYNC, NMT, SDO, PDO and EMCY.

The input is an open interface and its bytes. The output is frames, decoded messages, and errors
that name object, value and next step. The package is independent of motors.
"""

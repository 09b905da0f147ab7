"""
Network management: states of a node, commands of the master.

References
----------
CiA 301: network management, boot-up protocol, heartbeat protocol.

"""

from __future__ import annotations

from enum import IntEnum


class NmtState(IntEnum):
    """State of a node in its heartbeat; 0 is the boot-up message."""

    INITIALISING = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


class NmtCommand(IntEnum):
    """Command of the master."""

    START = 0x01
    STOP = 0x02
    ENTER_PRE_OPERATIONAL = 0x80
    RESET_NODE = 0x81
    RESET_COMMUNICATION = 0x82

"""
Network management: commands, boot-up message, and the heartbeat that drives monitor.

The library uses one name, such as ``'OPERATIONAL'``, for a state and for the command that leads to
this state.

References
----------
CiA 301: network management, error control protocols, objects 100Ch, 1016h and 1017h.
CiA 302-2: NMT start-up 1F80h.

"""

from __future__ import annotations

from typing import NamedTuple

from canopen.nmt import NMT_COMMANDS, NMT_STATES

WAITS_FOR_START = 1 << 2  # bit of 1F80h: the node does not start itself
SUPERVISED_HEARTBEAT_BITS = 0x00FFFFFF  # of 1016h; the highest byte is reserved


def command(name: str, node_id: int) -> bytes:
    """Return the data of a command to a node; node 0 addresses all nodes."""
    return bytes([NMT_COMMANDS[name], node_id])


_STATE_NUMBERS = {name: number for number, name in NMT_STATES.items()}


def heartbeat(state: str) -> bytes:
    """Return the data of the heartbeat of a node in the given state."""
    return bytes([_STATE_NUMBERS[state]])


_STATE_BITS = 0x7F  # the highest bit is reserved


def state_number(data: bytes) -> int:
    """Return the state number in a heartbeat; 0 is the boot-up message."""
    return data[0] & _STATE_BITS


class SupervisedHeartbeat(NamedTuple):
    """Heartbeat that a drive monitors (1016h); a time-out of 0 switches monitoring off."""

    node_id: int
    timeout: int  #: [ms]

    @classmethod
    def decode(cls, value: int) -> SupervisedHeartbeat:
        """Decode an object value, whose highest byte is reserved."""
        return cls(value >> 16 & 0xFF, value & 0xFFFF)

    def encode(self) -> int:
        """Encode the value of the object."""
        return self.node_id << 16 | self.timeout

"""Bring up lo and a vcan interface in this network namespace, without iproute2."""

from __future__ import annotations

import fcntl
import os
import socket
import struct

RTM_NEWLINK = 16
NLM_F_REQUEST, NLM_F_ACK, NLM_F_CREATE = 0x1, 0x4, 0x400
NLMSG_ERROR = 2
IFLA_IFNAME, IFLA_LINKINFO, IFLA_INFO_KIND = 3, 18, 1
SIOCGIFFLAGS, SIOCSIFFLAGS = 0x8913, 0x8914
IFF_UP, IFF_MULTICAST = 0x1, 0x1000


def bring_up(interface: str = 'vcan0') -> None:
    """Bring up lo, with multicast for DDS, and `interface`; raise OSError with what is missing."""
    set_flags('lo', IFF_UP | IFF_MULTICAST)
    add_vcan(interface)
    set_flags(interface, IFF_UP)


def add_vcan(interface: str) -> None:
    """Create a virtual CAN interface (rtnetlink, RTM_NEWLINK of kind vcan)."""
    kind = attribute(IFLA_INFO_KIND, b'vcan')
    body = (
        struct.pack('=BxHiII', socket.AF_UNSPEC, 0, 0, 0, 0)
        + attribute(IFLA_IFNAME, interface.encode() + b'\0')
        + attribute(IFLA_LINKINFO, kind)
    )
    flags = NLM_F_REQUEST | NLM_F_ACK | NLM_F_CREATE
    with socket.socket(
        socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE
    ) as netlink:
        netlink.send(
            struct.pack('=IHHII', 16 + len(body), RTM_NEWLINK, flags, 1, 0) + body
        )
        reply = netlink.recv(4096)
    (message_type,) = struct.unpack_from('=H', reply, 4)
    (code,) = struct.unpack_from('=i', reply, 16)
    if message_type != NLMSG_ERROR or code:
        raise OSError(
            -code,
            f'the kernel cannot make {interface} of type vcan: {os.strerror(-code)}',
        )


def attribute(kind: int, payload: bytes) -> bytes:
    """Encode one netlink attribute, padded to four bytes."""
    return (struct.pack('=HH', 4 + len(payload), kind) + payload).ljust(
        (7 + len(payload)) & ~3, b'\0'
    )


def set_flags(interface: str, flags: int, is_set: bool = True) -> None:
    """Set or clear flags, such as IFF_UP, of an interface."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as handle:
        request = struct.pack('16sH14x', interface.encode(), 0)
        (present,) = struct.unpack_from(
            '=H', fcntl.ioctl(handle, SIOCGIFFLAGS, request), 16
        )
        wanted = present | flags if is_set else present & ~flags
        fcntl.ioctl(
            handle, SIOCSIFFLAGS, struct.pack('16sH14x', interface.encode(), wanted)
        )


def clear_flags(interface: str, flags: int) -> None:
    """Clear flags, such as IFF_UP, of an interface."""
    set_flags(interface, flags, False)

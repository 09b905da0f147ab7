"""Bring up the loopback and a vcan interface in this network namespace, without iproute2."""

from __future__ import annotations

from collections.abc import Callable
import fcntl
import os
import socket
import struct

RTM_NEWLINK, RTM_NEWQDISC, RTM_DELQDISC = 16, 36, 37
NLM_F_REQUEST, NLM_F_ACK, NLM_F_REPLACE, NLM_F_CREATE = 0x1, 0x4, 0x100, 0x400
NLMSG_ERROR = 2
IFLA_IFNAME, IFLA_LINKINFO, IFLA_INFO_KIND = 3, 18, 1
TCA_KIND, TCA_OPTIONS, TC_H_ROOT = 1, 2, 0xFFFFFFFF
TCQ_PLUG_LIMIT, NO_BYTES = 3, 0
SIOCGIFFLAGS, SIOCSIFFLAGS = 0x8913, 0x8914
IFF_UP, IFF_MULTICAST = 0x1, 0x1000


def bring_up(interface: str = 'vcan0') -> None:
    """Bring up lo, with multicast for DDS, and `interface`; OSError says what is lacking."""
    set_flags('lo', IFF_UP | IFF_MULTICAST)
    add_vcan(interface)
    set_flags(interface, IFF_UP)


def add_vcan(interface: str) -> None:
    """Create a virtual CAN interface (rtnetlink, RTM_NEWLINK of kind vcan)."""
    kind = attribute(IFLA_INFO_KIND, b'vcan')
    body = (struct.pack('=BxHiII', socket.AF_UNSPEC, 0, 0, 0, 0)
            + attribute(IFLA_IFNAME, interface.encode() + b'\0') + attribute(IFLA_LINKINFO, kind))
    ask(RTM_NEWLINK, NLM_F_CREATE, body, f'the kernel makes no {interface} of type vcan')


def plug(interface: str) -> None:
    """Let the interface reject every frame with ENOBUFS (queueing discipline ``plug``)."""
    options = struct.pack('=iI', TCQ_PLUG_LIMIT, NO_BYTES)
    body = (queueing_of(interface) + attribute(TCA_KIND, b'plug\0')
            + attribute(TCA_OPTIONS, options))
    ask(RTM_NEWQDISC, NLM_F_CREATE | NLM_F_REPLACE, body, f'the kernel does not plug {interface}')


def unplug(interface: str) -> None:
    """Let the interface take frames again."""
    ask(RTM_DELQDISC, 0, queueing_of(interface), f'the kernel does not unplug {interface}')


def queueing_of(interface: str) -> bytes:
    """Encode which interface's outermost queueing discipline is meant (struct tcmsg)."""
    index = socket.if_nametoindex(interface)
    return struct.pack('=BxxxiIII', socket.AF_UNSPEC, index, 0, TC_H_ROOT, 0)


def ask(request: int, flags: int, body: bytes, rejection: str) -> None:
    """Send a request to the kernel's network configuration; OSError says what it rejects."""
    flags |= NLM_F_REQUEST | NLM_F_ACK
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as netlink:
        netlink.send(struct.pack('=IHHII', 16 + len(body), request, flags, 1, 0) + body)
        reply = netlink.recv(4096)
    message_type, = struct.unpack_from('=H', reply, 4)
    code, = struct.unpack_from('=i', reply, 16)
    if message_type != NLMSG_ERROR or code:
        raise OSError(-code, f'{rejection}: {os.strerror(-code)}')


def attribute(kind: int, payload: bytes) -> bytes:
    """Encode one netlink attribute, padded to four bytes."""
    return (struct.pack('=HH', 4 + len(payload), kind) + payload).ljust((7 + len(payload)) & ~3,
                                                                       b'\0')


def set_flags(interface: str, flags: int) -> None:
    """Add flags, such as IFF_UP, to an interface."""
    change_flags(interface, lambda present: present | flags)


def clear_flags(interface: str, flags: int) -> None:
    """Take flags, such as IFF_UP, from an interface."""
    change_flags(interface, lambda present: present & ~flags)


def change_flags(interface: str, change: Callable[[int], int]) -> None:
    """Change the flags of an interface."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as handle:
        request = struct.pack('16sH14x', interface.encode(), 0)
        present, = struct.unpack_from('=H', fcntl.ioctl(handle, SIOCGIFFLAGS, request), 16)
        fcntl.ioctl(handle, SIOCSIFFLAGS,
                    struct.pack('16sH14x', interface.encode(), change(present)))

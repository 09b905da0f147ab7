"""
Say to systemd that a node is ready, alive or ending, where systemd has started it.

References
----------
sd_notify(3) and systemd.service(5), ``Type=notify`` and ``WatchdogSec=``.

"""

from __future__ import annotations

from contextlib import suppress
import os
import socket

MARGIN = 0.5  # share of the watchdog's time after which it is fed, as sd_watchdog_enabled(3) says


class ServiceManager:
    """
    The datagram socket that systemd names in the environment; without it nothing is sent.

    Attributes
    ----------
    feed_period : float or None
        How often `feed` must be called [s]; None where no watchdog waits for this process.

    """

    def __init__(self) -> None:
        self._address = os.environ.pop('NOTIFY_SOCKET', '')  # no child speaks for the node
        timeout = os.environ.pop('WATCHDOG_USEC', '0')
        for_us = os.environ.pop('WATCHDOG_PID', str(os.getpid())) == str(os.getpid())
        watched = self._address and for_us and timeout.isdecimal() and int(timeout) > 0
        self.feed_period = MARGIN * 1e-6 * int(timeout) if watched else None

    def ready(self) -> None:
        """Say that the node has started."""
        self._send(b'READY=1')

    def feed(self) -> None:
        """Feed the watchdog."""
        self._send(b'WATCHDOG=1')

    def stopping(self) -> None:
        """Say that the node ends: it may take its time for the drives."""
        self._send(b'STOPPING=1')

    def _send(self, state: bytes) -> None:
        if not self._address:
            return
        address = self._address.replace('@', '\0', 1) if self._address[0] == '@' else self._address
        with suppress(OSError), socket.socket(
                socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK) as sender:
            sender.sendto(state, address)

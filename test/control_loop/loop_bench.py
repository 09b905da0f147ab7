"""Control loop in a thread of the test, for nodes that start the loop."""

from __future__ import annotations

import itertools
import os
import socket
import subprocess
from threading import Thread

from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.control_loop.channel import Channel
from facade_manipulator.control_loop.control_loop import ControlLoop, LoopSetup
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.kinematics import Geometry

PATIENCE = 20.0  # s
# a busy computer must fail no test of something else
CONTROLLER = ControllerSettings(
    boot_timeout=0.5, hold_cycles=3, max_missed_cycles=10,
    heartbeat_timeout=0.5)
_channels = itertools.count()


def loop_setup() -> LoopSetup:
    """Return a setup with simulated drives on a separate virtual bus."""
    return LoopSetup(
        Geometry(), CONTROLLER, DEFAULT_AXES,
        BusSettings(channel=f'loop {os.getpid()} {next(_channels)}'),
        simulate='facade_manipulator.simulation.drives.simulator:start_simulator')


class LoopThread:
    """Control loop in a thread of this process, which replaces `start_process`."""

    def __init__(self, end: socket.socket) -> None:
        self._channel = Channel(end.dup())
        self.loop: ControlLoop | None = None
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        self.loop = ControlLoop(*self._channel.receive(PATIENCE)[1], self._channel)
        try:
            self.loop.serve()
        finally:
            self.loop.close()

    def wait(self, timeout: float) -> int:
        """Wait for the end; see `subprocess.Popen`."""
        self._thread.join(timeout)
        if self._thread.is_alive():
            raise subprocess.TimeoutExpired('control loop', timeout)
        return 0

    def kill(self) -> None:
        """End the loop in order, because a thread cannot be killed."""
        self.loop.end()

"""The control loop with simulated drives, in a process or in a thread that can be looked into."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
import itertools
import math
import os
import socket
import subprocess
from threading import Event, Thread
import time

import can
from drive_rig import HOME, PATIENCE
from drive_rig import SETTINGS as CONTROLLER
from support import wait_until

from facade_manipulator.canopen.link import BusSettings
from facade_manipulator.control_loop.channel import Channel
from facade_manipulator.control_loop.control_loop import ControlLoop, LoopSetup
from facade_manipulator.control_loop.process import LoopClient, start_process
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.errors import ManipulatorError
from facade_manipulator.kinematics import Geometry
from facade_manipulator.motion.follower import StreamSettings
from facade_manipulator.motion.limits import MotionLimits
from facade_manipulator.motion.setpoints import Setpoint
from facade_manipulator.simulation.drives.simulator import start_simulator

AMPLITUDE, FREQUENCY, AHEAD, PERIOD = 0.12, 0.53, 0.06, 0.01
FAST = 0.35  # m/s, of 0.4, from which a drive that holds stops within its following-error window
_channels = itertools.count()


def loop_setup(controller: ControllerSettings = CONTROLLER) -> LoopSetup:
    """Return a setup on a virtual bus of its own."""
    bus = BusSettings(channel=f'loop {os.getpid()} {next(_channels)}')
    return LoopSetup(
        Geometry(), controller, DEFAULT_AXES, bus, StreamSettings(), MotionLimits(),
        simulate=start_simulator)


def serve(loop: ControlLoop) -> None:
    """Run a loop to its end."""
    try:
        loop.serve()
    finally:
        loop.close()


class LoopThread:
    """The control loop in a thread of this process; launches it in place of `start_process`."""

    def __init__(self, end: socket.socket) -> None:
        self._channel = Channel(end.dup())
        self.loop: ControlLoop | None = None
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        self.loop = ControlLoop(*self._channel.receive(PATIENCE).content, self._channel)
        serve(self.loop)

    def wait(self, timeout: float) -> int:
        """Wait for the end; see `subprocess.Popen`."""
        self._thread.join(timeout)
        if self._thread.is_alive():
            raise subprocess.TimeoutExpired('control loop', timeout)
        return 0

    def kill(self) -> None:
        """End it in order: a thread cannot be killed."""
        self.loop.end()


class LoopBench:
    """A loop, a node's side of it that feeds its watchdog, and a stream of setpoints."""

    def __init__(
        self, setup: LoopSetup | None = None, launch: Callable = start_process,
    ) -> None:
        self.setup = setup or loop_setup()
        self.rejections: list[tuple[str, str]] = []
        self.listener = can.Bus(
            interface='virtual', channel=self.setup.bus.channel, ignore_config=True)
        self.process = LoopClient(
            self.setup, lambda *rejection: self.rejections.append(rejection), launch)
        self.feeds, self.streams = Event(), Event()
        self.feeds.set()
        self._begin = 0.0
        self._ended = Event()
        self._thread = Thread(target=self._run, daemon=True)
        self._thread.start()

    @property
    def loop(self) -> ControlLoop:
        """The loop itself, if it is in a thread."""
        return self.process._process.loop

    def _run(self) -> None:
        for number in itertools.count():
            if self._ended.wait(PERIOD):
                return
            if self.feeds.is_set() and number % 2 == 0:
                self.process.feed()
            self.process.read()
            if self.streams.is_set():
                self.process.send_setpoint(self.setpoint())

    def setpoint(self) -> Setpoint:
        """Return where all carriages should be soon, to and fro from home."""
        now = time.time() + AHEAD
        angle = 2.0 * math.pi * FREQUENCY * (now - self._begin)
        shift = AMPLITUDE * (1.0 - math.cos(angle))
        speed = AMPLITUDE * 2.0 * math.pi * FREQUENCY * math.sin(angle)
        return Setpoint(now, tuple(q + shift for q in HOME), (speed,) * 3)

    def do(self, *names: str):
        """Ask for one thing after another; return the last answer."""
        for name in names:
            answer = self.process.request(name).result(PATIENCE)
        return answer

    @property
    def state(self) -> ControllerState:
        return self.process.snapshot().state

    def until(self, *states: ControllerState) -> None:
        """Wait for a state of the controller."""
        wait_until(lambda: self.state in states, str(states))

    def move(self) -> None:
        """Bring the drives up and let the carriages go to and fro, until they are fast."""
        self.do('configure', 'home', 'activate')
        self._begin = time.time() + AHEAD
        self.streams.set()
        wait_until(lambda: abs(self.process.snapshot().axes[0].velocity or 0.0) > FAST, 'speed')

    def frames(self) -> list[can.Message]:
        """Return what was on the bus since this was last asked, if it is in this process."""
        frames = []
        while (message := self.listener.recv(0.0)) is not None:
            frames.append(message)
        return frames

    def close(self) -> None:
        """End everything."""
        self._ended.set()
        self._thread.join()
        with suppress(ManipulatorError):  # of what a test has done to its loop
            self.process.close()
        self.listener.shutdown()

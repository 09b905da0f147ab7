"""The control loop on the fake bus world, with a node whose messages a test makes up."""

from __future__ import annotations

from collections import deque
from contextlib import contextmanager
from dataclasses import replace
import math
import pickle

from bus_world import Rig, SETTINGS
import pytest

from facade_manipulator.control_loop.channel import ChannelClosedError, Message
from facade_manipulator.control_loop.control_loop import ControlLoop, LoopSetup
from facade_manipulator.kinematics import Geometry

FEED_PERIOD = 0.02  # s
PATIENCE = 10.0  # s


class Node:
    """The node's end of the channel: messages to the loop, and what the loop has sent."""

    def __init__(self, rig: Rig) -> None:
        self.feeds, self.has_ended = True, False
        self.sent: list[tuple[str, tuple]] = []
        self.pause_at = math.inf  #: when `serve` returns to the test [s]
        self._rig, self._inbox = rig, deque()

    def say(self, kind: str, *content: object) -> None:
        self._inbox.append(Message(kind, pickle.dumps(content)))

    def receive(self, timeout: float) -> Message | None:
        if self.has_ended:
            raise ChannelClosedError('the other process has ended')
        if self._inbox:
            return self._inbox.popleft()
        if self._rig.clock.now >= self.pause_at:
            raise TimeoutError
        self._rig.run(FEED_PERIOD)
        return Message('feed', pickle.dumps(())) if self.feeds else None

    def send(self, kind: str, *content: object, must_arrive: bool = False) -> bool:
        if self.has_ended:
            raise ChannelClosedError('the other process has ended')
        self.sent.append((kind, content))
        return True

    def close(self) -> None:
        self.has_ended = True

    def replies(self) -> list[tuple]:
        return [content for kind, content in self.sent if kind == 'reply']


class Simulator:
    """The simulated drives of a rig, for messages that disturb them."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig

    @contextmanager
    def access(self):
        yield self._rig.drives

    def apply_forces(self, forces) -> None:
        for drive, force in zip(self._rig.drives, forces, strict=True):
            drive.motor.external_force = force

    def stop(self) -> None:
        """Leave the drives on the bus: the test looks at them."""


class LoopRig(Rig):
    """A control loop between its node and three simulated drives."""

    def __init__(self, simulates: bool = True, **changes: object) -> None:
        settings = replace(SETTINGS, **changes)
        super().__init__(settings)
        self.node = Node(self)
        self.controller.start = lambda: None
        self.controller.close = lambda: self.request('close')
        self.loop = ControlLoop(
            LoopSetup(Geometry(), settings, self.axes,
                      simulate=(lambda *_: Simulator(self)) if simulates else None),
            self.node, self.clock, (self.follower, self.controller))
        send_state = self.loop._send_state
        self.loop._send_state = lambda snapshot: (send_state(snapshot), self._observe(snapshot))

    def serve(self, seconds: float = PATIENCE) -> bool:
        """Let the loop serve its node for a while [s]; return whether it has ended by then."""
        self.node.pause_at = self.clock.now + seconds
        try:
            self.loop.serve()
        except TimeoutError:
            return False
        self.loop.close()
        return True


@pytest.fixture
def make_loop():
    """Make control loops on a fake bus."""
    return LoopRig

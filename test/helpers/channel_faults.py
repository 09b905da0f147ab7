"""What can happen between node and control loop while the carriages move, and what must follow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
import os
from pathlib import Path
import pickle
import signal
import socket
import subprocess
import sys
from threading import Event, Thread
import time

from loop_bench import CONTROLLER, FAST, loop_setup, PATIENCE, serve
from support import wait_until

from facade_manipulator.drives.cia402.states import State
from facade_manipulator.drives.controller.settings import ControllerSettings
from facade_manipulator.drives.controller.snapshot import ControllerState
from facade_manipulator.loop.channel import Channel, socket_pair
from facade_manipulator.loop.control_loop import ControlLoop
from facade_manipulator.motion.follower import Activity

NODE = Path(__file__).with_name('loop_node.py')
REST = 0.002  # m/s
STEP = 0.001  # s


class IsolatedNode:
    """A loop with its drives in a thread of this process, its node in another process."""

    def __init__(self, controller: ControllerSettings = CONTROLLER) -> None:
        self.watchdog_timeout = controller.watchdog_timeout
        self._control, theirs = socket_pair()
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, NODE, str(theirs.fileno())], pass_fds=(theirs.fileno(),))
        self._control.send(pickle.dumps(loop_setup(controller)))
        _, (end,), *_ = socket.recv_fds(self._control, 64, 1)
        channel = Channel(socket.socket(fileno=end))
        self.loop = ControlLoop(*channel.receive(PATIENCE).content, channel)
        self._thread = Thread(target=serve, args=(self.loop,), daemon=True)
        self._thread.start()
        self._frozen = Event()
        self._control.settimeout(PATIENCE)
        assert self._control.recv(64) == b'moving'

    def order(self, name: str, *arguments: float) -> None:
        """Let the node do something of `loop_node`."""
        self._control.send(pickle.dumps((name, *arguments)))

    def kill(self) -> None:
        self.process.kill()

    def stop(self) -> None:
        os.kill(self.process.pid, signal.SIGSTOP)

    def freeze(self) -> None:
        """Let the loop send nothing more, as if it were killed."""
        self.loop.controller._session.exchange.turn = self._wait_frozen

    def _wait_frozen(self) -> float:
        self._frozen.wait()
        return time.monotonic()

    @property
    def has_ended(self) -> bool:
        return not self._thread.is_alive()

    @property
    def drive_states(self) -> set[State]:
        return {drive.state for drive in self.loop.simulator._drives}

    def motors(self) -> tuple[float, float, float]:
        """Return speed of the fastest carriage [m/s] and the two gaps' widths [m]."""
        with self.loop.simulator.access() as drives:
            q1, q2, q3 = (drive.motor.carriage_position for drive in drives)
            return max(abs(drive.motor.velocity) for drive in drives), q3 - q1, q2 - q3

    def close(self) -> None:
        self._frozen.set()
        self.process.kill()
        self.process.wait()
        self._control.close()
        self._thread.join(PATIENCE)


@dataclass(frozen=True)
class Fault:
    """
    What happens, and what must follow: `ends` in order, `quick_stops`, or goes on by itself.

    A loop that goes on has braked meanwhile if `brakes`.
    """

    inject: Callable[[IsolatedNode], None]
    ends: bool = False
    quick_stops: bool = False
    brakes: bool = False


FAULTS = {
    'node killed': Fault(IsolatedNode.kill, ends=True),
    'node stopped (SIGSTOP)': Fault(IsolatedNode.stop, ends=True, brakes=True),
    "the node's interpreter held": Fault(
        lambda node: node.order('hold_lock', 0.5 * node.watchdog_timeout), brakes=True),
    'half messages': Fault(lambda node: node.order('send_half')),
    'channel full': Fault(lambda node: node.order('read_nothing')),
    'loop killed': Fault(IsolatedNode.freeze, quick_stops=True),
}


@dataclass(frozen=True)
class Reaction:
    """When the carriages slowed down and stood [s], None if they went on; how gaps changed [m]."""

    slower: float | None
    at_rest: float | None
    gap_change: float


def prove(node: IsolatedNode, fault: Fault) -> Reaction:
    """Let something happen to a node whose carriages move; check what follows and measure it."""
    wait_until(lambda: node.motors()[0] > FAST, 'speed')
    brakes = node.loop.follower.brakes
    begin, (speed, *gaps) = time.monotonic(), node.motors()
    fault.inject(node)
    slower = at_rest = None
    change, must_rest = 0.0, fault.ends or fault.quick_stops or fault.brakes
    end = begin + (PATIENCE if must_rest else 1.0)
    while time.monotonic() < end and (at_rest is None or slower is None):
        now = time.monotonic() - begin
        speed, *present = node.motors()
        change = max(change, *(abs(a - b) for a, b in zip(gaps, present, strict=True)))
        slows = node.loop.follower.activity is Activity.BRAKING or (
            node.drive_states != {State.OPERATION_ENABLED})
        if slower is None and slows:
            slower = now
        if must_rest and speed < REST and (slower or fault.quick_stops):
            at_rest = at_rest or now
        time.sleep(STEP)
    _check(node, fault, brakes)
    return Reaction(slower, at_rest, change)


def _check(node: IsolatedNode, fault: Fault, brakes: int) -> None:
    if fault.ends:
        wait_until(lambda: node.has_ended, 'the end of the loop')
        assert node.loop.controller.snapshot().state is ControllerState.CLOSED
        assert node.drive_states == {State.SWITCH_ON_DISABLED}
    elif fault.quick_stops:
        wait_until(lambda: not node.drive_states & {State.OPERATION_ENABLED}, 'the drives to stop')
    else:
        wait_until(lambda: node.loop.follower.activity in (Activity.FOLLOWING, Activity.LIMITED)
                   and node.motors()[0] > FAST, 'the carriages to go on')
        assert node.loop.controller.snapshot().state is ControllerState.ACTIVE
        assert (node.loop.follower.brakes > brakes) is fault.brakes


def measure(repeat: int) -> dict[str, list[Reaction]]:
    """Prove each fault a number of times with the project's own bounds."""
    found: dict[str, list[Reaction]] = {name: [] for name in FAULTS}
    settings = replace(CONTROLLER, max_missed_cycles=3, heartbeat_timeout=0.15)
    for name in [*FAULTS] * repeat:
        node = IsolatedNode(settings)
        try:
            found[name].append(prove(node, FAULTS[name]))
        finally:
            node.close()
    return found

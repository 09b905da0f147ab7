"""
First fault of a process: `python first_fault.py` prints the computation of each fault as JSON.

A process is forked for each fault, while the drives follow a stream. Reported are the files and
modules that the controller opens or imports until it has commanded the stop, and the maximum
number of function calls in one of its turns. The simulated drives and the bus of the test are not
counted.
"""

from __future__ import annotations

from functools import cache
import json
import logging
from logging.handlers import QueueHandler
import os
from pathlib import Path
from queue import SimpleQueue
import sys
from types import FrameType

HELPERS = Path(__file__).parents[1] / 'helpers'
sys.path.insert(0, str(HELPERS))

from bus_world import in_motion, Rig  # noqa: E402

from facade_manipulator.canopen import cob_ids  # noqa: E402
from facade_manipulator.errors import BusError, ManipulatorError  # noqa: E402

LOADING = {'import', 'open', 'compile', 'exec'}
COMMANDS = 3  # frames, one for each drive
SIMULATED = (str(HELPERS), f'{os.sep}simulation{os.sep}')


def send_emergency(rig: Rig) -> None:
    """Let a drive report an overcurrent."""
    rig.deliver([(cob_ids.EMERGENCY + 2, bytes.fromhex('1023010000000000'))])


def fail(rig: Rig) -> None:
    """Put a drive into its state of fault."""
    rig.drives[1].inject_fault(0x2310)


def silence(rig: Rig) -> None:
    """Let a drive answer no longer."""
    rig.drives[1].is_silent = True


def push(rig: Rig) -> None:
    """Move a carriage away from its targets."""
    rig.drives[1].motor.place(rig.drives[1].motor.carriage_position + 0.03)


def reject_targets(rig: Rig) -> None:
    """Let the follower reject a target."""

    def sample(_: float) -> tuple[float, float, float]:
        raise ManipulatorError('the test rejects a target')

    rig.follower.sample = sample


def break_follower(rig: Rig) -> None:
    """Let the follower raise an unexpected error."""

    def sample(_: float) -> tuple[float, float, float]:
        raise ZeroDivisionError

    rig.follower.sample = sample


def break_supervision(rig: Rig) -> None:
    """Let the supervision of the controller raise an unexpected error."""
    supervise = rig.controller.targets.supervise

    def fail_once(_: float) -> None:
        rig.controller.targets.supervise = supervise
        raise ZeroDivisionError

    rig.controller.targets.supervise = fail_once


def lose_bus(rig: Rig) -> None:
    """Let the bus fail."""
    rig.bus_error = BusError('can0 is down')


def command_from_another_master(rig: Rig) -> None:
    """Send a network command from another master."""
    rig.forge(cob_ids.NMT, bytes([128, 2]))


def forbid_power(rig: Rig) -> None:
    """Forbid power, as a software stop does."""
    rig.controller.forbid_power('software_stop was set')


def stop(rig: Rig) -> None:
    """Stop the drives, as the node does after an error."""
    rig.controller.stop('a callback has failed')


FAULTS = {
    'emergency': send_emergency,
    'fault': fail,
    'silence': silence,
    'push': push,
    'rejected target': reject_targets,
    'broken follower': break_follower,
    'broken supervision': break_supervision,
    'lost bus': lose_bus,
    'another master': command_from_another_master,
    'software stop': forbid_power,
    'stop': stop,
}


@cache
def is_of_simulation(file: str) -> bool:
    """Return whether code belongs to the simulated drives, or to the bus of the test."""
    return any(part in file for part in SIMULATED)


class Watch:
    """Counter of calls, files and modules in the turns of a controller."""

    def __init__(self, rig: Rig) -> None:
        self.loaded: list[str] = []
        self.most_calls = 0
        self._rig = rig
        self._turn = rig.controller.turn
        self._calls = 0
        self._is_active = False
        self._frames: int | None = None  # on the bus before the stop
        self._simulated = 0  # depth of calls into the simulation
        sys.addaudithook(self._hear)

    def turn(self) -> None:
        """Run a turn of the controller, and count its calls until the stop is commanded."""
        if self._is_commanded:
            self._turn()
            return
        self._calls = 0
        self._simulated = 0
        self._is_active = True
        sys.setprofile(self._profile)
        try:
            self._turn()
        finally:
            sys.setprofile(None)
            self._is_active = False
        self.most_calls = max(self.most_calls, self._calls)

    @property
    def _is_commanded(self) -> bool:
        """Return whether the controller has commanded the stop to all drives."""
        if self._rig.controller.group.is_stopped and self._frames is None:
            self._frames = len(self._rig.heard)
        return self._frames is not None and (
            len(self._rig.heard) >= self._frames + COMMANDS
        )

    @property
    def _is_counted(self) -> bool:
        """Return whether the controller computes, and has not commanded the stop yet."""
        return self._is_active and not self._simulated and not self._is_commanded

    def _profile(self, frame: FrameType, event: str, _: object) -> None:
        is_simulated = is_of_simulation(frame.f_code.co_filename)
        if event == 'call':
            self._simulated += is_simulated
            self._calls += self._is_counted
        elif event == 'return':
            self._simulated = max(0, self._simulated - is_simulated)

    def _hear(self, event: str, details: tuple[object, ...]) -> None:
        if event in LOADING and self._is_counted:
            self.loaded.append(f'{event} {details[0]}')


def run_fault(rig: Rig, name: str) -> None:
    """Run the fault and print what the controller has done until the drives have stopped."""
    watch = Watch(rig)
    rig.controller.turn = watch.turn
    FAULTS[name](rig)
    rig.run(0.5)
    result = {
        'name': name,
        'loaded': watch.loaded,
        'calls': watch.most_calls,
        'cause': rig.all_causes,
    }
    print(json.dumps(result), flush=True)


def main() -> None:
    """Run each fault in a process in which it is the first one."""
    logging.getLogger().addHandler(QueueHandler(SimpleQueue()))  # as the loop's process
    rig = Rig()
    in_motion(rig)
    # the checks reject defects of the controller
    rig.controller.observe = lambda _: None
    for name in FAULTS:
        child = os.fork()
        if child == 0:
            run_fault(rig, name)
            return
        _, status = os.waitpid(child, 0)
        if status:
            raise SystemExit(f'{name} ends with status {status}')


if __name__ == '__main__':
    main()

"""Sequences of requests: power and motion only in a life-cycle state that permits them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
import itertools
import os
import random

from bus_world import Rig
import pytest

from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.drives.states import State

pytestmark = pytest.mark.long

Sequence = tuple[tuple[str, int], ...]  # requests, each with the cycles before it

REQUESTS = (
    'activate',
    'halt',
    'clear_faults',
    'home',
    'deactivate',
    'cleanup',
    'configure',
)
#: life-cycle state before and after each transition
TRANSITIONS = {
    'configure': ('unconfigured', 'inactive'),
    'activate': ('inactive', 'active'),
    'deactivate': ('active', 'inactive'),
    'cleanup': ('inactive', 'unconfigured'),
}
#: states of the controller after a sequence, by life-cycle state
PERMITTED = {
    'unconfigured': {ControllerState.UNCONFIGURED},
    'inactive': {ControllerState.INACTIVE, ControllerState.STOPPED},
    'active': {ControllerState.ACTIVE, ControllerState.HALTED},
}
POWERING = {'activate', 'deactivate', 'home', 'halt'}
SWAY = 50_000  # counts/s, a speed that no drive reports at rest
SWAY_TIME = 0.45  # s
# sequences on one rig, before its carriages drift to the ends of the rail
RIG_LIFE = 49
LONGEST_END = 3.0  # s, until each request is answered and each step is completed


class LifeCycle:
    """
    Life cycle of the driver node, which rejects impossible transitions.

    It passes the other requests to the controller. `nodes/lifecycle.py` has the same rules.
    """

    def __init__(self) -> None:
        self.rig = Rig()
        self.label = 'unconfigured'
        self._pending: list[tuple[str, object]] = []
        self._swaying_until = 0.0
        for drive in self.rig.drives:
            self._let_sway(drive)

    def _let_sway(self, drive) -> None:
        read = drive.objects.readers[0x606C, 0]

        def read_swaying() -> int:
            return SWAY if self.rig.clock.now < self._swaying_until else read()

        drive.objects.readers[0x606C, 0] = read_swaying

    def sway(self) -> None:
        """Let the carriages seem to move for a while."""
        self._swaying_until = self.rig.clock.now + SWAY_TIME

    def ask(self, name: str) -> None:
        """Request a transition or a service, as a client of the node does."""
        if name in TRANSITIONS:
            is_busy = any(name in TRANSITIONS for name, _ in self._pending)
            if is_busy or self.label != TRANSITIONS[name][0]:
                return
        self._pending.append((name, self.rig.ask(name)))

    def cycles(self, number: int) -> None:
        """Run cycles, and check the power in each cycle."""
        for _ in range(number):
            self.rig.cycles(1)
            self._update()
            self._check_power()

    def settle(self) -> None:
        """Run until nothing changes any longer."""
        end = self.rig.clock.now + LONGEST_END
        while self._pending or not self._is_settled:
            assert self.rig.clock.now < end, (self.rig.state, self._pending)
            self.cycles(1)

    def end(self) -> None:
        """Run until nothing changes any longer, and check the state."""
        self.settle()
        self.cycles(5)
        assert self.rig.state in PERMITTED[self.label], (self.label, self.rig.state)

    def become(self, label: str, is_homed: bool = True) -> None:
        """Enter a life-cycle state by the usual requests."""
        while self.label != label or (is_homed and self._must_home):
            self.ask(self._request_towards(label))
            self.settle()

    def _request_towards(self, label: str) -> str:
        if self.rig.state is ControllerState.STOPPED:
            return 'clear_faults'
        if self.label == 'active':
            return 'deactivate'
        if self.label == 'unconfigured':
            return 'configure'
        if label == 'unconfigured':
            return 'cleanup'
        return 'home' if self._must_home else 'activate'

    @property
    def _must_home(self) -> bool:
        return self.label != 'unconfigured' and bool(self.rig.snapshot.unhomed)

    @property
    def _is_settled(self) -> bool:
        return self.rig.controller.group.is_settled or self.label == 'unconfigured'

    def _update(self) -> None:
        """Answer the completed requests, and leave a state that the drives have left."""
        state = self.rig.state
        completed = [entry for entry in self._pending if entry[1].done()]
        for name, job in completed:
            self._pending.remove((name, job))
            if name in TRANSITIONS and job.exception() is None:
                self.label = TRANSITIONS[name][1]
        if self.label == 'active' and not state.is_active:
            self.label = 'inactive'
        if self.label == 'inactive' and state is ControllerState.UNCONFIGURED:
            self.label = 'unconfigured'

    def _check_power(self) -> None:
        """Require that no drive is enabled without an active node or a pending request."""
        requested = {name for name, _ in self._pending}
        is_permitted = self.label == 'active' or requested & POWERING
        is_enabled = State.OPERATION_ENABLED in self.rig.drive_states
        assert is_permitted or not is_enabled, (self.label, self.rig.state)


# --- states before a sequence


def inactive(life: LifeCycle) -> None:
    life.become('inactive')


def inactive_swaying(life: LifeCycle) -> None:
    inactive(life)
    life.sway()


def unhomed(life: LifeCycle) -> None:
    life.become('unconfigured', is_homed=False)
    life.become('inactive', is_homed=False)


def activating(life: LifeCycle) -> None:
    inactive(life)
    life.ask('activate')
    life.cycles(15)


def active(life: LifeCycle) -> None:
    if life.rig.state is ControllerState.HALTED:
        life.ask('clear_faults')
        life.settle()
    life.become('active')
    life.cycles(15)


def active_swaying(life: LifeCycle) -> None:
    active(life)
    life.sway()


def halted(life: LifeCycle) -> None:
    active(life)
    life.ask('halt')
    life.settle()


def stopped(life: LifeCycle) -> None:
    active(life)
    life.rig.controller.stop('the operator stops')
    life.cycles(15)
    life.settle()


def unconfigured(life: LifeCycle) -> None:
    life.become('unconfigured', is_homed=False)


BEFORE: tuple[Callable[[LifeCycle], None], ...] = (
    unconfigured,
    unhomed,
    inactive,
    inactive_swaying,
    activating,
    active,
    active_swaying,
    halted,
    stopped,
)
before = pytest.mark.parametrize('before', BEFORE)


def check_sequences(
    before: Callable[[LifeCycle], None], sequences: Iterable[Sequence]
) -> None:
    """Run each sequence of requests from a state; name the sequence that fails."""
    for number, sequence in enumerate(sequences):
        if number % RIG_LIFE == 0:
            life = LifeCycle()
        life.rig.stream(amplitude=-0.06 if number % 2 else 0.06)
        try:
            before(life)
            for name, pause in sequence:
                life.cycles(pause)
                life.ask(name)
            life.end()
        except AssertionError as error:
            raise AssertionError(f'{before.__name__}: {sequence}') from error


PAUSES = (0, 1, 20)  # cycles
RUNS_ALL = bool(os.environ.get('ALL_SEQUENCES'))  # ALL_SEQUENCES=1 takes some minutes
TRIPLES = 343 if RUNS_ALL else 24  # of 343 sequences of three requests


@before
def test_two_requests_leave_no_power_without_permission(before):
    """Each pair has one of the pauses, another one in the next state before it."""
    sequences = []
    for number, pair in enumerate(itertools.product(REQUESTS, repeat=2)):
        chosen = PAUSES[(number + BEFORE.index(before)) % len(PAUSES)]
        for pause in PAUSES if RUNS_ALL else (chosen,):
            sequences.append(((pair[0], 0), (pair[1], pause)))
    check_sequences(before, sequences)


@before
def test_three_requests_leave_no_power_without_permission(before):
    triples = [*itertools.product(REQUESTS, repeat=3)]
    sequences = []
    for names in random.Random(before.__name__).sample(triples, TRIPLES):
        sequences.append(tuple((name, 0) for name in names))
    check_sequences(before, sequences)

"""State machine of the three axes, with drives that obey the tables of CiA 402."""

from collections import deque
from dataclasses import replace
from functools import partial
import itertools

import pytest

from facade_manipulator.drives.axis import make_axes
from facade_manipulator.drives.axis_settings import DEFAULT_AXES
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.group import Group
from facade_manipulator.drives.group_state import GroupState
from facade_manipulator.drives.snapshot import Cause
from facade_manipulator.drives.states import (
    Controlword,
    Mode,
    State,
    Status,
    STATUSWORDS,
)
from facade_manipulator.simulation.drives.automaton import decode_command, TRANSITIONS

PERIOD = 0.01  # s
SETTINGS = ControllerSettings()
OFF = [State.SWITCH_ON_DISABLED] * 3
ENABLED = [State.OPERATION_ENABLED] * 3
STOP = Cause('the operator stops')


class Drives:
    """Three drives that obey the tables of CiA 402, one or more cycles late as on a bus."""

    def __init__(self, latency: int = 0) -> None:
        self.axes = make_axes(DEFAULT_AXES, SETTINGS)
        for axis in self.axes:
            home = axis.settings.home_position
            axis.feedback.counts = axis.settings.to_counts(home)
        self.group = Group(self.axes, SETTINGS)
        self.group.start(0.0)
        self.states = [*OFF]
        self.modes = [0, 0, 0]
        self.bits = [0, 0, 0]
        self.words = {}  # statuswords instead of those of the states, by number of the axis
        self.at_rest = True
        self.deaf = set()
        self.now = 0.0
        self.history = []
        self.underway = deque()
        self.cycle(3)
        # commands that no drive has taken yet
        self.underway.extend([self.history[-1]] * latency)

    def cycle(self, count: int = 1) -> None:
        for _ in range(count):
            self.now += PERIOD
            for number, axis in enumerate(self.axes):
                feedback = axis.feedback
                feedback.mode = self.modes[number]
                feedback.at_rest = self.at_rest
                word = STATUSWORDS[self.states[number]][1] | self.bits[number]
                feedback.statusword = self.words.get(number, word)
            self.group.step(self.now)
            self.history.append([axis.output.command for axis in self.axes])
            self.underway.append(self.history[-1])
            for number, command in enumerate(self.underway.popleft()):
                if number not in self.deaf:
                    self.modes[number] = command.mode
                    key = self.states[number], decode_command(command.controlword)
                    self.states[number] = TRANSITIONS.get(key, self.states[number])

    def ask(self, request, *arguments) -> None:
        request(self.group, *arguments, now=self.now)

    def until(self, state: GroupState) -> None:
        for _ in range(1000):
            if self.group.state is state:
                return
            self.cycle()
        raise AssertionError(f'{self.group.state}, not {state}')

    def commands(self, since: int = -1) -> list:
        found = []
        for cycle in self.history[since:]:
            found += cycle
        return found


def is_enabling(command) -> bool:
    return decode_command(command.controlword) is Controlword.ENABLE_OPERATION


def on_the_way_to(state: GroupState) -> Drives:
    drives = Drives()
    drives.ask(Group.home if state is GroupState.HOMING else Group.enable)
    drives.until(state)
    drives.cycle()
    return drives


running = partial(on_the_way_to, GroupState.ACTIVE)


def halted() -> Drives:
    drives = running()
    drives.ask(Group.halt)
    drives.cycle(2)
    assert drives.group.state is GroupState.HALTED
    assert drives.group.is_settled
    return drives


def ramping() -> Drives:
    drives = running()
    drives.at_rest = False
    drives.ask(Group.disable)
    drives.cycle()
    assert drives.group.is_ramping
    return drives


SITUATIONS = {
    'off': Drives,
    'enabling': partial(on_the_way_to, GroupState.ACTIVATING),
    'running': running,
    'ramping': ramping,
    'halted': halted,
    'homing': partial(on_the_way_to, GroupState.HOMING),
}
situations = pytest.mark.parametrize('situation', SITUATIONS)


# --- requests


def test_no_drive_is_enabled_before_all_are_on():
    drives = Drives()
    drives.deaf = {1}
    drives.ask(Group.enable)
    drives.until(GroupState.STOPPED)
    assert not any(map(is_enabling, drives.commands(0)))
    assert 'q2 did not get ready to switch on' in drives.group.reason
    assert (
        'it is in the state switch on disabled (statusword 0040h)'
        in drives.group.reason
    )


def test_carriages_that_do_not_rest_are_stopped():
    drives = ramping()
    drives.cycle(50)
    assert drives.group.is_ramping
    assert all(map(is_enabling, drives.commands()))
    drives.until(GroupState.STOPPED)
    assert 'still moving' in drives.group.reason


@situations
def test_halt_is_accepted_and_ends_all_motion(situation):
    drives = SITUATIONS[situation]()
    drives.at_rest = True
    drives.ask(Group.halt)
    drives.cycle(50)
    is_held = situation in ('running', 'ramping', 'halted')
    assert drives.group.state is (GroupState.HALTED if is_held else GroupState.INACTIVE)
    assert drives.group.is_settled
    assert not drives.group.causes
    assert drives.states == (ENABLED if is_held else OFF)
    assert not any(
        one.controlword & Controlword.HOMING_START for one in drives.commands()
    )


@pytest.mark.parametrize('latency', range(3))
@pytest.mark.parametrize('cycles', range(30))
def test_halt_in_any_activation_cycle_switches_power_off(cycles, latency):
    """An activation that was not confirmed must not leave power on."""
    drives = Drives(latency)
    drives.ask(Group.enable)
    drives.cycle(cycles)
    was_done = drives.group.state is GroupState.ACTIVE and drives.group.is_settled
    drives.ask(Group.halt)
    drives.cycle(20)
    assert not drives.group.causes
    assert drives.group.state is (
        GroupState.HALTED if was_done else GroupState.INACTIVE
    )


@pytest.mark.parametrize('pause', [0, 1, 5])
@pytest.mark.parametrize('cycles', range(30))
def test_two_halts_during_activation_switch_power_off(cycles, pause):
    drives = Drives()
    drives.ask(Group.enable)
    drives.cycle(cycles)
    was_done = drives.group.state is GroupState.ACTIVE and drives.group.is_settled
    drives.at_rest = False
    drives.ask(Group.halt)
    drives.cycle(pause)
    drives.ask(Group.halt)
    drives.at_rest = True
    drives.cycle(20)
    assert drives.group.state is (
        GroupState.HALTED if was_done else GroupState.INACTIVE
    )


@pytest.mark.parametrize('activation', [running, ramping])
def test_repeated_halts_do_not_extend_the_ramp_time(activation):
    drives = activation()
    drives.at_rest = False
    cycles = round(SETTINGS.ramp_timeout / PERIOD)
    drives.ask(Group.halt)
    for _ in range(cycles):
        drives.cycle()
        drives.ask(Group.halt)
    drives.cycle(2)
    assert 'still moving' in drives.group.reason


# --- any doubt about one stops all


@situations
@pytest.mark.parametrize('state', [State.FAULT, State.FAULT_REACTION_ACTIVE])
def test_fault_of_one_drive_stops_all_at_once(situation, state):
    drives = SITUATIONS[situation]()
    drives.states[1] = state
    drives.cycle()
    assert drives.group.state is GroupState.STOPPED
    assert not any(map(is_enabling, drives.commands()))
    assert drives.group.causes[0].axis == 'q2'
    assert drives.group.causes[0].is_vague
    assert f'is in the state {state.value} (statusword 00' in drives.group.reason


@pytest.mark.parametrize(
    ('situation', 'state', 'bits', 'message'),
    [
        (
            'running',
            State.OPERATION_ENABLED,
            Status.FOLLOWING_ERROR,
            'q1 is farther behind',
        ),
        (
            'running',
            State.OPERATION_ENABLED,
            Status.SWITCH_ON_DISABLED,
            'no state of CiA 402 (statusword 0067h)',
        ),
        ('running', State.SWITCHED_ON, 0, 'the state switched on'),
        ('homing', State.OPERATION_ENABLED, Status.HOMING_ERROR, 'q1: homing failed'),
        ('off', State.SWITCH_ON_DISABLED, 0x0021, 'no state of CiA 402'),
    ],
)
def test_statusword_of_a_failure_stops_all(situation, state, bits, message):
    drives = SITUATIONS[situation]()
    drives.states[0] = state
    drives.bits[0] = bits
    drives.cycle(7)
    assert drives.group.is_stopped
    assert message in drives.group.reason
    assert not any(map(is_enabling, drives.commands()))


# words between two states that show no operation enabled
UNCLEAR_WORDS = [0x0203, 0x0201, 0x0242]


def stopped() -> Drives:
    drives = running()
    drives.ask(Group.stop, STOP)
    drives.cycle(5)
    assert drives.group.has_stopped
    return drives


def switching_off() -> Drives:
    drives = running()
    drives.ask(Group.disable)
    while drives.group.state is not GroupState.INACTIVE:
        drives.cycle()
    return drives


without_power = pytest.mark.parametrize('situation', [Drives, stopped, switching_off])


@without_power
@pytest.mark.parametrize('word', UNCLEAR_WORDS)
def test_short_unclear_statusword_without_power_is_tolerated(situation, word):
    drives = situation()
    causes = drives.group.causes
    drives.words = {0: word}
    for _ in range(Group.MAX_UNCLEAR_CYCLES):
        drives.cycle()
        assert not drives.group.is_settled
        assert not any(map(is_enabling, drives.commands()))
    drives.words = {}
    drives.cycle()
    assert drives.group.is_settled
    assert drives.group.causes == causes
    assert not drives.group.not_responding


@without_power
@pytest.mark.parametrize('word', UNCLEAR_WORDS)
def test_lasting_unclear_statusword_without_power_is_a_failure(situation, word):
    drives = situation()
    drives.words = {0: word}
    drives.cycle(Group.MAX_UNCLEAR_CYCLES + 1)
    assert 'no state of CiA 402' in drives.group.causes[-1].message
    assert ('q1' in drives.group.not_responding) is (situation is stopped)


@pytest.mark.parametrize('word', [0x0227, 0x0067, 0x0005])
def test_stopped_drive_that_may_be_enabled_is_taken_out(word):
    drives = stopped()
    drives.cycle(200)  # beyond the time-out of the stop
    drives.words = {0: word}
    drives.cycle()
    assert drives.group.not_responding == {'q1'}


@pytest.mark.parametrize('word', UNCLEAR_WORDS)
def test_unclear_statusword_of_a_drive_with_power_stops_at_once(word):
    drives = running()
    drives.words = {0: word}
    drives.cycle()
    assert drives.group.state is GroupState.STOPPED


@pytest.mark.parametrize('situation', ['running', 'ramping', 'halted', 'homing'])
@pytest.mark.parametrize('mode', [0, 1, 3, 6, 8])
def test_enabled_drive_in_another_mode_stops_all_at_once(situation, mode):
    drives = SITUATIONS[situation]()
    is_right = mode == (
        Mode.HOMING if situation == 'homing' else Mode.CYCLIC_SYNCHRONOUS_POSITION
    )
    drives.deaf = {1}
    drives.modes[1] = mode
    drives.cycle()
    assert drives.group.is_stopped is not is_right
    assert is_right or f'in mode {mode} instead of' in drives.group.reason


@pytest.mark.parametrize(
    'ways', [[True], [None], [False, None], [False, True]], ids=str
)
@pytest.mark.parametrize('rests', [True, False])
def test_power_is_cut_at_rest_or_after_timeout(ways, rests):
    """The cases are stops that cut the power, stops that do not, and no cause."""
    drives = running()
    drives.at_rest = False
    for cuts in ways:
        if cuts is None:
            drives.ask(Group.cut_power)
        else:
            drives.ask(Group.stop, replace(STOP, cut_power=cuts))
        drives.cycle(5)
        assert drives.states == [State.QUICK_STOP_ACTIVE] * 3
    drives.at_rest = rests
    drives.cycle(10 if rests else 150)
    assert drives.states == OFF
    assert drives.group.state is GroupState.STOPPED
    assert drives.group.is_settled


# --- causes

SILENCE = Cause('q2 did not answer', axis='q2', configure_again=True, is_vague=True)
RESTART = Cause('q2 has restarted', axis='q2', configure_again=True)


@pytest.mark.parametrize(
    ('first', 'later', 'is_explained'),
    [
        (SILENCE, RESTART, True),
        (SILENCE, SILENCE, False),
        (replace(SILENCE, axis='q1'), RESTART, False),
        (replace(SILENCE, is_vague=False), RESTART, False),
        (SILENCE, replace(RESTART, configure_again=False), False),
    ],
)
def test_precise_cause_replaces_a_vague_cause_of_the_axis(first, later, is_explained):
    drives = running()
    for cause in (first, later, later):
        drives.ask(Group.stop, cause)
    remaining = [later]
    if not is_explained and first != later:
        remaining = [first, later]
    assert [*drives.group.causes] == remaining


@pytest.mark.parametrize('is_vague', [False, True])
@pytest.mark.parametrize('configure_again', [False, True])
@pytest.mark.parametrize('axis', ['', 'q1', 'q2'])
def test_drive_that_does_not_stop_keeps_the_first_cause(
    axis, configure_again, is_vague
):
    drives = running()
    first = Cause('it began', 'help', axis, False, configure_again, is_vague)
    drives.deaf = {1}
    drives.at_rest = False
    drives.ask(Group.stop, first)
    drives.cycle(200)
    assert drives.group.causes[0] == first
    assert any('q2 did not stop' in one.message for one in drives.group.causes)
    assert drives.group.severest_cause.configure_again


# --- clearing


@pytest.mark.parametrize('cycles', range(6))
@pytest.mark.parametrize('old', [STOP, replace(STOP, axis='q1')])
def test_fault_during_a_reset_is_the_first_cause(old, cycles):
    drives = running()
    drives.ask(Group.stop, old)
    drives.cycle(5)
    drives.ask(Group.reset)
    drives.cycle(cycles)
    drives.ask(Group.stop, RESTART)
    assert drives.group.causes == (RESTART,)


def test_fault_that_outlasts_a_reset_keeps_its_cause():
    drives = running()
    fault = Cause('q2: overcurrent', 'look it up', 'q2')
    drives.ask(Group.stop, STOP)
    drives.ask(Group.stop, fault)
    drives.states[1] = State.FAULT
    drives.deaf = {1}
    drives.cycle(5)
    drives.ask(Group.reset)
    drives.cycle(200)
    assert drives.group.is_stopped
    assert drives.group.causes[0] == fault
    assert 'q2 did not leave the fault' in drives.group.causes[1].message
    assert STOP not in drives.group.causes


@pytest.mark.parametrize(
    'states',
    list(
        itertools.product(
            (State.SWITCH_ON_DISABLED, State.QUICK_STOP_ACTIVE, State.FAULT), repeat=3
        )
    ),
)
def test_reset_leads_every_stopped_drive_to_off(states):
    drives = running()
    drives.states = list(states)
    drives.ask(Group.stop, STOP)
    drives.cycle(5)
    drives.history.clear()
    drives.ask(Group.reset)
    drives.cycle(100)
    assert drives.group.state is GroupState.INACTIVE
    assert not drives.group.causes
    assert drives.states == OFF
    words = [cycle[0].controlword for cycle in drives.history]
    assert words.count(Controlword.FAULT_RESET) == 1
    assert set(words) == {Controlword.DISABLE_VOLTAGE, Controlword.FAULT_RESET}

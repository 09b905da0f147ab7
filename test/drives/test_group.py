"""The state machine of the three axes, with drives that obey the tables of CiA 402."""

from collections import deque
from dataclasses import replace
from functools import partial
import itertools

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.drives.axis_settings import AXIS_NAMES, DEFAULT_AXES
from facade_manipulator.drives.cause import Cause
from facade_manipulator.drives.controller_settings import ControllerSettings
from facade_manipulator.drives.controller_state import ControllerState as Doing
from facade_manipulator.drives.group import Feedback, Group
from facade_manipulator.drives.states import Controlword, Mode, State, Status, STATUSWORDS
from facade_manipulator.errors import DriveStateError
from facade_manipulator.simulation.drives.automaton import decode_command, TRANSITIONS

PERIOD, BEGIN = 0.01, 1000.0  # s
SETTINGS = ControllerSettings()
HOMED = Status.HOMING_ATTAINED | Status.TARGET_REACHED
OFF, ENABLED = [State.SWITCH_ON_DISABLED] * 3, [State.OPERATION_ENABLED] * 3


class Drives:
    """Three drives that obey the tables of CiA 402, one cycle late as on a bus, or later."""

    def __init__(self, latency: int = 0) -> None:
        self.group = Group(DEFAULT_AXES, SETTINGS, BEGIN)
        self.states = [*OFF]
        self.modes = [0, 0, 0]
        self.bits = [0, 0, 0]
        self.at_rest = True
        self.now = BEGIN
        self.commands = ()
        self.history = []
        self.deaf = set()
        self.underway = deque()
        self.cycle(3)
        self.underway.extend([self.commands] * latency)  # commands that no drive has taken yet

    def feedback(self) -> tuple[Feedback, ...]:
        return tuple(
            Feedback(STATUSWORDS[state][1] | bits, mode, self.at_rest,
                     counts=axis.to_counts(axis.home_position))
            for state, mode, bits, axis in zip(
                self.states, self.modes, self.bits, DEFAULT_AXES, strict=True))

    def cycle(self, count: int = 1) -> None:
        for _ in range(count):
            self.now += PERIOD
            self.commands = self.group.step(self.feedback(), self.now)
            self.history.append(self.commands)
            self.underway.append(self.commands)
            for number, command in enumerate(self.underway.popleft()):
                if number not in self.deaf:
                    self.modes[number] = command.mode
                    key = self.states[number], decode_command(command.controlword)
                    self.states[number] = TRANSITIONS.get(key, self.states[number])

    def ask(self, request, *arguments) -> None:
        request(self.group, *arguments, now=self.now)

    def until(self, *states: Doing, cycles: int = 1000) -> None:
        for _ in range(cycles):
            if self.group.state in states:
                return
            self.cycle()
        raise AssertionError(f'{self.group.state} after {cycles} cycles, not {states}')

    def stop(self, **details) -> None:
        self.ask(Group.stop, Cause('the operator stops', **details))


def is_enabling(command) -> bool:
    return decode_command(command.controlword) is Controlword.ENABLE_OPERATION


def on_the_way_to(state: Doing) -> Drives:
    drives = Drives()
    drives.ask(Group.home if state is Doing.HOMING else Group.enable)
    drives.until(state)
    drives.cycle()
    return drives


running = partial(on_the_way_to, Doing.ACTIVE)


def halted() -> Drives:
    drives = running()
    drives.ask(Group.halt)
    drives.cycle(2)
    assert drives.group.state is Doing.HALTED and drives.group.is_settled
    return drives


def ramping() -> Drives:
    drives = running()
    drives.at_rest = False
    drives.ask(Group.disable)
    drives.cycle()
    assert drives.group.is_ramping
    return drives


def holding() -> Drives:
    drives = Drives()
    drives.ask(Group.enable)
    while not drives.group.follows:
        drives.cycle()
    drives.cycle()
    assert drives.group.state is Doing.ACTIVATING
    return drives


SITUATIONS = {
    'off': Drives, 'enabling': partial(on_the_way_to, Doing.ACTIVATING),
    'holding': holding, 'running': running,
    'ramping': ramping, 'halted': halted, 'homing': partial(on_the_way_to, Doing.HOMING),
}
FOLLOWING = ('running', 'ramping', 'halted')
situations = pytest.mark.parametrize('situation', SITUATIONS)


# --- requests

def test_no_drive_is_enabled_before_all_are_on():
    drives = Drives()
    drives.deaf = {1}
    drives.ask(Group.enable)
    drives.until(Doing.STOPPED)
    assert not any(is_enabling(command) for cycle in drives.history for command in cycle)
    assert drives.group.reason == (
        'q2 did not get ready to switch on in time: it is in the state switch on disabled '
        '(statusword 0040h)')


def test_power_off_waits_until_carriages_stand():
    drives = ramping()
    drives.cycle(50)
    assert drives.group.is_ramping and all(map(is_enabling, drives.commands))
    drives.at_rest = True
    drives.until(Doing.INACTIVE)
    drives.cycle(3)
    assert drives.states == OFF and drives.group.is_settled


def test_carriages_that_do_not_rest_are_stopped():
    drives = ramping()
    drives.until(Doing.STOPPED)
    assert 'still moving' in drives.group.reason


@situations
def test_rejected_requests_change_nothing(situation):
    drives = SITUATIONS[situation]()
    rejected = 0
    for request in (Group.enable, Group.disable, Group.halt, Group.reset, Group.home):
        state = drives.group.state
        try:
            drives.ask(request)
        except DriveStateError as error:
            rejected += 1
            assert 'not possible' in str(error) and drives.group.state is state
    assert rejected


def test_homing_powers_on_in_mode_6_and_off():
    drives = on_the_way_to(Doing.HOMING)
    assert [command.mode for command in drives.commands] == [Mode.HOMING] * 3
    assert all(command.controlword & Controlword.HOMING_START for command in drives.commands)
    drives.bits = [HOMED] * 3
    drives.until(Doing.DEACTIVATING)
    drives.bits = [0] * 3
    drives.until(Doing.INACTIVE)
    drives.cycle(2)
    assert not drives.group.causes and drives.group.homed == (True,) * 3
    assert drives.modes == [Mode.CYCLIC_SYNCHRONOUS_POSITION] * 3 and drives.states == OFF


@situations
def test_halt_is_accepted_and_nothing_moves_after_it(situation):
    drives = SITUATIONS[situation]()
    drives.at_rest = True
    drives.ask(Group.halt)
    drives.cycle(50)
    is_held = situation in FOLLOWING
    assert drives.group.state is (Doing.HALTED if is_held else Doing.INACTIVE)
    assert drives.group.is_settled and not drives.group.causes
    assert drives.states == (ENABLED if is_held else OFF)
    assert not any(command.controlword & Controlword.HOMING_START for command in drives.commands)


@pytest.mark.parametrize('latency', range(3))
@pytest.mark.parametrize('cycles', range(30))
def test_halt_in_any_cycle_of_activation_powers_off(cycles, latency):
    """No activation that was not confirmed may leave power on."""
    drives = Drives(latency)
    drives.ask(Group.enable)
    drives.cycle(cycles)
    was_done = drives.group.state is Doing.ACTIVE and drives.group.is_settled
    drives.ask(Group.halt)
    drives.cycle(20)
    assert not drives.group.causes
    assert drives.group.state is (Doing.HALTED if was_done else Doing.INACTIVE)


# --- any doubt about one stops all

@situations
@pytest.mark.parametrize('axis', range(3))
@pytest.mark.parametrize('state', [State.FAULT, State.FAULT_REACTION_ACTIVE])
def test_fault_of_one_drive_stops_all_at_once(situation, axis, state):
    drives = SITUATIONS[situation]()
    drives.states[axis] = state
    drives.cycle()
    assert drives.group.state is Doing.STOPPED
    assert not any(map(is_enabling, drives.commands))
    assert drives.group.causes[0].axis == AXIS_NAMES[axis] and drives.group.causes[0].is_vague
    assert f'q{axis + 1} is in the state {state.value} (statusword 00' in drives.group.reason
    assert 'the drive sent no error code' in drives.group.reason
    drives.cycle(300)
    assert drives.group.state is Doing.STOPPED and State.OPERATION_ENABLED not in drives.states


@pytest.mark.parametrize(('situation', 'bits', 'message'), [
    ('running', Status.FOLLOWING_ERROR, 'q1 is farther behind'),
    ('running', Status.SWITCH_ON_DISABLED, 'names no state of CiA 402 (statusword 0067h)'),
    ('homing', Status.HOMING_ERROR, 'q1: homing failed'),
    ('off', Status.READY_TO_SWITCH_ON | Status.QUICK_STOP, 'q1: the drive names no state')])
def test_bits_that_mean_a_failure_stop_all(situation, bits, message):
    drives = SITUATIONS[situation]()
    drives.bits[0] = bits
    drives.cycle(7)
    assert drives.group.is_stopped and message in drives.group.reason
    assert not any(map(is_enabling, drives.commands))


def test_drive_that_falls_back_stops_all():
    drives = running()
    drives.states[1] = State.SWITCHED_ON
    drives.cycle()
    assert 'q2 should stay in operation, but went to the state switched on' in drives.group.reason


@situations
def test_disobedient_drive_stops_all_while_following(situation):
    drives = SITUATIONS[situation]()
    q1, q2, q3 = drives.feedback()
    drives.group.step((q1, q2._replace(disobedience='does not follow'), q3), drives.now)
    assert drives.group.reason.startswith('q2 does not follow (statusword 0') == (
        situation in FOLLOWING)
    assert drives.group.is_stopped == (situation in FOLLOWING)


@situations
def test_stop_from_outside_lasts_until_the_reset(situation):
    drives = SITUATIONS[situation]()
    drives.stop()
    drives.cycle(400)
    assert drives.group.state is Doing.STOPPED
    assert str(drives.group.causes[0]).startswith('the operator stops; next: ')
    assert not any(map(is_enabling, drives.commands))
    with pytest.raises(DriveStateError, match='the operator stops'):
        drives.ask(Group.enable)


@pytest.mark.parametrize('ways', [
    (partial(Drives.stop, cut_power=True),), (lambda drives: drives.ask(Group.cut_power),),
    (Drives.stop, lambda drives: drives.ask(Group.cut_power)),
    (Drives.stop, partial(Drives.stop, cut_power=True))])
@pytest.mark.parametrize('rests', [True, False])
def test_power_is_cut_at_rest_or_after_timeout(ways, rests):
    drives = running()
    drives.at_rest = False
    for way in ways:
        way(drives)
        drives.cycle(5)
        assert drives.states == [State.QUICK_STOP_ACTIVE] * 3
    drives.at_rest = rests
    drives.cycle(10 if rests else 150)
    assert drives.states == OFF and drives.group.state is Doing.STOPPED
    assert drives.group.is_settled


def test_drive_ignoring_quick_stop_loses_its_power():
    drives = running()
    drives.deaf = {1}
    drives.stop()
    drives.cycle(150)
    assert drives.group.not_responding == {'q2'}
    assert drives.commands[0].controlword == Controlword.DISABLE_VOLTAGE
    assert drives.group.severest_cause.configure_again


# --- causes

SILENCE = Cause('q2 did not answer', axis='q2', configure_again=True, is_vague=True)
RESTART = Cause('q2 has restarted', axis='q2', configure_again=True)


@pytest.mark.parametrize(('first', 'later', 'is_explained'), [
    (SILENCE, RESTART, True), (SILENCE, SILENCE, False),
    (replace(SILENCE, axis='q1'), RESTART, False),
    (replace(SILENCE, is_vague=False), RESTART, False),
    (SILENCE, replace(RESTART, configure_again=False), False)])
def test_clearer_cause_of_the_axis_replaces_a_vague(first, later, is_explained):
    drives = running()
    for cause in (first, later, later):
        drives.ask(Group.stop, cause)
    assert drives.group.causes == (
        (later,) if is_explained else tuple(dict.fromkeys((first, later))))


def test_next_step_is_of_the_severest_cause():
    drives = running()
    drives.stop()
    assert drives.group.severest_cause is drives.group.causes[0]
    drives.ask(Group.stop, RESTART)
    assert drives.group.severest_cause is RESTART
    drives.cycle(5)
    with pytest.raises(DriveStateError, match='q2 has restarted'):
        drives.ask(Group.reset)


# --- clearing

@pytest.mark.parametrize('states', list(itertools.product(
    (State.SWITCH_ON_DISABLED, State.QUICK_STOP_ACTIVE, State.FAULT), repeat=3)))
def test_reset_leads_every_stopped_drive_to_off(states):
    drives = running()
    drives.states = list(states)
    drives.stop()
    drives.cycle(5)
    drives.history.clear()
    drives.ask(Group.reset)
    drives.cycle(100)
    assert drives.group.state is Doing.INACTIVE and not drives.group.causes
    assert drives.states == OFF
    words = [cycle[0].controlword for cycle in drives.history]
    assert words.count(Controlword.FAULT_RESET) == 1
    assert set(words) == {Controlword.DISABLE_VOLTAGE, Controlword.FAULT_RESET}


def test_fourth_reset_within_a_minute_is_rejected():
    drives = Drives()
    for _ in range(3):
        drives.stop()
        drives.cycle(5)
        drives.ask(Group.reset)
        drives.until(Doing.INACTIVE)
    drives.now += 20.0
    drives.stop()
    drives.cycle(5)
    with pytest.raises(DriveStateError, match=r'3 fault resets within 60 s.*stops.*in (40|3\d) s'):
        drives.ask(Group.reset)
    drives.now += 60.0
    drives.ask(Group.reset)
    drives.until(Doing.INACTIVE)


# --- whatever the drives do

REQUESTS = {
    'enable': Group.enable, 'disable': Group.disable, 'halt': Group.halt, 'reset': Group.reset,
    'home': Group.home, 'stop': lambda group, now: group.stop(Cause('stop'), now),
    'cut': lambda group, now: group.stop(Cause('cut', cut_power=True), now)}
statuswords = st.one_of(
    st.sampled_from([value for _, value in STATUSWORDS.values()]), st.integers(0, 0xFFFF))
feedbacks = st.builds(Feedback, statuswords, st.sampled_from([0, 6, 8]), st.booleans())


@pytest.mark.long
@given(st.lists(st.tuples(
    st.sampled_from([None] * 8 + list(REQUESTS)), st.tuples(feedbacks, feedbacks, feedbacks)),
    max_size=60))
def test_no_statuswords_enable_what_was_not_requested(cycles):
    group = Group(DEFAULT_AXES, replace(SETTINGS, step_timeout=0.1, hold_cycles=2), 0.0)
    is_allowed = False
    for number, (request, feedback) in enumerate(cycles):
        now = PERIOD * number
        if request is not None:
            try:
                REQUESTS[request](group, now=now)
                is_allowed = is_allowed or request in ('enable', 'home')
            except DriveStateError:
                pass
        commands = group.step(feedback, now)
        is_allowed = is_allowed and group.state.has_power
        assert len({command.controlword & 0xEF for command in commands}) == 1
        assert is_allowed or not any(map(is_enabling, commands))


@given(st.sampled_from(sorted(State, key=str)), st.integers(0, 2), st.integers(0, 3))
def test_drive_stuck_while_powering_on_leaves_none_enabled(state, axis, cycles):
    drives = Drives()
    drives.ask(Group.enable)
    drives.cycle(cycles)
    drives.states[axis] = state
    drives.deaf = {axis}
    drives.cycle(400)
    del drives.states[axis]
    is_active = drives.group.state is Doing.ACTIVE
    assert State.OPERATION_ENABLED not in drives.states or (
        is_active and state is State.OPERATION_ENABLED)

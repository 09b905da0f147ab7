from collections import deque
from dataclasses import replace
from functools import partial
import itertools

from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.drives.axis import Feedback
from facade_manipulator.drives.cause import Cause
from facade_manipulator.drives.controller_state import ControllerState
from facade_manipulator.drives.group import Group, GroupSettings
from facade_manipulator.drives.homing import AxisHoming, HomingSequence
from facade_manipulator.drives.states import Controlword, Mode, State, Status, STATUSWORDS
from facade_manipulator.errors import DriveStateError
from facade_manipulator.simulation.drives.automaton import decode_command, TRANSITIONS

NAMES = ('q1', 'q2', 'q3')
PERIOD, BEGIN = 0.01, 1000.0  # s
CSP = Mode.CYCLIC_SYNCHRONOUS_POSITION
STATES = sorted(State, key=str)
FAULTS = (State.FAULT, State.FAULT_REACTION_ACTIVE)


class Drives:
    """Three drives that obey the tables of CiA 402, one cycle late as on a bus, or later."""

    def __init__(self, group: Group) -> None:
        self.group = group
        self.states = [State.SWITCH_ON_DISABLED] * 3
        self.modes = [0, 0, 0]
        self.bits = [0, 0, 0]
        self.at_rest = True
        self.now = BEGIN
        self.commands = ()
        self.history = []
        self.deaf = set()
        self.underway = deque([])  # commands that no drive has taken yet

    def feedback(self) -> tuple[Feedback, ...]:
        return tuple(
            Feedback(STATUSWORDS[state][1] | bits, mode, self.at_rest)
            for state, mode, bits in zip(self.states, self.modes, self.bits, strict=True))

    def cycle(self, count: int = 1) -> None:
        for _ in range(count):
            self.now += PERIOD
            self.commands = self.group.step(self.feedback(), self.now)
            self.history.append(self.commands)
            self.underway.append(self.commands)
            for number, command in enumerate(self.underway.popleft()):
                if number not in self.deaf:
                    self._take(number, command)

    def _take(self, number, command) -> None:
        self.modes[number] = command.mode
        key = self.states[number], decode_command(command.controlword)
        self.states[number] = TRANSITIONS.get(key, self.states[number])

    def until(self, *states: ControllerState, cycles: int = 1000) -> None:
        for _ in range(cycles):
            if self.group.state in states:
                return
            self.cycle()
        raise AssertionError(f'{self.group.state} after {cycles} cycles, not {states}')


def is_enabling(command) -> bool:
    return decode_command(command.controlword) is Controlword.ENABLE_OPERATION


def switched_off(**details) -> Drives:
    drives = Drives(Group(NAMES, GroupSettings(**details), BEGIN))
    drives.cycle(3)
    return drives


def running() -> Drives:
    drives = on_the_way_to(ControllerState.ACTIVE)
    drives.cycle()
    return drives


def halted() -> Drives:
    drives = running()
    drives.group.halt(drives.now)
    drives.until(ControllerState.HALTED)
    return drives


def on_the_way_to(state: ControllerState) -> Drives:
    drives = switched_off()
    drives.group.enable(drives.now)
    drives.cycle(3)
    drives.until(state)
    return drives


def ramping() -> Drives:
    drives = running()
    drives.at_rest = False
    drives.group.disable(drives.now)
    drives.cycle()
    assert drives.group.state is ControllerState.RAMPING
    return drives


def homing() -> Drives:
    drives = switched_off()
    drives.group.home(HomingSequence(tuple(AxisHoming(name, 1.0) for name in NAMES)), drives.now)
    drives.until(ControllerState.HOMING)
    drives.cycle()
    return drives


SITUATIONS = {
    'off': switched_off, 'enabling': partial(on_the_way_to, ControllerState.ACTIVATING),
    'holding': partial(on_the_way_to, ControllerState.HOLDING), 'running': running,
    'ramping': ramping, 'halted': halted, 'homing': homing,
}
situations = pytest.mark.parametrize('situation', SITUATIONS)


# --- the way up and down

def test_no_drive_is_enabled_before_all_are_on():
    drives = switched_off()
    drives.deaf = {1}
    drives.group.enable(drives.now)
    drives.until(ControllerState.STOPPED)
    assert not any(is_enabling(command) for cycle in drives.history for command in cycle)
    assert 'q2' in drives.group.cause.message


def test_power_off_waits_until_carriages_stand():
    drives = ramping()
    drives.cycle(50)
    assert drives.group.state is ControllerState.RAMPING
    assert all(map(is_enabling, drives.commands))
    drives.at_rest = True
    drives.until(ControllerState.INACTIVE)
    drives.cycle(3)
    assert drives.states == [State.SWITCH_ON_DISABLED] * 3
    assert drives.group.is_settled


def test_carriages_that_do_not_rest_are_stopped():
    drives = ramping()
    drives.until(ControllerState.STOPPING)
    assert 'still moving' in drives.group.cause.message


@situations
def test_rejected_requests_change_nothing(situation):
    drives = SITUATIONS[situation]()
    group = drives.group
    before = group.state
    rejected = 0
    for request in (group.enable, group.disable, group.halt, group.reset,
                    lambda now: group.home(HomingSequence(()), now)):
        state = group.state
        try:
            request(drives.now)
        except DriveStateError as error:
            rejected += 1
            assert 'not possible' in str(error)
            assert group.state is state
    assert rejected or before is not group.state


# --- homing

def test_homing_powers_on_in_mode_6_and_off():
    drives = homing()
    assert [command.mode for command in drives.commands] == [Mode.HOMING] * 3
    assert all(command.controlword & Controlword.HOMING_START for command in drives.commands)
    drives.bits = [Status.HOMING_ATTAINED | Status.TARGET_REACHED] * 3
    drives.until(ControllerState.DEACTIVATING)
    assert not any(
        command.controlword & Controlword.HOMING_START for command in drives.group.commands)
    drives.bits = [0] * 3
    drives.until(ControllerState.INACTIVE)
    drives.cycle(2)
    assert drives.group.cause is None
    assert drives.modes == [CSP] * 3
    assert drives.states == [State.SWITCH_ON_DISABLED] * 3


def test_homing_error_of_one_axis_stops_all():
    drives = homing()
    drives.bits[1] = Status.HOMING_ERROR
    drives.until(ControllerState.STOPPING)
    assert 'q2: homing failed' in drives.group.cause.message
    assert not any(map(is_enabling, drives.commands))


# --- a halt

@situations
def test_halt_is_accepted_and_nothing_moves_after_it(situation):
    drives = SITUATIONS[situation]()
    drives.at_rest = True
    drives.group.halt(drives.now)
    drives.cycle(50)
    is_held = situation in ('running', 'ramping', 'halted')
    assert drives.group.state is (ControllerState.HALTED if is_held else ControllerState.INACTIVE)
    assert drives.group.is_settled and drives.group.cause is None
    assert drives.states == [
        State.OPERATION_ENABLED if is_held else State.SWITCH_ON_DISABLED] * 3
    assert not any(command.controlword & Controlword.HOMING_START for command in drives.commands)


@pytest.mark.parametrize('later', range(3))
@pytest.mark.parametrize('cycles', range(30))
def test_halt_in_any_cycle_of_activation_powers_off(cycles, later):
    """No activation that was not confirmed may leave power on."""
    drives = switched_off()
    drives.underway.extend([drives.commands] * later)
    drives.group.enable(drives.now)
    drives.cycle(cycles)
    was_done = drives.group.state is ControllerState.ACTIVE and drives.group.is_settled
    drives.group.halt(drives.now)
    drives.cycle(20)
    assert drives.group.cause is None
    assert drives.group.state is (ControllerState.HALTED if was_done else ControllerState.INACTIVE)


# --- any doubt about one stops all

@situations
@pytest.mark.parametrize('axis', range(3))
@pytest.mark.parametrize('state', FAULTS)
def test_fault_of_one_drive_stops_all_at_once(situation, axis, state):
    drives = SITUATIONS[situation]()
    drives.states[axis] = state
    drives.cycle()
    assert drives.group.state in (ControllerState.STOPPING, ControllerState.STOPPED)
    assert not any(map(is_enabling, drives.commands))
    assert drives.group.cause.axis == NAMES[axis] and drives.group.cause.is_vague
    drives.cycle(300)
    assert drives.group.state is ControllerState.STOPPED
    assert State.OPERATION_ENABLED not in drives.states


@pytest.mark.parametrize(('bits', 'message'), [
    (Status.FOLLOWING_ERROR, 'q1 is farther behind'),
    (Status.SWITCH_ON_DISABLED, 'q1: statusword 0x0067 names no state')])
def test_following_error_and_invalid_statusword_stop_all(bits, message):
    drives = running()
    drives.bits[0] = bits
    drives.cycle()
    assert drives.group.is_stopped and message in drives.group.cause.message


@situations
def test_disobedient_drive_stops_all_while_following(situation):
    drives = SITUATIONS[situation]()
    q1, q2, q3 = drives.feedback()
    drives.group.step((q1, q2._replace(disobedience='does not follow'), q3), drives.now)
    if situation in ('running', 'ramping', 'halted'):
        assert drives.group.cause.message.startswith('q2 does not follow (statusword 0')
    else:
        assert drives.group.cause is None


@situations
def test_stop_from_outside_lasts_until_the_reset(situation):
    drives = SITUATIONS[situation]()
    drives.group.stop(Cause('the operator said so'), drives.now)
    drives.cycle(400)
    assert drives.group.state is ControllerState.STOPPED
    assert str(drives.group.cause).startswith('the operator said so; next: ')
    assert not any(map(is_enabling, drives.commands))
    with pytest.raises(DriveStateError, match='the operator said so'):
        drives.group.enable(drives.now)


STOP = partial(Group.stop, cause=Cause('first'))
STOP_AND_CUT = partial(Group.stop, cause=Cause('second', cut_power=True))


@pytest.mark.parametrize('ways', [
    (STOP_AND_CUT,), (Group.cut_power,), (STOP, Group.cut_power), (STOP, STOP_AND_CUT)])
def test_power_is_cut_once_the_carriages_stand(ways):
    drives = running()
    drives.at_rest = False
    for way in ways:
        way(drives.group, now=drives.now)
        drives.cycle(5)
        assert drives.states == [State.QUICK_STOP_ACTIVE] * 3
    drives.at_rest = True
    drives.until(ControllerState.STOPPED)
    drives.cycle(5)
    assert drives.states == [State.SWITCH_ON_DISABLED] * 3
    assert drives.group.is_settled and drives.group.state is ControllerState.STOPPED


def test_power_is_cut_after_the_time_out():
    drives = running()
    drives.at_rest = False
    drives.group.cut_power(drives.now)
    drives.cycle(150)
    assert drives.states == [State.SWITCH_ON_DISABLED] * 3


def test_drive_ignoring_quick_stop_loses_its_power():
    drives = running()
    drives.deaf = {1}
    drives.group.stop(Cause('enough'), drives.now)
    drives.cycle(150)
    assert drives.group.not_responding == {'q2'}
    assert drives.commands[0].controlword == Controlword.DISABLE_VOLTAGE
    assert drives.group.needs_configuration and not running().group.needs_configuration


SILENCE = Cause('q2 did not answer', axis='q2', configure_again=True, is_vague=True)
RESTART = Cause('q2 has restarted', axis='q2', configure_again=True)


@pytest.mark.parametrize(('first', 'later', 'is_explained'), [
    (SILENCE, RESTART, True), (SILENCE, SILENCE, False),
    (replace(SILENCE, axis='q1'), RESTART, False),
    (replace(SILENCE, is_vague=False), RESTART, False),
    (SILENCE, replace(RESTART, configure_again=False), False)])
def test_clearer_cause_of_the_axis_replaces_a_vague(
        first, later, is_explained):
    drives = running()
    for cause in (first, later, later):
        drives.group.stop(cause, drives.now)
    expected = (later,) if is_explained else tuple(dict.fromkeys((first, later)))
    assert drives.group.causes == expected


def test_next_step_is_of_the_severest_cause():
    drives = running()
    drives.group.stop(Cause('the loop was late'), drives.now)
    assert drives.group.severest_cause is drives.group.cause
    drives.group.stop(RESTART, drives.now)
    assert drives.group.severest_cause is RESTART
    drives.until(ControllerState.STOPPED)
    with pytest.raises(DriveStateError, match='not enough: q2 has restarted'):
        drives.group.reset(drives.now)


# --- clearing

@pytest.mark.parametrize('states', list(itertools.product(
    (State.SWITCH_ON_DISABLED, State.QUICK_STOP_ACTIVE, State.FAULT), repeat=3)))
def test_reset_leads_every_stopped_drive_to_off(states):
    drives = running()
    drives.states = list(states)
    drives.group.stop(Cause('enough'), drives.now)
    drives.until(ControllerState.STOPPED)
    drives.history.clear()
    drives.group.reset(drives.now)
    drives.until(ControllerState.INACTIVE)
    drives.cycle(100)
    assert drives.group.state is ControllerState.INACTIVE
    assert drives.group.cause is None
    assert drives.states == [State.SWITCH_ON_DISABLED] * 3
    words = [cycle[0].controlword for cycle in drives.history]
    assert words.count(Controlword.FAULT_RESET) == 1
    assert set(words) == {Controlword.DISABLE_VOLTAGE, Controlword.FAULT_RESET}


def test_fourth_reset_within_a_minute_is_rejected():
    drives = switched_off()
    for _ in range(3):
        drives.group.stop(Cause('again'), drives.now)
        drives.until(ControllerState.STOPPED)
        drives.group.reset(drives.now)
        drives.until(ControllerState.INACTIVE)
    drives.now += 20.0
    drives.group.stop(Cause('again'), drives.now)
    drives.until(ControllerState.STOPPED)
    with pytest.raises(DriveStateError, match=r'3 fault resets within 60 s.*again.*in (40|3\d) s'):
        drives.group.reset(drives.now)
    drives.now += 60.0
    drives.group.reset(drives.now)
    drives.until(ControllerState.INACTIVE)


# --- whatever the drives do

REQUESTS = ('enable', 'disable', 'halt', 'reset', 'home', 'stop', 'cut')
statuswords = st.one_of(
    st.sampled_from([value for _, value in STATUSWORDS.values()]), st.integers(0, 0xFFFF))
feedbacks = st.builds(
    Feedback, statuswords, st.sampled_from([0, 6, 8]), st.booleans(), st.just(0))


def ask(group: Group, request: str, now: float) -> bool:
    """Return whether an operator has asked for power and was not rejected."""
    sequence = HomingSequence(tuple(AxisHoming(name, 0.5) for name in NAMES))
    actions = {
        'home': lambda: group.home(sequence, now),
        'stop': lambda: group.stop(Cause('said so'), now),
        'cut': lambda: group.stop(Cause('said so', cut_power=True), now),
    }
    try:
        actions.get(request, lambda: getattr(group, request)(now))()
    except DriveStateError:
        return False
    return request in ('enable', 'home')


@pytest.mark.long
@given(st.lists(st.tuples(
    st.sampled_from([None] * 8 + list(REQUESTS)), st.tuples(feedbacks, feedbacks, feedbacks)),
    max_size=60))
def test_no_statuswords_enable_what_was_not_requested(cycles):
    group = Group(NAMES, GroupSettings(step_timeout=0.1, hold_cycles=2))
    allowed = False
    for number, (request, feedback) in enumerate(cycles):
        now = PERIOD * number
        if request is not None:
            allowed = ask(group, request, now) or allowed
        commands = group.step(feedback, now)
        allowed = allowed and group.state.has_power
        assert len({command.controlword & 0xEF for command in commands}) == 1
        assert allowed or not any(map(is_enabling, commands))


@given(st.sampled_from(STATES), st.integers(0, 2), st.integers(0, 3))
def test_drive_stuck_while_powering_on_leaves_none_enabled(
        state, axis, cycles):
    drives = switched_off()
    drives.group.enable(drives.now)
    drives.cycle(cycles)
    drives.states[axis] = state
    drives.deaf = {axis}
    drives.cycle(400)
    others = [drives.states[number] for number in range(3) if number != axis]
    if state is State.OPERATION_ENABLED and drives.group.state is ControllerState.ACTIVE:
        return
    assert State.OPERATION_ENABLED not in others

"""Homing: the statuswords of one axis, and all three axes with the controller."""

from dataclasses import replace
import re

from bus_world import configured, SETTINGS
from hypothesis import given
from hypothesis import strategies as st
import pytest

from facade_manipulator.drives.axis_settings import AxisSettings, DEFAULT_AXES
from facade_manipulator.drives.group_state import GroupState
from facade_manipulator.drives.homing import Homing, SETTLING_CYCLES, STEADY_TIME
from facade_manipulator.drives.profile import load_profile
from facade_manipulator.drives.snapshot import ControllerState
from facade_manipulator.drives.states import Status
from facade_manipulator.errors import DriveError, DriveStateError, LimitError

PERIOD = 0.02  # s
STEADY_CYCLES = round(STEADY_TIME / PERIOD)
IDLE = 0x0627
UNDER_WAY = 0x0227
SUCCESS = 0x0027 | Status.HOMING_ATTAINED | Status.TARGET_REACHED
FAILED = 0x0027 | Status.HOMING_ERROR
LATE = 'q1: homing took longer than 3 s'
ELSEWHERE = (
    r'q1: homing ended \+0.1 m from the configured.*takes 607Ch with the other sign'
)
BROKEN = r'q1: homing failed.*2027h'


class Axis:
    """Homing of q1 by its statuswords; the first statusword precedes its turn."""

    def __init__(self, method: int = 17, away: float = 0.0) -> None:
        self.axis = AxisSettings(homing_method=method, homing_speed=1.0)
        self.homing = Homing('q1', self.axis, PERIOD, needs_bit_10=True)
        self.away = away
        self.is_homed_in = []  #: after each statusword

    def run(self, words) -> str:
        """Return why homing has failed, '' for success."""
        self.homing.watch(words[0])
        counts = self.axis.to_counts(self.axis.home_position + self.away)
        for word in words[1:]:
            if failure := not self.homing.is_homed and self.homing.advance(
                word, counts
            ):
                return failure
            self.is_homed_in.append(self.homing.is_homed)
        return ''


@pytest.mark.parametrize(
    ('method', 'words', 'started'),
    [
        # bit 4 rises until the drive reports success
        (17, [IDLE, IDLE, UNDER_WAY, UNDER_WAY, SUCCESS, SUCCESS], 3),
        # the success of an earlier homing is given time to be taken back
        (17, [SUCCESS, SUCCESS, SUCCESS, UNDER_WAY, SUCCESS], 3),
        (
            17,
            [FAILED, *[FAILED] * (SETTLING_CYCLES - 1), UNDER_WAY, SUCCESS],
            SETTLING_CYCLES,
        ),
        # without motion the bit may be set again before a statusword shows it clear
        (17, [SUCCESS] * (STEADY_CYCLES + 2), STEADY_CYCLES),
        (35, [SUCCESS] * (SETTLING_CYCLES + 2), SETTLING_CYCLES),
        (37, [SUCCESS] * (SETTLING_CYCLES + 2), SETTLING_CYCLES),
    ],
)
def test_new_success_ends_homing(method, words, started):
    axis = Axis(method)
    assert not axis.run(words)
    assert axis.is_homed_in == [False] * started + [True] * (len(words) - 1 - started)


@pytest.mark.parametrize(
    ('method', 'words', 'away', 'failure'),
    [
        *(
            (method, [IDLE, UNDER_WAY] + [SUCCESS] * 200, 0.1, ELSEWHERE)
            for method in (17, 35, 37)
        ),
        # of an earlier homing, and never taken back
        *((method, [SUCCESS] * 200, 0.1, LATE) for method in (17, 37)),
        (17, [SUCCESS] * 200, 1e-4, LATE),
        (
            17,
            [SUCCESS] * 5 + [SUCCESS & ~Status.TARGET_REACHED, SUCCESS] * 99,
            0.0,
            LATE,
        ),
        *(
            (17, [IDLE, UNDER_WAY] + [0x0027 | half] * 200, 0.0, LATE)
            for half in (Status.HOMING_ATTAINED, Status.TARGET_REACHED)
        ),
        (17, [FAILED] * 200, 0.0, BROKEN),
        (17, [IDLE, UNDER_WAY] + [SUCCESS | FAILED] * 200, 0.0, 'homing failed'),
    ],
)
def test_unsuccessful_homing_fails_with_the_reason(method, words, away, failure):
    axis = Axis(method, away)
    assert re.search(failure, axis.run(words))
    assert not axis.homing.is_homed


def test_home_position_may_arrive_a_cycle_after_success():
    axis = Axis(away=0.1)
    assert not axis.run([IDLE, UNDER_WAY, SUCCESS])
    axis.away = 0.0
    assert not axis.run([IDLE, SUCCESS])
    assert axis.homing.is_homed


def longest_success(words) -> int:
    """Return the most consecutive statuswords that report success."""
    success = Status.HOMING_ATTAINED | Status.TARGET_REACHED
    longest = 0
    count = 0
    for word in words:
        is_success = word & (success | Status.HOMING_ERROR) == success
        count = count + 1 if is_success else 0
        longest = max(longest, count)
    return longest


@given(st.lists(st.integers(0, 0xFFFF), min_size=1, max_size=41))
def test_homing_succeeds_only_after_a_clear_or_steady_bit(words):
    axis = Axis()
    if axis.run(words):
        assert not axis.homing.is_homed
    elif axis.homing.is_homed:
        longest = longest_success(words[1:])
        is_steady = longest > STEADY_CYCLES
        assert is_steady or not all(word & Status.HOMING_ATTAINED for word in words)
        assert longest > 0


@pytest.mark.parametrize(('beyond', 'is_home'), [(8e-4, True), (1.2e-3, False)])
@pytest.mark.parametrize('side', [-1.0, 1.0])
def test_home_is_the_rest_position_after_the_switch(beyond, is_home, side):
    axis = Axis()
    settings = AxisSettings(homing_method=17, homing_speed=1.0)
    speed = settings.homing_zero_share * settings.homing_speed
    axis.away = side * (
        beyond + speed * PERIOD + speed**2 / (2.0 * settings.homing_acceleration)
    )
    assert not axis.run([IDLE, SUCCESS])
    assert axis.homing.is_homed == is_home


@pytest.mark.parametrize('pulses_per_revolution', [500, 2**22])
def test_homing_without_bit_10_ends_at_rest(pulses_per_revolution):
    axis = AxisSettings(
        homing_method=17,
        homing_speed=1.0,
        pulses_per_revolution=pulses_per_revolution,
    )
    homing = Homing('q1', axis, PERIOD, needs_bit_10=False)
    home = axis.to_counts(axis.home_position)
    homing.advance(UNDER_WAY, home)
    for cycle in range(20):  # it still moves by 0.1 mm in each cycle
        homing.advance(
            0x0027 | Status.HOMING_ATTAINED, home + axis.to_counts(1e-4 * cycle)
        )
        assert not homing.is_homed
    noise = axis.to_counts(1e-5)
    for cycle in range(SETTLING_CYCLES + 1):
        assert not homing.is_homed
        homing.advance(0x0027 | Status.HOMING_ATTAINED, home + noise * (cycle % 2))
    assert homing.is_homed


# --- all three axes


def homing_axes(methods, speed, ranks=(1, 2, 3)):
    """Return axes with homing methods and ranks, at a speed [m/s]."""
    axes = []
    for axis, method, rank in zip(DEFAULT_AXES, methods, ranks, strict=True):
        homing = replace(axis, homing_method=method, homing_speed=speed)
        axes.append(replace(homing, homing_rank=rank))
    return tuple(axes)


def until_first_is_homed(rig):
    """Home until q1, the first in the order, is homed; return the request."""
    rig.request('configure')
    job = rig.ask('home')
    first = rig.controller.axes[0]
    rig.until(lambda: first.homing is not None and first.homing.is_homed, 30.0)
    return job


def test_axes_of_higher_rank_home_later(make_rig):
    settings = DEFAULT_AXES[0]
    axes = homing_axes(3 * [settings.homing_method], settings.homing_speed, (2, 1, 3))
    order = []

    def check(positions, homed):
        if homed not in order:
            order.append(homed)

    rig = make_rig(axes=axes, check_homing=check)
    configured(rig)
    assert order[0] == (False, False, False)
    assert order[1] == (False, True, False)
    assert order[2] == (True, True, False)


@pytest.mark.parametrize('rate', [100, 200])
@pytest.mark.parametrize('method', load_profile('simulated').homing_methods)
def test_home_again_from_the_home_position_is_quick(make_rig, method, rate):
    axes = homing_axes(3 * [method], 0.5, ranks=(1, 1, 1))
    rig = make_rig(axes=axes, settings=replace(SETTINGS, rate=rate))
    configured(rig)
    begin = rig.clock.now
    assert rig.request('home').count('is homed') == 3
    assert rig.clock.now - begin < 1.0


def test_homing_stops_before_a_collision(make_rig):
    def check(positions, homed):
        raise LimitError('q2 - q3', 0.01, 0.02, 'm', 'below')

    rig = make_rig(check_homing=check)
    rig.request('configure')
    with pytest.raises(
        DriveError, match='homing stopped: q2 - q3 = 0.01 m.*q1 is not homed'
    ):
        rig.request('home')
    rig.until_stopped()


# --- after the axis has found home


def slip(drive, metres=0.012):
    drive.motor.offset += round(metres * drive.motor.counts_per_metre)


@pytest.mark.parametrize('methods', [(37, 17, 17), (17, 17, 17), (37, 37, 37)], ids=str)
@pytest.mark.parametrize('cycles', [1, 2, 5, 12])
def test_slip_after_the_axis_is_homed_stops_homing(make_rig, methods, cycles):
    rig = make_rig(axes=homing_axes(methods, 0.2))
    job = until_first_is_homed(rig)
    rig.cycles(cycles)
    slip(rig.drives[0])
    with pytest.raises(DriveError, match='q1 .*has jumped by 0.012 m.*q1 is not homed'):
        rig.finish(job)
    assert 'q1' in rig.snapshot.unhomed


@pytest.mark.long
@pytest.mark.parametrize('speed', [0.1, 0.5])
@pytest.mark.parametrize('method', [37, 17, 1, -4])
def test_ordinary_homing_is_not_reported_as_slip(make_rig, method, speed):
    rig = make_rig(axes=homing_axes(3 * [method], speed))
    answer = rig.request('configure', 'home')
    assert answer.count('is homed') == 3


def test_push_after_a_cancelled_homing_stops_nothing(make_rig):
    rig = make_rig(axes=homing_axes((17, 17, 17), 0.2))
    job = until_first_is_homed(rig)
    rig.cycles(12)
    rig.request('halt')
    with pytest.raises(DriveStateError, match='cancelled by halt'):
        rig.finish(job)
    slip(rig.drives[0])
    rig.run(0.1)
    assert rig.state is ControllerState.INACTIVE
    assert rig.snapshot.unhomed == ('q1', 'q2', 'q3')


def test_halt_at_the_end_of_homing_cancels_it(rig):
    rig.request('configure')
    job = rig.ask('home')
    rig.until(lambda: rig.controller.group.state is GroupState.DEACTIVATING, 30.0)
    assert 'Homing is cancelled' in rig.request('halt')
    with pytest.raises(DriveStateError, match='cancelled by halt'):
        rig.finish(job)
    assert rig.snapshot.unhomed == ('q1', 'q2', 'q3')

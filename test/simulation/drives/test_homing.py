"""Homing of the simulated drive over the bus by each method, from any position."""

import itertools

from hypothesis import given, settings
from hypothesis import strategies as st
import pytest
from simulation.drives.bench import Bench, CPM

from facade_manipulator.drives.axis_settings import AxisSettings
from facade_manipulator.drives.states import Controlword, Mode, State, Status

pytestmark = pytest.mark.long

DONE = Status.HOMING_ATTAINED | Status.TARGET_REACHED
ON_SWITCHES = (-0.56, -0.55, -0.005, 0.004, 0.55, 0.56)  # m
BITS = DONE | Status.HOMING_ERROR
TURN = AxisSettings().counts_per_revolution
# the defaults of the settings [m]
LOWER = -0.545
UPPER = 0.545
STOP = 0.56
HOME_HALF = 0.005


def index_beyond(position, direction):
    """Return the index pulse next to a position [m], in counts from the rail's middle."""
    turns = position * CPM / TURN
    whole = int(turns // 1)
    return TURN * (whole + 1 if direction > 0 else whole)


# home position of each method, in counts from the middle of the rail
PLACES = {
    17: LOWER * CPM,
    1: index_beyond(LOWER, 1),
    18: UPPER * CPM,
    2: index_beyond(UPPER, -1),
    23: -HOME_HALF * CPM,
    7: index_beyond(-HOME_HALF, -1),
    27: HOME_HALF * CPM,
    11: index_beyond(HOME_HALF, 1),
    -3: STOP * CPM,
    -1: index_beyond(STOP, -1),
    -4: -STOP * CPM,
    -2: index_beyond(-STOP, 1),
}


def homing(method, start=0.05, offset=12345, **settings):
    profile = 'epos4' if method in (23, 27, 33, 34) else 'simulated'
    bench = Bench(profile, start=start, **settings)
    velocity = AxisSettings(velocity_unit=bench.profile.velocity_unit)
    unit = velocity.velocity_units_per_count

    def scaled(value):
        return round(value * CPM * unit)

    bench.configure(
        offset,
        _6098=method,
        _609A=scaled(1.0),
        _607F=scaled(0.6),
        _6080=scaled(0.6),
        _60C5=scaled(6.0),
        _6085=scaled(5.0),
    )
    bench.write(0x6099, 1, scaled(0.2))
    bench.write(0x6099, 2, scaled(0.02))
    return bench.enable(Mode.HOMING)


def bits(bench):
    return bench.status.statusword & BITS


def run(bench, cycles=5000):
    bench.command(Controlword.HOMING_START)
    ends = (DONE, Status.HOMING_ERROR | Status.TARGET_REACHED)
    return bench.until(lambda: bits(bench) in ends, cycles)


@pytest.mark.parametrize(
    ('method', 'start'),
    [
        *itertools.product(sorted(PLACES), (-0.3, 0.3)),
        *itertools.product((17, 23, 18, 27, -4, -3), ON_SWITCHES),
    ],
)
def test_homing_method_finds_its_home_from_anywhere(method, start):
    bench = run(homing(method, start))
    assert bits(bench) == DONE
    from_middle = bench.drive.motor.carriage_position * CPM
    found = from_middle - (bench.status.position_counts - 12345)
    assert found == pytest.approx(PLACES[method], abs=1.0)
    assert bench.emergencies() == []


@settings(max_examples=20)
@given(st.floats(-0.5, 0.5), st.integers(-(10**6), 10**6), st.sampled_from([35, 37]))
def test_homing_in_place_keeps_the_position(start, offset, method):
    bench = homing(method, start, offset)
    run(bench, 10)
    assert bits(bench) == DONE
    assert bench.status.position_counts == offset
    assert bench.drive.motor.carriage_position == pytest.approx(start, abs=1e-9)


def test_cleared_start_bit_interrupts_homing():
    bench = homing(17, 0.3)
    bench.command(Controlword.HOMING_START)
    bench.cycle(50)
    assert bench.motion.velocity < 0
    bench.command()
    bench.cycle(50)
    assert bench.motion.velocity == 0
    assert bits(bench) == Status.TARGET_REACHED


@pytest.mark.parametrize(
    ('method', 'settings'), [(0, {}), (7, {'home_switch_width': 0.0})]
)
def test_homing_without_method_or_home_switch_is_an_error(method, settings):
    bench = run(homing(method, 0.1, **settings))
    assert bits(bench) == Status.HOMING_ERROR | Status.TARGET_REACHED
    assert bench.motion.velocity == 0
    assert bench.state is State.OPERATION_ENABLED

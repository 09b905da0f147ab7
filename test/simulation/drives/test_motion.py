"""Motion of the simulated drive: following, interpolation, limits and torque."""

import pytest
from simulation.drives.bench import Bench, CPM, PERIOD

from facade_manipulator.drives.states import Controlword, State

LAG = 0.005


def enabled(**changes):
    return Bench().configure(**changes).enable()


# --- following


def test_carriage_on_a_ramp_lags_by_speed_times_lag():
    bench = enabled().move_at(0.2)
    assert bench.motion.velocity == pytest.approx(0.2 * CPM, rel=1e-3)
    assert bench.motion.following_error_counts == pytest.approx(0.2 * LAG * CPM, abs=2)
    # at the SYNC the demand is the target latched two SYNCs earlier
    expected = bench.target - 0.2 * CPM * (PERIOD + LAG)
    assert bench.status.position_counts == pytest.approx(expected, abs=2)


def test_carriage_stays_within_speed_and_acceleration_limits():
    bench = enabled(_6065=0xFFFFFFFF)
    bench.target = round(0.4 * CPM)
    before = 0.0
    for _ in range(150):
        bench.cycle()
        speed = bench.motion.velocity / CPM
        assert abs(speed) <= 0.6001
        assert abs(speed - before) <= 6 * PERIOD * 1.01
        before = speed
    assert bench.status.position_counts == bench.target


# --- supervision


# a jump, beyond the software limits
@pytest.mark.parametrize(
    ('target', 'code'), [(0.2, 0x8611), (-0.51, 0x8A82), (0.51, 0x8A82)]
)
def test_impossible_target_trips_the_drive(target, code):
    bench = enabled()
    bench.target = round(target * CPM)
    bench.until(lambda: bench.state is State.FAULT)
    assert [message.code for message in bench.emergencies()] == [code]
    assert abs(bench.status.position_counts) < 0.1 * CPM


@pytest.mark.parametrize('speed, bit, code', [(0.3, 2, 0x8A81), (-0.3, 1, 0x8A80)])
def test_limit_switch_trips_and_sets_its_input_bit(speed, bit, code):
    bench = enabled()
    bench.write(0x607D, 1, 0)
    bench.write(0x607D, 2, 0)  # no limits
    bench.move_at(speed, 185)
    bench.until(lambda: bench.state is State.FAULT)
    assert [message.code for message in bench.emergencies()] == [code]
    assert bench.read(0x60FD) == bit
    bench.go(State.FAULT)
    bench.controlword = Controlword.FAULT_RESET
    bench.cycle(2)
    bench.enable().move_at(-speed, 100)  # off the switch again
    assert bench.state is State.OPERATION_ENABLED


# --- stops


@pytest.mark.parametrize(
    'option, state', [(2, State.SWITCH_ON_DISABLED), (6, State.QUICK_STOP_ACTIVE)]
)
def test_quick_stop_follows_its_option_code(option, state):
    bench = enabled(_605A=option).move_at(0.4)
    start = bench.drive.motor.carriage_position
    bench.controlword = Controlword.QUICK_STOP
    bench.cycle(60)
    assert bench.state is state
    assert bench.motion.velocity == 0
    way = bench.drive.motor.carriage_position - start
    latency = 0.4 * 2 * PERIOD
    assert 0.4**2 / (2 * 5.0) <= way <= 0.4**2 / (2 * 5.0) + latency

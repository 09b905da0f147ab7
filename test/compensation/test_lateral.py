"""The lateral regulator brings back what the head slips."""

from dataclasses import replace

import numpy as np
import pytest

from facade_manipulator.compensation.contact import LateralRegulator, LateralSettings, SHIFT_SPEED

SETTINGS = LateralSettings(enabled=True)
PERIOD = 0.01
LATENCY = 12


def regulate(slip, duration, settings=SETTINGS, heard=lambda time: True, saturation_error=0.0):
    """Return shifts and remaining slips of a head that comes late and is seen late."""
    regulator, shifts, errors = LateralRegulator(settings), [], []
    for k in range(round(duration / PERIOD)):
        now = k * PERIOD
        regulator.step(now, PERIOD, saturation_error)
        shifts.append(regulator.shift)
        errors.append(slip(now) + shifts[max(k - LATENCY, 0)])
        if heard(now):
            regulator.add_measurement(now, -errors[-1])
    return np.array(shifts), np.array(errors)


def test_a_slip_is_brought_back_without_ringing():
    _, errors = regulate(lambda _: 0.01, 8.0)
    assert errors[-1] == pytest.approx(0.0, abs=1e-5)
    assert errors.min() > -0.2 * 0.01


def test_a_drift_leaves_a_small_error():
    _, errors = regulate(lambda time: 0.002 * time, 10.0)
    assert errors[-1] == pytest.approx(0.002 / SETTINGS.integral, rel=0.05)


def test_the_shift_has_a_range_and_a_speed_and_does_not_wind_up():
    shifts, errors = regulate(lambda time: 0.3 if time < 10.0 else 0.0, 20.0)
    assert abs(shifts).max() <= SETTINGS.range
    assert abs(np.diff(shifts)).max() <= SHIFT_SPEED * PERIOD + 1e-12
    assert abs(errors[-1]) < 1e-3


def test_without_measurements_the_shift_is_held():
    shifts, _ = regulate(lambda _: 0.01, 8.0, heard=lambda time: time < 5.0)
    assert shifts[-1] == pytest.approx(shifts[550], abs=1e-4)


def test_at_the_workspace_limit_the_shift_goes_no_further():
    shifts, _ = regulate(lambda _: 0.01, 1.0, saturation_error=-0.001)
    assert not shifts.any()


def test_from_the_workspace_limit_the_shift_comes_back():
    regulator, shifts = LateralRegulator(SETTINGS), []
    for k in range(400):
        regulator.step(k * PERIOD, PERIOD, 0.001 if k >= 100 else 0.0)
        shifts.append(regulator.shift)
        regulator.add_measurement(k * PERIOD, 0.01 if k < 200 else -0.01)
    assert shifts[199] == shifts[100] > 0.01
    assert shifts[-1] < 0.0


def test_disabled_nothing_is_shifted():
    shifts, _ = regulate(lambda _: 0.01, 1.0, replace(SETTINGS, enabled=False))
    assert not shifts.any()

"""Checks for impossible IMU measurements and swapped sensors."""

import math

import numpy as np
import pytest

from facade_manipulator.errors import InputError
from facade_manipulator.estimation.estimator_settings import ImuSettings
from facade_manipulator.estimation.imu_checks import ImuGate, rotation, YawComparison
from facade_manipulator.kinematics import GRAVITY

STEP = 0.005
STILL = (0.0, 0.0, 0.0)
REST = (0.0, 0.0, GRAVITY)


def rejection(rates=STILL, forces=REST, late=0.004, count=1, step=STEP):
    """Return the reason why the last of several measurements is rejected."""
    gate = ImuGate(ImuSettings())
    found = ''
    for k in range(count):
        now = 1000.0 + k * step
        try:
            gate.check(now, now - late, rates, forces)
            found = ''
        except InputError as error:
            found = error.reason
    return found


# a bump
@pytest.mark.parametrize(
    ('expected', 'changes'),
    [
        ('', {}),
        ('not_finite', {'rates': (math.nan, 0.0, 0.0)}),
        ('not_finite', {'forces': (0.0, math.inf, 9.8)}),
        ('saturated', {'rates': (0.0, 5.0, 0.0)}),
        ('saturated', {'forces': (0.0, 40.0, 9.8)}),
        ('stale', {'late': 0.4}),
        ('future', {'late': -0.02}),
        ('out_of_order', {'count': 2, 'step': 0.0}),
        ('out_of_order', {'count': 2, 'step': -0.01}),
        (
            'unit',
            {'forces': (0.0, 0.0, 1.0), 'count': 1000},
        ),  # drivers that measure in g
        ('unit', {'forces': STILL, 'count': 2000}),  # drivers that remove gravity
        ('mounting', {'forces': (0.0, GRAVITY, 0.0), 'count': 1000}),
        ('mounting', {'forces': (0.0, 0.0, -GRAVITY), 'count': 1000}),
        ('', {'forces': (8.0, 0.0, GRAVITY), 'count': 20}),
    ],
)
def test_faulty_imu_is_rejected_with_its_reason(expected, changes):
    assert rejection(**changes) == expected


def test_measurement_after_a_saturated_one_is_accepted():
    gate = ImuGate(ImuSettings())
    gate.check(1000.0, 1000.0, STILL, REST)
    with pytest.raises(InputError, match='acceleration = 1e'):
        gate.check(1000.1, 1000.1, STILL, (1e6, 0.0, GRAVITY))
    assert gate.check(1000.2, 1000.2, STILL, REST)


@pytest.mark.parametrize(
    'angles', [(math.pi, 0.0, 0.0), (0.0, 0.0, 1.0), (0.5, -0.3, 2.0)]
)
def test_turned_imu_measurements_are_rotated_to_the_rail(angles):
    gate = ImuGate(ImuSettings(mounting=(0.0, 0.0, 0.0, *angles)))
    back = rotation(*angles).T
    rates = back @ (0.1, 0.2, 0.3)
    forces = back @ (0.0, 0.5, GRAVITY)
    _, along_rail = gate.check(0.0, 0.0, rates, forces)
    assert along_rail == pytest.approx((0.1, 0.2, 0.3, 0.0, 0.5, GRAVITY))


def fault_of(
    swapped=1.0, factor=1.0, panes=0.0, noise=2e-4, sway=0.0, left_end=math.inf
):
    """
    Return the fault that half a minute of yaw reveals.

    The rail also sways towards the wall [m/rad], and the left sensor is silent after a time [s].
    """
    comparison = YawComparison()
    random = np.random.default_rng(3)
    for time in np.arange(0.0, 30.0, 0.01):
        comparison.turned += 0.01 * (factor * 0.01 * math.cos(1.3 * time) + 0.02)
        yaw = swapped * 0.01 / 1.3 * math.sin(1.3 * time)
        places = (-0.5, 0.5) if time < left_end else (0.5,)
        for place in places:
            glass = random.uniform(0.3, 3.0) * (random.random() < panes)
            distance = (
                0.45 - (sway + place) * yaw + glass + noise * random.standard_normal()
            )
            if fault := comparison.add_distance(place, time, distance):
                return fault
    return ''


@pytest.mark.parametrize(
    ('changes', 'fault'),
    [
        ({}, ''),
        ({'panes': 0.5}, ''),
        ({'noise': 0.05}, ''),
        ({'sway': -3.0}, ''),
        ({'sway': -3.0, 'left_end': 5.0}, ''),
        ({'panes': 0.5, 'swapped': -1.0}, ''),
        ({'factor': 180.0 / math.pi, 'noise': 0.05}, ''),
        ({'factor': 180.0 / math.pi}, 'degrees per second'),
        ({'swapped': -1.0}, 'left and right'),
    ],
)
def test_only_swapped_sensors_and_degrees_are_named(changes, fault):
    assert bool(fault) == bool(found := fault_of(**changes)) and fault in found

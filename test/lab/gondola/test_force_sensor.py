"""The force sensor: noise and faults."""

import numpy as np
import pytest

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Wrench
from facade_manipulator.lab.gondola.sensors import ForceSensor, ForceSensorSettings

PERIOD = 0.01


def measured(duration=4.0, **changes):
    """Return what a sensor tells of a force that rises by 10 N/s."""
    sensor = ForceSensor(ForceSensorSettings(**changes))
    return [sensor.measure(time, Wrench(0.0, -10.0 * time, 0.0))
            for time in np.arange(0.0, duration, PERIOD)]


def forces(**changes):
    return np.array([-wrench.fy for wrench in measured(
        force_noise=0.0, moment_noise=0.0, fault_from=2.0, **changes)])


def test_the_noise_is_as_strong_as_set():
    rows = np.array(measured(duration=50.0))
    truth = 10.0 * np.arange(0.0, 50.0, PERIOD)
    assert rows[:, 0].std() == pytest.approx(0.5, rel=0.05)
    assert (rows[:, 1] + truth).std() == pytest.approx(0.5, rel=0.05)
    assert rows[:, 2].std() == pytest.approx(0.05, rel=0.05)


@pytest.mark.parametrize(('fault', 'last'), [
    ('stuck', 20.0), ('jump', 59.9), ('reversed', -39.9), ('late', 37.9)])
def test_a_broken_sensor_tells_something_else_from_then_on(fault, last):
    shown = forces(fault=fault)
    assert shown[199] == pytest.approx(19.9)
    assert shown[-1] == pytest.approx(last, abs=0.1001)


def test_a_silent_sensor_tells_nothing():
    shown = measured(fault='silent', fault_from=2.0)
    assert None not in shown[:200]
    assert set(shown[200:]) == {None}


@pytest.mark.parametrize('values', [{'fault': 'tired'}, {'force_noise': -1.0}])
def test_a_sensor_that_makes_no_sense_is_rejected(values):
    with pytest.raises(ParameterError, match=next(iter(values))):
        ForceSensorSettings(**values)

"""The force sensor: its noise."""

import numpy as np
import pytest

from facade_manipulator.errors import ParameterError
from facade_manipulator.kinematics import Wrench
from facade_manipulator.lab.gondola.sensors import ForceSensor, ForceSensorSettings


def test_the_noise_is_as_strong_as_set():
    sensor, truth = ForceSensor(ForceSensorSettings()), Wrench(0.0, -10.0, 0.0)
    rows = np.array([sensor.measure(truth) for _ in range(5000)])
    assert rows.mean(axis=0) == pytest.approx(np.array(truth), abs=0.05)
    assert rows.std(axis=0) == pytest.approx([0.5, 0.5, 0.05], rel=0.05)


def test_a_noise_that_makes_no_sense_is_rejected():
    with pytest.raises(ParameterError, match='force_noise'):
        ForceSensorSettings(force_noise=-1.0)

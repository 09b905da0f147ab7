"""The gondola's motion as sums of sines."""

import math

import numpy as np
import pytest

from facade_manipulator.errors import ParameterError
from facade_manipulator.lab.gondola.motion import Sway, SwaySettings


def test_the_default_wind_has_the_amplitudes_of_the_demo():
    sway = Sway(SwaySettings())
    course = np.array([sway.at(time) for time in np.arange(0.0, 100.0, 0.01)])
    assert course.std(axis=0) == pytest.approx(
        (math.hypot(0.1, 0.02) / math.sqrt(2), 0.015 / math.sqrt(2),
         math.radians(2.0) / math.sqrt(2)), rel=0.01)


def test_an_axis_without_sines_stands_still():
    still = {f'{axis}_{part}': () for axis in ('x', 'y', 'yaw')
             for part in ('amplitude', 'frequency', 'phase')}
    assert Sway(SwaySettings(**still)).at(3.0) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize('values', [
    {'x_amplitude': (0.1,)}, {'y_frequency': (0.1, 0.2)}, {'yaw_phase': ()},
    {'x_frequency': (-0.1, 0.3)}, {'y_amplitude': (math.nan,)}])
def test_sines_that_make_no_sense_are_rejected(values):
    with pytest.raises(ParameterError, match=next(iter(values)).split('_')[0]):
        SwaySettings(**values)

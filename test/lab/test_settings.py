"""Worlds that cannot be: settings of the laboratory reject them by name, value and bound."""

from math import inf, nan

import pytest

from facade_manipulator.errors import ParameterError
from facade_manipulator.lab.gondola.facade import FacadeSettings
from facade_manipulator.lab.gondola.gondola import GondolaSettings
from facade_manipulator.lab.gondola.motion import SwaySettings
from facade_manipulator.lab.gondola.sensors import EstimatorSettings, ForceSensorSettings
from facade_manipulator.lab.gondola.wind import WindSettings
from facade_manipulator.simulation.drives.motor import SimulationSettings


@pytest.mark.parametrize(('settings', 'values', 'message'), [
    (FacadeSettings, {'step_positions': (0.1,)}, 'step_positions'),
    (FacadeSettings, {'stiffness': 0.0}, 'stiffness'),
    (FacadeSettings, {'friction': -0.1}, 'friction'),
    (FacadeSettings, {'distance': inf}, 'distance'),
    (GondolaSettings, {'cable_length': 0.0}, 'cable_length'),
    (GondolaSettings, {'mass': -1.0}, 'mass'),
    (GondolaSettings, {'damping_ratio': 1.0}, 'damping_ratio'),
    (GondolaSettings, {'area': nan}, 'area'),
    (WindSettings, {'height': 0.5}, 'height'),
    (WindSettings, {'spectrum': 'pink'}, 'spectrum'),
    (WindSettings, {'mean_speed': 0.0}, 'mean_speed'),
    (WindSettings, {'height': 5.0, 'roughness_length': 4.0}, 'height'),
    (SwaySettings, {'x_amplitude': (0.1,)}, 'x_'),
    (SwaySettings, {'y_frequency': (0.1, 0.2)}, 'y_'),
    (SwaySettings, {'yaw_phase': ()}, 'yaw_'),
    (SwaySettings, {'x_frequency': (-0.1, 0.3)}, 'x_'),
    (SwaySettings, {'y_amplitude': (nan,)}, 'y_'),
    (EstimatorSettings, {'latency': 0.01, 'jitter': 0.02}, 'future'),
    (ForceSensorSettings, {'force_noise': -1.0}, 'force_noise'),
    (SimulationSettings, {'lag': -0.1}, 'lag = -0.1 s is below'),
    (SimulationSettings, {'coasting': nan}, 'coasting'),
])
def test_settings_that_make_no_sense_are_rejected(settings, values, message):
    with pytest.raises(ParameterError, match=message):
        settings(**values)

"""
The world around the manipulator: gondola, wind, wall, estimator, and scenarios made of them.

In: a `Scenario` and time. Out: the true disturbance, delayed and noisy estimates, the wrench on
the head and its error on the wall. `simulation.bench` measures the compensation with it; what
draws (`simulation.pictures`) is imported by those alone who draw.
"""

from facade_manipulator.simulation.facade import Facade, FacadeSettings
from facade_manipulator.simulation.reaction import carriage_loads, PressedGondola
from facade_manipulator.simulation.scenario import (
    compensator_parameters,
    load_scenario,
    Scenario,
)
from facade_manipulator.simulation.sensors import ForceSensor, SimulatedEstimator
from facade_manipulator.simulation.wall import AXES, SCALES, UNITS, WallMeasurement, WallSample

__all__ = [
    'AXES',
    'carriage_loads',
    'compensator_parameters',
    'Facade',
    'FacadeSettings',
    'ForceSensor',
    'load_scenario',
    'PressedGondola',
    'SCALES',
    'Scenario',
    'SimulatedEstimator',
    'UNITS',
    'WallMeasurement',
    'WallSample',
]

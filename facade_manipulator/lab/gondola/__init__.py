"""
The world around the manipulator: gondola, wind, wall, estimator, and scenarios made of them.

In: a `Scenario` and time. Out: the true disturbance, delayed and noisy estimates, the wrench on
the head and its error on the wall. Only programs that draw import `pictures`.
"""

from .closed_loop import ClosedLoop as ClosedLoop
from .closed_loop import LoopStep as LoopStep
from .course import between as between
from .course import Course as Course
from .course import decibels as decibels
from .course import figures as figures
from .course import giving_way as giving_way
from .course import rms as rms
from .facade import Facade as Facade
from .facade import FacadeSettings as FacadeSettings
from .gondola import GondolaSettings as GondolaSettings
from .motion import Motion as Motion
from .motion import Sway as Sway
from .rail_sensors import RailSensors as RailSensors
from .reaction import carriage_loads as carriage_loads
from .reaction import PressedGondola as PressedGondola
from .scenario import compensator_parameters as compensator_parameters
from .scenario import load_scenario as load_scenario
from .scenario import MissionSettings as MissionSettings
from .scenario import read_sections as read_sections
from .scenario import Scenario as Scenario
from .scenario import scenario_file as scenario_file
from .sensors import EstimatorSettings as EstimatorSettings
from .sensors import ForceSensor as ForceSensor
from .sensors import SimulatedEstimator as SimulatedEstimator
from .wall import AXES as AXES
from .wall import SCALES as SCALES
from .wall import UNITS as UNITS
from .wall import WallMeasurement as WallMeasurement
from .wall import WallSample as WallSample
from .wind import WindSettings as WindSettings

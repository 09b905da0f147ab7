"""
Where the rail is on the façade, from sensors that can be bought.

In: turning rates and accelerations, distances of the wall, features or poses seen, each with its
stamp. Out: pose and velocity of the rail, with covariances that hold; what became of each sensor's
measurements, and events with their reasons.
"""

from .association import SensorRecord as SensorRecord
from .estimator import DisturbanceEstimator as DisturbanceEstimator
from .estimator import EstimatorEvent as EstimatorEvent
from .estimator import RailMotion as RailMotion
from .inputs import ImuGate as ImuGate
from .inputs import rotation as rotation
from .inputs import YawComparison as YawComparison
from .messages import Add as Add
from .messages import FIX as FIX
from .messages import IMU as IMU
from .messages import Input as Input
from .messages import inputs as inputs
from .messages import POSE as POSE
from .messages import RANGE as RANGE
from .messages import rates_and_forces as rates_and_forces
from .sensors import innovation_of as innovation_of
from .sensors import make_sensors as make_sensors
from .sensors import residual_of as residual_of
from .sensors import Wall as Wall
from .sensors import WallSensor as WallSensor
from .settings import DistanceSettings as DistanceSettings
from .settings import EstimatorSetup as EstimatorSetup
from .settings import FixSettings as FixSettings
from .settings import ImuSettings as ImuSettings
from .settings import PoseFixSettings as PoseFixSettings
from .settings import ProfileSettings as ProfileSettings
from .settings import SensorNames as SensorNames
from .state import InertialInput as InertialInput
from .state import Process as Process
